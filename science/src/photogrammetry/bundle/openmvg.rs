//! OpenMVG: `sfm_data.json`, masks beside the images.

use serde_json::{Value, json};

use super::{Bundle, Entry, json, readme, text};

/// The first id of shared pointers in files of the library cereal, whose highest bit marks a new object.
const NEW_OBJECT: u32 = 1 << 31;

/// The files.
pub(super) fn files(bundle: &Bundle<'_>) -> Vec<Entry> {
    let mut out = vec![text("README.txt", readme(bundle)), json("sfm_data.json", &sfm_data(bundle))];
    out.extend(bundle.pictures(|view| format!("images/{}_mask.png", view.stem)));
    out
}

fn sfm_data(bundle: &Bundle<'_>) -> Value {
    let scan = bundle.scan;
    let has_camera = bundle.camera.is_some();
    let mut next = NEW_OBJECT;
    let mut id = || {
        next += 1;
        next
    };
    let views: Vec<Value> = scan
        .views
        .iter()
        .enumerate()
        .map(|(at, view)| {
            json!({ "key": at, "value": { "polymorphic_id": 1 << 30, "ptr_wrapper": { "id": id(), "data": {
                "local_path": "", "filename": view.file(), "width": scan.width, "height": scan.height,
                "id_view": at, "id_intrinsic": if has_camera { 0 } else { u32::MAX }, "id_pose": at
            } } } })
        })
        .collect();
    let intrinsics: Vec<Value> = bundle
        .camera
        .iter()
        .map(|camera| {
            let mut data = json!({
                "width": scan.width, "height": scan.height, "focal_length": camera.focal, "principal_point": camera.centre
            });
            let name = match camera.is_distorted() {
                true => {
                    data["disto_k3"] = json!([camera.radial[0], camera.radial[1], 0.0]);
                    "pinhole_radial_k3"
                }
                false => "pinhole",
            };
            json!({ "key": 0, "value": {
                "polymorphic_id": NEW_OBJECT | 1, "polymorphic_name": name, "ptr_wrapper": { "id": id(), "data": data }
            } })
        })
        .collect();
    let extrinsics: Vec<Value> = bundle
        .posed()
        .enumerate()
        .map(|(at, (_, pose))| {
            let rows: Vec<Vec<f64>> = pose.rotation.row_iter().map(|row| row.iter().copied().collect()).collect();
            let centre: Vec<f64> = pose.centre.iter().copied().collect();
            json!({ "key": at, "value": { "rotation": rows, "center": centre } })
        })
        .collect();
    json!({
        "sfm_data_version": "0.3", "root_path": "images", "views": views, "intrinsics": intrinsics,
        "extrinsics": extrinsics, "structure": [], "control_points": []
    })
}

fn readme(bundle: &Bundle<'_>) -> String {
    let mut out = readme::begin(bundle, "OpenMVG", "images/{name of the image}_mask.png");
    out.push_str(
        "sfm_data.json lists the images with the camera and the poses. Run in this folder:\n\n\
         mkdir -p matches model\n\
         openMVG_main_ComputeFeatures -i sfm_data.json -o matches\n\
         openMVG_main_PairGenerator -i sfm_data.json -o matches/pairs.bin\n\
         openMVG_main_ComputeMatches -i sfm_data.json -p matches/pairs.bin -o matches/matches.putative.bin\n\
         openMVG_main_GeometricFilter -i sfm_data.json -m matches/matches.putative.bin -o matches/matches.f.bin\n\
         openMVG_main_SfM -i sfm_data.json -m matches -M matches.f.bin -o model --sfm_engine INCREMENTAL \
         --refine_intrinsic_config NONE\n",
    );
    out
}
