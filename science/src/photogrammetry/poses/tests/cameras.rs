//! Focal lengths: in the file of the poses, and in a zip of a COLMAP model.

use std::io::{Cursor, Write};

use zip::{ZipWriter, write::SimpleFileOptions};

use super::{
    formats::{alicevision, colmap_binary, colmap_text, metashape, openmvg},
    *,
};

/// The camera models of COLMAP in the order of their ids, with `fx`, `fy` of 990 and 1010 px or `f` of 1000 px.
/// <https://github.com/colmap/colmap/tree/main/src/colmap/sensor/models>
const MODELS: [(&str, &[f64]); 17] = [
    ("SIMPLE_PINHOLE", &[1000.0, 405.0, 270.0]),
    ("PINHOLE", &[990.0, 1010.0, 405.0, 270.0]),
    ("SIMPLE_RADIAL", &[1000.0, 405.0, 270.0, 0.1]),
    ("RADIAL", &[1000.0, 405.0, 270.0, 0.1, 0.2]),
    ("OPENCV", &[990.0, 1010.0, 405.0, 270.0, 0.1, 0.2, 0.3, 0.4]),
    ("OPENCV_FISHEYE", &[990.0, 1010.0, 405.0, 270.0, 0.1, 0.2, 0.3, 0.4]),
    ("FULL_OPENCV", &[990.0, 1010.0, 405.0, 270.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]),
    ("FOV", &[990.0, 1010.0, 405.0, 270.0, 0.1]),
    ("SIMPLE_RADIAL_FISHEYE", &[1000.0, 405.0, 270.0, 0.1]),
    ("RADIAL_FISHEYE", &[1000.0, 405.0, 270.0, 0.1, 0.2]),
    ("THIN_PRISM_FISHEYE", &[990.0, 1010.0, 405.0, 270.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]),
    (
        "RAD_TAN_THIN_PRISM_FISHEYE",
        &[990.0, 1010.0, 405.0, 270.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2],
    ),
    ("SIMPLE_DIVISION", &[1000.0, 405.0, 270.0, 0.1]),
    ("DIVISION", &[990.0, 1010.0, 405.0, 270.0, 0.1]),
    ("SIMPLE_FISHEYE", &[1000.0, 405.0, 270.0]),
    ("FISHEYE", &[990.0, 1010.0, 405.0, 270.0]),
    ("EUCM", &[990.0, 1010.0, 405.0, 270.0, 0.1, 0.2]),
];

fn zipped(members: &[(&str, &[u8])]) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in members {
        zip.start_file(*name, SimpleFileOptions::default()).expect("a member");
        zip.write_all(bytes).expect("a member");
    }
    zip.finish().expect("a zip").into_inner()
}

fn camera_line(id: u32, (model, parameters): (&str, &[f64])) -> String {
    let parameters: Vec<String> = parameters.iter().map(f64::to_string).collect();
    format!("{id} {model} 810 540 {}\n", parameters.join(" "))
}

fn camera_record(id: u32, model: u32, parameters: &[f64]) -> Vec<u8> {
    let size = [810_u64, 540].map(u64::to_le_bytes).concat();
    let parameters: Vec<u8> = parameters.iter().flat_map(|value| value.to_le_bytes()).collect();
    [&id.to_le_bytes()[..], &model.to_le_bytes(), &size, &parameters].concat()
}

fn poses() -> Vec<Pose> {
    turntable(&[0.0, 12.0], 0.1, 1.0, 8)
}

fn focal_px(file: &[u8]) -> Vec<f64> {
    read(file, None).expect("poses").focal_px
}

fn refused(file: &[u8]) -> String {
    let error = read(file, None).expect_err("a refusal");
    assert_eq!(error.kind, ErrorKind::InvalidPoses, "{error}");
    error.detail
}

#[test]
fn every_camera_model_of_colmap_has_its_focal_length() {
    let images = colmap_text(&poses());
    for (id, (model, parameters)) in (0..).zip(MODELS) {
        let text = format!(
            "# Camera list\n\n{}{}",
            camera_line(5, ("PINHOLE", &[7.0; 4])),
            camera_line(1, (model, parameters))
        );
        let binary =
            [&2_u64.to_le_bytes()[..], &camera_record(5, 1, &[7.0; 4]), &camera_record(1, id, parameters)].concat();
        for cameras in [("cameras.txt", text.as_bytes()), ("cameras.bin", &binary)] {
            let zip = zipped(&[("images.txt", images.as_bytes()), cameras]);
            assert_eq!(focal_px(&zip), vec![1000.0; 36], "{model} in {}", cameras.0);
        }
    }
}

#[test]
fn a_zip_of_a_model_is_read_whatever_else_is_in_it() {
    let (text, binary) = (colmap_text(&poses()), colmap_binary(&poses()));
    let cameras = [&1_u64.to_le_bytes()[..], &camera_record(1, 0, MODELS[0].1)].concat();
    let both = zipped(&[
        ("model/0/points3D.bin", &[0xFF; 99]),
        ("model/0/project.ini", b"[Mapper]"),
        ("model/0/images.txt", b"damaged, but the binary file is read"),
        ("model/0/cameras.txt", b"damaged, too"),
        ("model/0/images.bin", &binary),
        ("model/0/cameras.bin", &cameras),
        ("__MACOSX/model/0/._images.bin", b"x"),
    ]);
    let found = read(&both, None).expect("a model");
    assert_eq!((found.format, found.poses.len(), found.focal_px.len()), (PoseFormat::ColmapBinary, 36, 36));
    let alone = read(&zipped(&[("images.txt", text.as_bytes())]), None).expect("a model");
    assert_eq!((alone.format, alone.poses.len(), alone.focal_px), (PoseFormat::ColmapText, 36, vec![]));
    // a view of another camera than those of the file, and one whose focal length is none
    for camera in [camera_line(2, MODELS[0]), camera_line(1, ("SIMPLE_PINHOLE", &[-1.0, 405.0, 270.0]))] {
        let zip = zipped(&[("images.txt", text.as_bytes()), ("cameras.txt", camera.as_bytes())]);
        assert_eq!(focal_px(&zip), [0.0; 0], "{camera}");
    }
}

#[test]
fn a_zip_that_is_no_model_is_refused_with_what_to_send() {
    let images = colmap_text(&poses());
    let images = images.as_bytes();
    let none = refused(&zipped(&[("points3D.bin", b"x")]));
    assert!(none.starts_with("the zip has no images.bin or images.txt: zip the folder of a COLMAP model"), "{none}");
    let two = refused(&zipped(&[("sparse/0/images.txt", images), ("model/0/images.txt", images)]));
    assert!(two.starts_with("the zip has sparse/0/images.txt and model/0/images.txt in two folders"), "{two}");
    assert!(refused(b"PK\x03\x04\x14\0\0\0").contains("zip"), "a zip that was cut off");
    for cameras in
        ["1 EQUIRECTANGULAR 810 540 810 540", "1 NEW_MODEL 810 540 1 2 3", "1 PINHOLE 810 540 1000 405", "\0"]
    {
        let zip = zipped(&[("images.txt", images), ("0.txt", b"x"), ("cameras.txt", cameras.as_bytes())]);
        let detail = refused(&zip);
        assert!(detail.starts_with("cameras.txt: camera 1 of 1 is damaged, or its model"), "{cameras}: {detail}");
        assert!(detail.ends_with("send the file of the images alone, and give focal_px"), "{detail}");
    }
    let many = 10_000_u64.to_le_bytes();
    for cameras in [&many[..], &[1, 2, 3], &[&many[..], &camera_record(1, 99, &[])].concat(), b""] {
        let detail = refused(&zipped(&[("images.txt", images), ("cameras.bin", cameras)]));
        assert!(detail.starts_with("cameras.bin: camera 1 of "), "{detail}");
    }
}

#[test]
fn a_zip_that_unpacks_to_much_is_refused() {
    let zeros = vec![0; 129 << 20];
    let zip = zipped(&[("images.bin", &zeros), ("cameras.bin", b"x")]);
    assert!(zip.len() < 1 << 20, "{}", zip.len());
    let detail = refused(&zip);
    assert!(detail.starts_with("images.bin has 135266304 bytes uncompressed"), "{detail}");
    // what is not read may be of any size
    let images = colmap_text(&poses());
    let zip = zipped(&[("images.txt", images.as_bytes()), ("points3D.bin", &zeros)]);
    assert_eq!(read(&zip, None).expect("a model").poses.len(), 36);
}

#[test]
fn alicevision_openmvg_and_metashape_have_the_focal_length_beside_the_poses() {
    let poses = poses();
    let sfm = alicevision(&poses);
    for intrinsic in [
        r#""width": "810", "sensorWidth": "36", "focalLength": "44.444444444444446""#,
        r#""width": "810", "pxFocalLength": "1000""#,
        r#""width": 810, "pxFocalLength": 1000"#,
        r#""width": "810", "pxFocalLength": ["990", "1010"]"#,
    ] {
        let with = format!(r#""intrinsics":[{{ "intrinsicId": "8" }}, {{ "intrinsicId": "7", {intrinsic} }}]"#);
        let found = focal_px(sfm.replace(r#""intrinsics":"""#, &with).as_bytes());
        assert!(found.len() == 36 && found.iter().all(|px| (px - 1000.0).abs() < 1e-9), "{intrinsic}: {found:?}");
    }
    assert_eq!(focal_px(sfm.as_bytes()), [0.0; 0]);

    let sfm = openmvg(&poses);
    for focal in ["1000.0", "[990.0, 1010.0]"] {
        let data =
            format!(r#"{{ "width": 810, "height": 540, "focal_length": {focal}, "principal_point": [405, 270] }}"#);
        let value =
            format!(r#"{{ "polymorphic_id": 2147483649, "ptr_wrapper": {{ "id": 2147483660, "data": {data} }} }}"#);
        let with = format!(r#"{{"intrinsics":[{{ "key": 0, "value": {value} }}],"#);
        assert_eq!(focal_px(sfm.replacen('{', &with, 1).as_bytes()), vec![1000.0; 36], "{focal}");
    }

    let xml = metashape(&poses);
    for calibrations in [
        "<calibration class=\"adjusted\"><f>1000</f></calibration><calibration class=\"initial\"><f>1200</f></calibration>",
        "<calibration class=\"initial\"><f>1200</f></calibration><calibration class=\"adjusted\"><f>1000</f></calibration>",
        "<calibration class=\"initial\"><f>1000</f></calibration>",
        "<calibration class=\"adjusted\"><fx>990</fx><fy>1010</fy></calibration>",
    ] {
        let other = "<sensor id=\"1\"><calibration><f>5</f></calibration></sensor><sensor id=\"2\"/>";
        let sensors = format!("<sensors><sensor id=\"0\">{calibrations}</sensor>{other}</sensors><cameras>");
        assert_eq!(focal_px(xml.replace("<cameras>", &sensors).as_bytes()), vec![1000.0; 36], "{calibrations}");
    }
}

#[test]
fn more_cameras_than_a_scan_has_views_are_refused() {
    let images = colmap_text(&poses());
    let text: String = (0..=10_000).map(|id| camera_line(id, ("SIMPLE_PINHOLE", &[1000.0, 405.0, 270.0]))).collect();
    let binary = u64::MAX.to_le_bytes();
    for cameras in [("cameras.txt", text.as_bytes()), ("cameras.bin", &binary[..])] {
        let detail = refused(&zipped(&[("images.txt", images.as_bytes()), cameras]));
        assert!(detail.contains("cameras; a scan has at most 10000 views"), "{detail}");
    }
}

#[test]
fn a_colmap_model_gives_each_view_its_camera() {
    let (poses, images) = (poses(), colmap_text(&poses()));
    let radial = [1000.0, 405.0, 270.0, 0.1, 0.2];
    let other = camera_line(5, ("PINHOLE", &[7.0; 4]));
    let text = format!("# Camera list\n{other}{}", camera_line(1, ("RADIAL", &radial)));
    let binary = [&1_u64.to_le_bytes()[..], &camera_record(1, 3, &radial)].concat();
    let binary_images = colmap_binary(&poses);
    for (images, cameras) in [
        (("images.txt", images.as_bytes()), ("cameras.txt", text.as_bytes())),
        (("images.bin", &binary_images[..]), ("cameras.bin", &binary[..])),
    ] {
        let views = colmap_views(images, cameras).expect("views");
        assert_eq!(views.len(), poses.len());
        for ((name, camera), pose) in views.iter().zip(&poses) {
            assert_eq!(*name, pose.name);
            assert!((0..3).all(|axis| (camera.centre[axis] - pose.centre[axis]).abs() < 1e-4));
            assert_eq!((camera.focal_px, camera.principal_point_px), ([1000.0; 2], [404.5, 269.5]));
            assert_eq!((camera.radial, camera.size), ([0.1, 0.2], [810, 540]));
            let rotation = pose.rotation.expect("known");
            assert!((0..9).all(|at| (camera.rotation[at / 3][at % 3] - rotation[at / 3][at % 3]).abs() < 1e-4));
        }
    }
}

#[test]
fn cameras_that_are_no_pinholes_with_radial_distortion_are_refused() {
    let images = colmap_text(&poses());
    let refused = |camera: (&str, &[f64]), id: u32| {
        let cameras = camera_line(id, camera);
        let views = colmap_views(("images.txt", images.as_bytes()), ("cameras.txt", cameras.as_bytes()));
        views.expect_err("a refusal").detail
    };
    for at in [5, 6, 7] {
        assert!(refused(MODELS[at], 1).contains("run colmap image_undistorter"), "{:?}", MODELS[at]);
    }
    assert!(refused(MODELS[4], 1).contains("run colmap image_undistorter"), "tangential distortion");
    assert!(refused(MODELS[0], 2).starts_with("images.txt: camera 1 of '"));
    assert!(refused(("SIMPLE_PINHOLE", &[-5.0, 1.0, 1.0]), 1).contains("not positive"));
    assert!(refused(("SIMPLE_PINHOLE", &[5.0, f64::NAN, 1.0]), 1).contains("not finite"));
}
