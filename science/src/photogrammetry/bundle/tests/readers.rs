//! Readers of the layouts with poses, each as the program reads its file.

use std::collections::HashMap;

use super::{
    super::{BundleScan, BundleView, Layout},
    HEIGHT, WIDTH,
};

/// A camera and a pose as a file has them, brought to one form.
pub(super) struct Seen {
    /// Focal length px, centre from the corner of the image px, radial coefficients.
    camera: [f64; 5],
    /// World to camera by rows, x right, y down, z forward.
    rotation: [[f64; 3]; 3],
    centre: [f64; 3],
}

impl Seen {
    pub(super) fn project(&self, point: [f64; 3]) -> [f64; 2] {
        let along = self.rotation.map(|row| (0..3).map(|k| row[k] * (point[k] - self.centre[k])).sum::<f64>());
        let [f, cx, cy, k1, k2] = self.camera;
        let (x, y) = (along[0] / along[2], along[1] / along[2]);
        let square = x * x + y * y;
        let factor = 1.0 + k1 * square + k2 * square * square;
        [cx - 0.5 + f * factor * x, cy - 0.5 + f * factor * y]
    }
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

pub(super) type Reader = fn(&HashMap<&str, &str>, &BundleScan) -> Vec<Seen>;

/// The layouts with poses, and their readers.
pub(super) const READERS: [(Layout, Reader); 6] = [
    (Layout::Colmap, colmap_reader),
    (Layout::Meshroom, meshroom_reader),
    (Layout::Metashape, metashape_reader),
    (Layout::Realitycapture, realitycapture_reader),
    (Layout::Openmvg, openmvg_reader),
    (Layout::Nerfstudio, nerfstudio_reader),
];
