//! Every format, written from the same poses and read back; files that are damaged, hostile or of another kind.

use proptest::prelude::*;

use super::*;

fn rotation(pose: &Pose) -> [[f64; 3]; 3] {
    pose.rotation.expect("a rotation")
}

fn quaternion(pose: &Pose) -> [f64; 4] {
    let turn = Rotation3::from_matrix_unchecked(matrix(&rotation(pose)));
    let q = nalgebra::UnitQuaternion::from_rotation_matrix(&turn);
    [q.w, q.i, q.j, q.k]
}

fn translation(pose: &Pose) -> [f64; 3] {
    (-(matrix(&rotation(pose)) * Vector3::from(pose.centre))).into()
}

fn joined(values: &[f64], by: &str) -> String {
    texts(values).join(by)
}

fn texts(values: &[f64]) -> Vec<String> {
    values.iter().map(f64::to_string).collect()
}

/// Every format, written from the same poses.
fn written(format: PoseFormat, poses: &[Pose]) -> Vec<u8> {
    match format {
        PoseFormat::ColmapText => colmap_text(poses).into(),
        PoseFormat::ColmapBinary => colmap_binary(poses),
        PoseFormat::Alicevision => alicevision(poses).into(),
        PoseFormat::Openmvg => openmvg(poses).into(),
        PoseFormat::Metashape => metashape(poses).into(),
        PoseFormat::Csv => csv(poses).into(),
    }
}

pub(super) fn colmap_text(poses: &[Pose]) -> String {
    let mut out = "# Image list with two lines of data per image:\n".to_owned();
    for (at, pose) in poses.iter().enumerate() {
        let (q, t) = (joined(&quaternion(pose), " "), joined(&translation(pose), " "));
        out.push_str(&format!("{} {q} {t} 1 {}\n1.5 2.5 -1 7 8 12\n", at + 1, pose.name));
    }
    out
}

pub(super) fn colmap_binary(poses: &[Pose]) -> Vec<u8> {
    let mut out = (poses.len() as u64).to_le_bytes().to_vec();
    for (at, pose) in poses.iter().enumerate() {
        out.extend(u32::try_from(at).expect("few").to_le_bytes());
        quaternion(pose).iter().chain(&translation(pose)).for_each(|x| out.extend(x.to_le_bytes()));
        out.extend(1_u32.to_le_bytes());
        out.extend(pose.name.as_bytes());
        out.push(0);
        out.extend(2_u64.to_le_bytes());
        out.extend([0; 48]);
    }
    out
}

pub(super) fn alicevision(poses: &[Pose]) -> String {
    // ids of poses differ from those of views
    let view = |(at, pose): (usize, &Pose)| serde_json::json!({ "viewId": format!("{at}"), "poseId": format!("{}", at + 500), "intrinsicId": "7", "path": pose.name });
    let pose = |(at, pose): (usize, &Pose)| {
        let transposed = [0, 1, 2].map(|j| rotation(pose).map(|row| row[j]));
        let rotation = texts(&transposed.concat());
        let transform = serde_json::json!({ "rotation": rotation, "center": texts(&pose.centre) });
        serde_json::json!({ "poseId": format!("{}", at + 500), "pose": { "transform": transform, "locked": "0" } })
    };
    let views: Vec<_> = poses.iter().enumerate().map(view).collect();
    let poses: Vec<_> = poses.iter().enumerate().map(pose).collect();
    serde_json::json!({ "version": ["1", "2", "8"], "views": views, "intrinsics": "", "poses": poses }).to_string()
}

pub(super) fn openmvg(poses: &[Pose]) -> String {
    let view = |(at, pose): (usize, &Pose)| {
        let data = serde_json::json!({ "local_path": "", "filename": pose.name, "width": 10, "height": 10, "id_view": at, "id_intrinsic": 0, "id_pose": at });
        serde_json::json!({ "key": at, "value": { "polymorphic_id": 1073741824, "ptr_wrapper": { "id": 1, "data": data } } })
    };
    let extrinsic = |(at, pose): (usize, &Pose)| serde_json::json!({ "key": at, "value": { "rotation": rotation(pose), "center": pose.centre } });
    let views: Vec<_> = poses.iter().enumerate().map(view).collect();
    let extrinsics: Vec<_> = poses.iter().enumerate().rev().map(extrinsic).collect();
    serde_json::json!({ "sfm_data_version": "0.3", "root_path": "", "views": views, "extrinsics": extrinsics })
        .to_string()
}

pub(super) fn metashape(poses: &[Pose]) -> String {
    // a chunk of its own size and place, in which the cameras are
    let (turn, scale, shift) = (Rotation3::from_euler_angles(0.3, 0.2, 0.1), 2.5, Vector3::new(1.0, 2.0, 3.0));
    let mut out = "<?xml version=\"1.0\"?>\n<document version=\"1.5.0\"><chunk label=\"a\"><cameras><group>".to_owned();
    for (at, pose) in poses.iter().enumerate() {
        let centre = turn.inverse() * (Vector3::from(pose.centre) - shift) / scale;
        let from_camera = turn.inverse().matrix() * matrix(&rotation(pose)).transpose();
        let line = |i: usize| [from_camera[(i, 0)], from_camera[(i, 1)], from_camera[(i, 2)], centre[i]];
        let values = [line(0), line(1), line(2), [0.0, 0.0, 0.0, 1.0]].concat();
        out.push_str(&format!(
            "<camera id=\"{at}\" sensor_id=\"0\" component_id=\"0\" label=\"{}\"><transform>{}</transform></camera>\n",
            pose.name,
            joined(&values, " ")
        ));
    }
    let transform = format!(
        "<transform><rotation>{}</rotation><translation>{}</translation><scale>{scale}</scale></transform>",
        joined(&rows(turn.matrix()).concat(), " "),
        joined(shift.as_slice(), " ")
    );
    out.push_str(&format!("<camera id=\"999\" label=\"lost.png\"/></group></cameras><components><component id=\"0\">{transform}</component></components></chunk></document>"));
    out
}

fn csv(poses: &[Pose]) -> String {
    let mut out = "\u{feff}#Label;Z;Y;X\r\n".to_owned();
    for pose in poses {
        let [x, y, z] = pose.centre;
        out.push_str(&format!("{};{z};{y};{x}\r\n", pose.name));
    }
    out.push_str("lost.png;;;\r\n");
    out
}

const FORMATS: [PoseFormat; 6] = [
    PoseFormat::ColmapText,
    PoseFormat::ColmapBinary,
    PoseFormat::Alicevision,
    PoseFormat::Metashape,
    PoseFormat::Openmvg,
    PoseFormat::Csv,
];

#[test]
fn every_format_is_recognised_and_gives_the_same_poses() {
    let poses = turntable(&[0.0, 12.0], 0.1, 1.0, 8);
    for format in FORMATS {
        let found = read(&written(format, &poses), None).unwrap_or_else(|error| panic!("{format:?}: {error}"));
        assert_eq!((found.format, found.poses.len()), (format, poses.len()));
        for (found, pose) in found.poses.iter().zip(&poses) {
            assert_eq!(found.name, pose.name);
            let apart = Vector3::from(found.centre) - Vector3::from(pose.centre);
            assert!(apart.norm() < 1e-9, "{format:?}: {apart}");
            if let Some(rotation) = found.rotation {
                let wrong = matrix(&rotation) - matrix(&pose.rotation.expect("a rotation"));
                assert!(wrong.norm() < 1e-9, "{format:?}: {wrong}");
            }
            assert_eq!(found.rotation.is_none(), format == PoseFormat::Csv);
        }
        if matches!(format, PoseFormat::Csv | PoseFormat::Metashape) {
            assert_eq!(found.unregistered, ["lost.png"]);
        }
    }
}

#[test]
fn views_of_alicevision_and_openmvg_without_a_pose_are_not_registered() {
    let lost = r#"{ "views": [{ "viewId": 1, "poseId": 1, "path": "/a/b.jpg" }], "poses": [] }"#;
    let error = read(lost.as_bytes(), None).expect_err("no poses");
    assert_eq!(error.kind, ErrorKind::InvalidPoses);
    assert!(error.detail.contains("it lists 1 views without one"), "{error}");
}

#[test]
fn a_csv_may_bring_its_angles_and_names_the_line_that_is_wrong() {
    let rows: String = turntable(&[0.0, 12.0], 0.0, 0.0, 9)
        .iter()
        .map(|pose| {
            let [pan, tilt] = angles(&pose.name).expect("its name");
            let [x, y, z] = pose.centre;
            format!("IMG {pan}-{tilt},{tilt},{x},{y},{z},{pan}\n")
        })
        .collect();
    let text = format!("name,tilt_deg,x,y,z,pan_deg\n{rows}");
    let found = reported(read(text.as_bytes(), None).expect("poses").poses);
    assert_eq!(found.pan_steps.map(|steps| steps.count), Some(36));
    let wrong = text.replacen("\nIMG 20-0,0,", "\nIMG 20-0,0,x", 1);
    let error = read(wrong.as_bytes(), None).expect_err("not a number");
    assert!(error.detail.starts_with("line 3: x is 'x"), "{error}");
    let error = read(b"image,x,y\na,1,2\n", None).expect_err("no z");
    assert_eq!(error.detail, "the CSV has no column 'z'; its first line must name the columns");
}

#[test]
fn a_csv_may_have_decimal_commas_and_the_columns_of_realitycapture() {
    let told = |text: &str| read(text.as_bytes(), None).map(|found| found.poses[0].centre);
    for text in [
        "name;x;y;z\na.png;1,5;-0,25;3\n",
        "name\tx\ty\tz\na.png\t1,5\t-0,25\t3\n",
        "#name,x,y,alt,heading,pitch,roll\na.png,1.5,-0.25,3,0,0,0\n",
    ] {
        assert_eq!(told(text).expect("poses"), [1.5, -0.25, 3.0], "{text}");
    }
    let error = told("name;x;y;z\na.png;1.234,5;0;3\n").expect_err("two points");
    assert_eq!(error.detail, "line 2: x is '1.234,5', not a number");
    // commas separate here
    assert!(told("name,x,y,z\na.png,1,5,2,5,3\n").is_ok_and(|centre| centre == [1.0, 5.0, 2.0]));
}

#[test]
fn a_compressed_file_is_named() {
    let error = read(b"\x1F\x8B\x08\0\0\0", None).expect_err("compressed");
    assert!(error.detail.starts_with("the file is compressed by gzip; unpack it"), "{error}");
}

#[test]
fn a_name_that_is_not_utf8_is_refused_with_its_image() {
    let named = |name: &[u8]| {
        let numbers = [1.0_f64, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0].map(f64::to_le_bytes).concat();
        let record = |name: &[u8]| [&[0; 4][..], &numbers, &[0; 4], name, &[0; 9]].concat();
        let file = [2_u64.to_le_bytes().to_vec(), record(b"a.png"), record(name)].concat();
        read(&file, Some(PoseFormat::ColmapBinary)).map(|found| found.poses[1].name.clone())
    };
    assert_eq!(named("Käfer.png".as_bytes()).expect("UTF-8"), "Käfer.png");
    let error = named(b"K\xe4fer.png").expect_err("Latin-1");
    assert_eq!(error.detail, "image 2 of 2: its name is not UTF-8; rename the image in UTF-8 or ASCII");
}

#[test]
fn a_file_of_another_kind_is_refused_with_what_to_send() {
    let cameras = "# Camera list\n1 PINHOLE 100 100 50 50 50 50\n";
    let error = read(cameras.as_bytes(), None).expect_err("no poses");
    assert!(error.detail.contains("send images and not cameras"), "{error}");
    let binary = [1_u64.to_le_bytes().as_slice(), &[7; 40]].concat();
    assert!(read(&binary, None).expect_err("truncated").detail.contains("send images.bin"), "truncated");
    for empty in ["", " \n", "<a/>", "{}", "# nothing\n"] {
        assert_eq!(read(empty.as_bytes(), None).expect_err("empty").kind, ErrorKind::InvalidPoses);
    }
    let nan = "1 1 0 0 0 NaN 0 0 1 a.png\n\n";
    let error = read(nan.as_bytes(), Some(PoseFormat::ColmapText)).expect_err("not finite");
    assert!(error.detail.contains("the centre of 'a.png' is not finite"), "{error}");
}

#[test]
fn what_would_cost_much_is_refused() {
    let many = "1 1 0 0 0 0 0 0 1 a.png\n\n".repeat(MAX_VIEWS + 1);
    assert!(read(many.as_bytes(), None).expect_err("too many").detail.contains("more than 10000 views"));
    let many = format!("{{\"views\":[{}]}}", vec!["{\"viewId\":1}"; MAX_VIEWS + 1].join(","));
    assert!(read(many.as_bytes(), None).expect_err("too many").detail.contains("10000"));
    let deep = format!("<document>{}", "<a>".repeat(200_000));
    assert_eq!(read(deep.as_bytes(), None).expect_err("deep").kind, ErrorKind::InvalidPoses);
    // nested chunks must not be searched again at every level: this took minutes
    let nested = 300_000;
    let deep = format!("<document>{}{}</document>", "<chunk>".repeat(nested), "</chunk>".repeat(nested));
    assert_eq!(read(deep.as_bytes(), None).expect_err("no cameras").kind, ErrorKind::InvalidPoses);
    let entities = "<!DOCTYPE a [<!ENTITY b \"cccccc\">]><document>&b;</document>";
    assert!(read(entities.as_bytes(), None).expect_err("entities").detail.contains("XML"), "entities");
    let deep = format!("{{\"views\":{}", "[".repeat(200_000));
    assert_eq!(read(deep.as_bytes(), None).expect_err("deep").kind, ErrorKind::InvalidPoses);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_damaged_file_is_read_or_refused(format in 0..6_usize, cut in 0.0..1.0_f64, at in 0.0..1.0_f64, byte: u8) {
        let mut bytes = written(FORMATS[format], &turntable(&[0.0, 6.0], 0.1, 0.5, 12));
        let at = (at * (bytes.len() - 1) as f64) as usize;
        bytes[at] = byte;
        bytes.truncate((cut * 1.2 * bytes.len() as f64) as usize);
        for format in [None, Some(FORMATS[format])] {
            if let Ok(found) = read(&bytes, format) {
                let report = report(&found, &PoseOptions::default()).expect("a report");
                prop_assert!(!report.text().is_empty() && !report.latex().is_empty());
                prop_assert!(report.surface.is_none_or(|surface| surface.radius.is_finite()));
            }
        }
    }
}
