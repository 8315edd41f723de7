//! Every layout, read back by a reader of its own: a point of the world must appear at the same pixel through the
//! camera and the pose of each file.

use std::collections::HashMap;

use super::*;
use crate::types::intrinsics::ImageDistortion;

const WIDTH: u32 = 810;
const HEIGHT: u32 = 540;

fn scan() -> BundleScan {
    let view = |pan_deg: f64, tilt_deg: f64| {
        let angles = ViewAngles { pan_deg, tilt_deg };
        BundleView {
            stem: angles.file_stem(),
            extension: "png".into(),
            bit_depth: 8,
            has_mask: true,
            angles: Some(angles),
        }
    };
    let views = [(0.0, 0.0), (20.0, 0.0), (340.0, 12.0), (130.0, -33.0)].map(|(pan, tilt)| view(pan, tilt));
    BundleScan {
        name: "bee-42".into(),
        width: WIDTH,
        height: HEIGHT,
        intrinsics: Some(Intrinsics {
            principal_distance_px: 2712.5,
            principal_distance_mm: 120.55,
            pixel_pitch_mm: 0.044_442_4,
            principal_point_px: Some([401.25, 271.75]),
            distortion: None,
        }),
        canvas_centre_px: [404.5, 269.5],
        radius_mm: Some(141.0),
        pan_is_clockwise: false,
        views: views.to_vec(),
    }
}

/// Where the point appears by the definition: [`ViewAngles`] and the intrinsics. The centre of the top-left pixel is
/// (0, 0).
fn truth(scan: &BundleScan, view: usize, point: [f64; 3]) -> [f64; 2] {
    let angles = scan.views[view].angles.expect("all have angles");
    let pan_deg = if scan.pan_is_clockwise { -angles.pan_deg } else { angles.pan_deg };
    let angles = ViewAngles { pan_deg, ..angles };
    let centre = angles.direction().map(|d| d * scan.radius_mm.unwrap_or(1.0));
    let along = angles.rotation().map(|row| (0..3).map(|k| row[k] * (point[k] - centre[k])).sum::<f64>());
    let camera = scan.intrinsics.expect("known");
    let ideal = [along[0] / along[2], along[1] / along[2]];
    let (k1, k2) = camera.distortion.map_or((0.0, 0.0), |lens| (lens.k1, lens.k2));
    let square = ideal[0] * ideal[0] + ideal[1] * ideal[1];
    let factor = 1.0 + k1 * square + k2 * square * square;
    let centre =
        camera.distortion.map(|lens| lens.centre_px).or(camera.principal_point_px).unwrap_or(scan.canvas_centre_px);
    [0, 1].map(|axis| centre[axis] + camera.principal_distance_px * factor * ideal[axis])
}

/// A camera and a pose as a file has them, brought to one form.
struct Seen {
    /// Focal length px, centre from the corner of the image px, radial coefficients.
    camera: [f64; 5],
    /// World to camera by rows, x right, y down, z forward.
    rotation: [[f64; 3]; 3],
    centre: [f64; 3],
}

impl Seen {
    fn project(&self, point: [f64; 3]) -> [f64; 2] {
        let along = self.rotation.map(|row| (0..3).map(|k| row[k] * (point[k] - self.centre[k])).sum::<f64>());
        let [f, cx, cy, k1, k2] = self.camera;
        let (x, y) = (along[0] / along[2], along[1] / along[2]);
        let square = x * x + y * y;
        let factor = 1.0 + k1 * square + k2 * square * square;
        [cx - 0.5 + f * factor * x, cy - 0.5 + f * factor * y]
    }
}

fn texts(entries: &[Entry]) -> HashMap<&str, &str> {
    entries
        .iter()
        .filter_map(|entry| match &entry.content {
            Content::Text(text) => Some((entry.path.as_str(), text.as_str())),
            _ => None,
        })
        .collect()
}

fn numbers(text: &str) -> Vec<f64> {
    text.split([' ', ',']).filter_map(|number| number.trim().parse().ok()).collect()
}

fn between<'a>(text: &'a str, from: &str, to: &str) -> &'a str {
    let start = text.find(from).unwrap_or_else(|| panic!("no {from} in {text}")) + from.len();
    &text[start..start + text[start..].find(to).expect(to)]
}

fn three(values: &[f64]) -> [f64; 3] {
    [values[0], values[1], values[2]]
}

fn by_rows(values: &[f64]) -> [[f64; 3]; 3] {
    [three(&values[0..3]), three(&values[3..6]), three(&values[6..9])]
}

fn transposed(m: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    [0, 1, 2].map(|r| [0, 1, 2].map(|c| m[c][r]))
}

/// Columns right, up, backward of the camera in the world -> world to camera.
fn of_upright(m: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let rows = transposed(m);
    [rows[0], rows[1].map(|v| -v), rows[2].map(|v| -v)]
}

fn colmap_reader(files: &HashMap<&str, &str>, scan: &BundleScan) -> Vec<Seen> {
    let line = files["sparse/0/cameras.txt"].lines().nth(1).expect("a camera");
    let values = numbers(line);
    let camera = match line.split(' ').nth(1) {
        Some("PINHOLE") => [values[3], values[5], values[6], 0.0, 0.0],
        Some("RADIAL") => [values[3], values[4], values[5], values[6], values[7]],
        other => panic!("{other:?}"),
    };
    let lines: Vec<&str> = files["sparse/0/images.txt"].lines().skip(2).step_by(2).collect();
    let of = |view: &BundleView| {
        let line = lines.iter().find(|line| line.ends_with(&view.file())).expect("its pose");
        let v = numbers(line);
        let [w, x, y, z] = [v[1], v[2], v[3], v[4]];
        let rotation = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ];
        let t = [v[5], v[6], v[7]];
        let centre = [0, 1, 2].map(|c| -(0..3).map(|r| rotation[r][c] * t[r]).sum::<f64>());
        Seen { camera, rotation, centre }
    };
    scan.views.iter().map(of).collect()
}

fn text_numbers(value: &serde_json::Value) -> Vec<f64> {
    let number = |value: &serde_json::Value| value.as_f64().or_else(|| value.as_str()?.parse().ok()).expect("a number");
    match value.as_array() {
        Some(all) => all.iter().map(number).collect(),
        None => vec![number(value)],
    }
}

/// As Meshroom 2023.3 and newer read the intrinsics: only these members, with lengths in mm and the principal point
/// relative to the middle of the image, whatever version the file has.
fn meshroom_reader(files: &HashMap<&str, &str>, scan: &BundleScan) -> Vec<Seen> {
    let sfm: serde_json::Value = serde_json::from_str(files["cameras.sfm"]).expect("JSON");
    let intrinsic = &sfm["intrinsics"][0];
    let value = |name: &str| intrinsic[name].as_str().and_then(|text| text.parse::<f64>().ok()).expect(name);
    assert_eq!((&intrinsic["type"], value("pixelRatio"), value("locked")), (&serde_json::json!("pinhole"), 1.0, 1.0));
    let pixels_per_mm = f64::from(WIDTH) / value("sensorWidth");
    assert!((f64::from(HEIGHT) / value("sensorHeight") - pixels_per_mm).abs() < 1e-9, "square pixels");
    let offset = text_numbers(&intrinsic["principalPoint"]);
    let radial = text_numbers(&intrinsic["distortionParams"]);
    let kind = if radial.is_empty() { "none" } else { "radialk3" };
    assert_eq!(intrinsic["distortionType"], kind);
    let k = |at: usize| radial.get(at).copied().unwrap_or(0.0);
    let camera = [
        value("focalLength") * pixels_per_mm,
        offset[0] + f64::from(WIDTH) / 2.0,
        offset[1] + f64::from(HEIGHT) / 2.0,
        k(0),
        k(1),
    ];
    let of = |view: &BundleView| {
        let listed = sfm["views"].as_array().expect("views").iter();
        let path = format!("images/{}", view.file());
        let entry = listed.clone().find(|listed| listed["path"] == path.as_str()).expect("the view");
        let poses = sfm["poses"].as_array().expect("poses").iter();
        let pose = poses.clone().find(|pose| pose["poseId"] == entry["poseId"]).expect("its pose");
        let transform = &pose["pose"]["transform"];
        // column by column
        let rotation = transposed(by_rows(&text_numbers(&transform["rotation"])));
        Seen { camera, rotation, centre: three(&text_numbers(&transform["center"])) }
    };
    scan.views.iter().map(of).collect()
}

fn metashape_reader(files: &HashMap<&str, &str>, scan: &BundleScan) -> Vec<Seen> {
    let xml = files["calibration.xml"];
    let value = |name: &str| numbers(between(xml, &format!("<{name}>"), "</"))[0];
    let camera = [
        value("f"),
        value("cx") + f64::from(WIDTH) / 2.0,
        value("cy") + f64::from(HEIGHT) / 2.0,
        value("k1"),
        value("k2"),
    ];
    let of = |view: &BundleView| {
        let line = files["reference.csv"].lines().find(|line| line.starts_with(&view.file())).expect("its line");
        let v = numbers(line);
        let [omega, phi, kappa] = [v[3], v[4], v[5]].map(f64::to_radians);
        let x = nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::x_axis(), omega);
        let y = nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::y_axis(), phi);
        let z = nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::z_axis(), kappa);
        let axes = (x * y * z).into_inner();
        let rows = [0, 1, 2].map(|r| [0, 1, 2].map(|c| axes[(r, c)]));
        Seen { camera, rotation: of_upright(rows), centre: three(&v) }
    };
    scan.views.iter().map(of).collect()
}

fn realitycapture_reader(files: &HashMap<&str, &str>, scan: &BundleScan) -> Vec<Seen> {
    let of = |view: &BundleView| {
        let xmp = files[format!("images/{}.xmp", view.stem).as_str()];
        let value = |name: &str| numbers(between(xmp, &format!("xcr:{name}=\""), "\""))[0];
        let side = f64::from(WIDTH);
        let radial = numbers(between(xmp, "<xcr:DistortionCoeficients>", "<"));
        let camera = [
            value("FocalLength35mm") * side / 36.0,
            value("PrincipalPointU") * side + f64::from(WIDTH) / 2.0,
            value("PrincipalPointV") * side + f64::from(HEIGHT) / 2.0,
            radial[0],
            radial[1],
        ];
        let rotation = by_rows(&numbers(between(xmp, "<xcr:Rotation>", "<")));
        Seen { camera, rotation, centre: three(&numbers(between(xmp, "<xcr:Position>", "<"))) }
    };
    scan.views.iter().map(of).collect()
}

fn openmvg_reader(files: &HashMap<&str, &str>, scan: &BundleScan) -> Vec<Seen> {
    let sfm: serde_json::Value = serde_json::from_str(files["sfm_data.json"]).expect("JSON");
    let data = &sfm["intrinsics"][0]["value"]["ptr_wrapper"]["data"];
    let centre = text_numbers(&data["principal_point"]);
    let radial = data.get("disto_k3").map(text_numbers).unwrap_or_else(|| vec![0.0; 3]);
    // OpenMVG counts from the centre of the top-left pixel
    let camera = [text_numbers(&data["focal_length"])[0], centre[0] + 0.5, centre[1] + 0.5, radial[0], radial[1]];
    let of = |view: &BundleView| {
        let mut views = sfm["views"].as_array().expect("views").iter();
        let data = |entry: &serde_json::Value| entry["value"]["ptr_wrapper"]["data"].clone();
        let listed = views.find(|entry| data(entry)["filename"] == view.file().as_str()).map(data).expect("the view");
        let mut poses = sfm["extrinsics"].as_array().expect("poses").iter();
        let pose = &poses.find(|pose| pose["key"] == listed["id_pose"]).expect("its pose")["value"];
        let rows: Vec<f64> = pose["rotation"].as_array().expect("rows").iter().flat_map(text_numbers).collect();
        Seen { camera, rotation: by_rows(&rows), centre: three(&text_numbers(&pose["center"])) }
    };
    scan.views.iter().map(of).collect()
}

fn nerfstudio_reader(files: &HashMap<&str, &str>, scan: &BundleScan) -> Vec<Seen> {
    let transforms: serde_json::Value = serde_json::from_str(files["transforms.json"]).expect("JSON");
    let value = |name: &str| transforms[name].as_f64().expect(name);
    let camera = [value("fl_x"), value("cx"), value("cy"), value("k1"), value("k2")];
    let of = |view: &BundleView| {
        let mut frames = transforms["frames"].as_array().expect("frames").iter();
        let path = format!("images/{}", view.file());
        let frame = frames.find(|frame| frame["file_path"] == path.as_str()).expect("the frame");
        let rows: Vec<Vec<f64>> =
            frame["transform_matrix"].as_array().expect("rows").iter().map(text_numbers).collect();
        let axes = [0, 1, 2].map(|r| three(&rows[r]));
        Seen { camera, rotation: of_upright(axes), centre: [0, 1, 2].map(|r| rows[r][3]) }
    };
    scan.views.iter().map(of).collect()
}

type Reader = fn(&HashMap<&str, &str>, &BundleScan) -> Vec<Seen>;

/// The layouts with poses, and their readers.
const READERS: [(Layout, Reader); 6] = [
    (Layout::Colmap, colmap_reader),
    (Layout::Meshroom, meshroom_reader),
    (Layout::Metashape, metashape_reader),
    (Layout::Realitycapture, realitycapture_reader),
    (Layout::Openmvg, openmvg_reader),
    (Layout::Nerfstudio, nerfstudio_reader),
];

#[test]
fn a_point_of_the_world_appears_at_the_same_pixel_in_every_layout() {
    let lens = ImageDistortion { k1: -0.8, k2: 12.0, centre_px: [399.0, 268.5] };
    let distorted = |scan: BundleScan| {
        let intrinsics = scan.intrinsics.map(|camera| Intrinsics { distortion: Some(lens), ..camera });
        BundleScan { intrinsics, ..scan }
    };
    let unknown_centre = |scan: BundleScan| {
        let intrinsics = scan.intrinsics.map(|camera| Intrinsics { principal_point_px: None, ..camera });
        BundleScan { intrinsics, radius_mm: None, ..scan }
    };
    let clockwise = BundleScan { pan_is_clockwise: true, ..scan() };
    for scan in [scan(), clockwise, distorted(scan()), unknown_centre(scan())] {
        let reach = scan.radius_mm.unwrap_or(1.0) / 20.0;
        for (layout, reader) in READERS {
            let entries = plan(layout, &scan).expect("a bundle");
            let seen = reader(&texts(&entries), &scan);
            for (at, seen) in seen.iter().enumerate() {
                for point in [[0.0; 3], [1.0, 0.3, -0.5], [-0.2, 0.9, 0.7]].map(|p: [f64; 3]| p.map(|v| v * reach)) {
                    let (found, expected) = (seen.project(point), truth(&scan, at, point));
                    let off = (found[0] - expected[0]).hypot(found[1] - expected[1]);
                    assert!(off < 1e-6, "{layout:?} view {at}: {found:?} instead of {expected:?}");
                }
            }
        }
    }
}

#[test]
fn images_that_the_program_cannot_open_are_told() {
    let mut scan = scan();
    let told = |scan: &BundleScan, layout| {
        let entries = plan(layout, scan).expect("a bundle");
        texts(&entries)["README.txt"].contains("cannot open")
    };
    assert!(Layout::ALL.into_iter().all(|layout| !told(&scan, layout)), "images of 8 bits suit all programs");
    scan.views[2].bit_depth = 16;
    let cannot: Vec<Layout> = Layout::ALL.into_iter().filter(|layout| told(&scan, *layout)).collect();
    assert_eq!(cannot, [Layout::Colmap, Layout::Openmvg]);
    let entries = plan(Layout::Colmap, &scan).expect("a bundle");
    let readme = texts(&entries)["README.txt"];
    assert!(readme.contains("1 view has 16 bits per sample") && readme.contains("{\"bit_depth\": 8}"), "{readme}");
}

#[test]
fn images_and_masks_have_the_names_that_each_program_looks_for() {
    let mut scan = scan();
    scan.views[3].has_mask = false;
    for (layout, mask) in [
        (Layout::Colmap, "masks/pan000_tilt00.png.png"),
        (Layout::Meshroom, "masks/pan000_tilt00.png"),
        (Layout::Metashape, "masks/pan000_tilt00_mask.png"),
        (Layout::Realitycapture, "images/pan000_tilt00.png.mask.png"),
        (Layout::Odm, "images/pan000_tilt00_mask.png"),
        (Layout::Openmvg, "images/pan000_tilt00_mask.png"),
        (Layout::Nerfstudio, "masks/pan000_tilt00.png"),
    ] {
        let entries = plan(layout, &scan).expect("a bundle");
        let content = |path: &str| entries.iter().find(|entry| entry.path == path).map(|entry| entry.content.clone());
        assert_eq!(content("images/pan000_tilt00.png"), Some(Content::Image(0)), "{layout:?}");
        assert_eq!(content(mask), Some(Content::Mask(0)), "{layout:?}");
        let masks = entries.iter().filter(|entry| matches!(entry.content, Content::Mask(_)));
        assert_eq!(masks.count(), 3, "{layout:?}");
        let mut paths: Vec<&str> = entries.iter().map(|entry| entry.path.as_str()).collect();
        assert_eq!(paths[0], "README.txt");
        assert!(paths.iter().all(|path| !["ps_", "hdr_", "rig"].iter().any(|bad| path.starts_with(bad))));
        paths.sort_unstable();
        paths.dedup();
        assert_eq!(paths.len(), entries.len(), "{layout:?}: names are unique");
    }
}

#[test]
fn the_camera_of_opendronemap_is_relative_to_the_longer_side_and_for_all_images() {
    let entries = plan(Layout::Odm, &scan()).expect("a bundle");
    let files = texts(&entries);
    // --cameras refuses ids that are not those of the images' EXIF; OpenSfM knows `all`
    assert!(!files.contains_key("cameras.json") && !files["README.txt"].contains("--cameras"));
    let cameras = files["opensfm/camera_models_overrides.json"];
    let cameras: serde_json::Value = serde_json::from_str(cameras).expect("JSON");
    assert_eq!(cameras["all"]["projection_type"], "brown");
    let value = |name: &str| cameras["all"][name].as_f64().expect(name) * f64::from(WIDTH);
    assert!((value("focal_x") - 2712.5).abs() < 1e-9);
    assert!((value("c_x") - (401.25 + 0.5 - 405.0)).abs() < 1e-9);
    assert!((value("c_y") - (271.75 + 0.5 - 270.0)).abs() < 1e-9);
}

#[test]
fn colmap_gets_its_camera_its_pairs_and_ids_by_name() {
    let mut scan = scan();
    scan.views.swap(0, 3);
    let entries = plan(Layout::Colmap, &scan).expect("a bundle");
    let files = texts(&entries);
    let readme = files["README.txt"];
    assert!(
        readme.contains("--ImageReader.camera_model PINHOLE --ImageReader.camera_params 2712.5,2712.5,401.75,272.25")
    );
    assert!(
        readme.contains("--ImageReader.mask_path masks") && readme.contains("ba_refine_focal_length 0"),
        "{readme}"
    );
    let names: Vec<&str> =
        files["sparse/0/images.txt"].lines().skip(2).step_by(2).filter_map(|line| line.rsplit(' ').next()).collect();
    let mut sorted = names.clone();
    sorted.sort_unstable();
    assert_eq!(names, sorted, "ids go by name");
    assert_eq!(files["pairs.txt"].lines().count(), 6, "each of four with each");
}

#[test]
fn what_is_unknown_is_left_out_and_said() {
    let mut scan = scan();
    scan.intrinsics = None;
    scan.views[2].angles = None;
    for layout in Layout::ALL {
        let entries = plan(layout, &scan).expect("a bundle");
        let files = texts(&entries);
        assert!(files["README.txt"].contains("Camera: unknown") && files["README.txt"].contains("Poses: none"));
        let left_out = [
            "sparse/0/cameras.txt",
            "pairs.txt",
            "calibration.xml",
            "transforms.json",
            "sfm_data.json",
            "opensfm/camera_models_overrides.json",
        ];
        assert!(left_out.iter().all(|path| !files.contains_key(path)), "{layout:?}");
    }
    let empty = BundleScan { views: Vec::new(), ..scan };
    assert!(plan(Layout::Colmap, &empty).is_err());
}

#[test]
fn nerfstudio_gets_masks_for_all_frames_or_for_none() {
    let mut scan = scan();
    let frames_with_mask = |scan: &BundleScan| {
        let entries = plan(Layout::Nerfstudio, scan).expect("a bundle");
        let transforms: serde_json::Value = serde_json::from_str(texts(&entries)["transforms.json"]).expect("JSON");
        let frames = transforms["frames"].as_array().expect("frames");
        frames.iter().filter(|frame| frame.get("mask_path").is_some()).count()
    };
    assert_eq!(frames_with_mask(&scan), 4);
    scan.views[2].has_mask = false;
    assert_eq!(frames_with_mask(&scan), 0, "nerfstudio stops when some frames have none");
    for layout in [Layout::Nerfstudio, Layout::Colmap] {
        let entries = plan(layout, &scan).expect("a bundle");
        assert!(texts(&entries)["README.txt"].contains("1 view has no mask"), "{layout:?}");
    }
}

#[test]
fn a_readme_tells_of_masks_only_if_there_are_some() {
    let readme = |layout, change: fn(&mut BundleScan)| {
        let mut scan = scan();
        change(&mut scan);
        let entries = plan(layout, &scan).expect("a bundle");
        texts(&entries)["README.txt"].to_owned()
    };
    let bare = |scan: &mut BundleScan| scan.views.iter_mut().for_each(|view| view.has_mask = false);
    let blind = |scan: &mut BundleScan| {
        scan.views.iter_mut().for_each(|view| view.has_mask = false);
        scan.intrinsics = None;
    };
    for layout in [Layout::Metashape, Layout::Meshroom] {
        let whole = readme(layout, |scan| scan.views[1].has_mask = false);
        let word = if layout == Layout::Metashape { "Import Masks" } else { "masksFolder=" };
        assert!(whole.contains(word), "{whole}");
        for change in [bare as fn(&mut BundleScan), blind] {
            let text = readme(layout, change);
            assert!(text.contains("There are no masks"), "{text}");
            assert!(["Import Masks", "Apply masks", "masksFolder"].iter().all(|word| !text.contains(word)), "{text}");
        }
    }
    let steps =
        |text: &str| text.lines().filter_map(|line| line.split_once(". ")?.0.parse().ok()).collect::<Vec<u32>>();
    assert_eq!(steps(&readme(Layout::Metashape, |_| {})), [1, 2, 3, 4, 5]);
    assert_eq!(steps(&readme(Layout::Metashape, bare)), [1, 2, 3, 4]);
    assert_eq!(steps(&readme(Layout::Metashape, blind)), [1, 2, 3]);
    assert!(readme(Layout::Meshroom, bare).contains("--output mesh\n\nThe node CameraInit"));
}

#[test]
fn an_image_that_would_be_taken_for_a_mask_is_refused() {
    let mut scan = scan();
    scan.views[0].stem = "head".into();
    for stem in ["head_mask", "Head_Mask", "mask"] {
        scan.views[1].stem = stem.into();
        for layout in Layout::ALL {
            let planned = plan(layout, &scan);
            match layout {
                Layout::Odm | Layout::Openmvg => {
                    let error = planned.expect_err("refused").to_string();
                    assert!(error.contains(stem) && error.contains(layout.name()), "{error}");
                }
                _ => assert!(planned.is_ok(), "{layout:?}"),
            }
        }
    }
}

#[test]
fn without_a_camera_openmvg_lists_the_images_itself() {
    let scan = BundleScan { intrinsics: None, ..scan() };
    let entries = plan(Layout::Openmvg, &scan).expect("a bundle");
    let readme = texts(&entries)["README.txt"];
    assert!(readme.contains("openMVG_main_SfMInit_ImageListing -i images -o matches -f 972\n"), "{readme}");
    assert!(readme.contains("-i matches/sfm_data.json") && !readme.contains("refine_intrinsic_config"), "{readme}");
}
