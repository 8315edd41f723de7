//! OpenMVG: `sfm_data.json`, masks beside the images.

use serde_json::{Value, json};

use super::{
    entries::{Bundle, Entry, json, text},
    readme,
};

/// The first id of shared pointers in files of the library cereal, whose highest bit marks a new object.
const NEW_OBJECT: u32 = 1 << 31;

/// The files.
pub(super) fn files(bundle: &Bundle<'_>) -> Vec<Entry> {
    let mut out = vec![text("README.txt", readme(bundle))];
    // views without intrinsics cannot be reconstructed
    out.extend(bundle.camera.as_ref().map(|_| json("sfm_data.json", &sfm_data(bundle))));
    out.extend(bundle.pictures(|view| format!("images/{}_mask.png", view.stem)));
    out
}

fn sfm_data(bundle: &Bundle<'_>) -> Value {
    let scan = bundle.scan;
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
                "id_view": at, "id_intrinsic": 0, "id_pose": at
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
    out.push_str(&readme::deep_images(bundle, "OpenMVG"));
    let (scene, begin, fixed) = match bundle.camera {
        Some(camera) => {
            let refined = if camera.is_fixed() { "NONE" } else { "ADJUST_FOCAL_LENGTH" };
            out.push_str("sfm_data.json lists the images with the camera and the poses. Run in this folder:\n\n");
            let option = format!(" \\\n    --refine_intrinsic_config {refined}");
            ("sfm_data.json", String::new(), option)
        }
        None => {
            out.push_str("Run in this folder; the option -f is a guess of the focal length in px:\n\n");
            // 1.2 times the longer side, as programs assume where nothing is known
            let guess = f64::from(bundle.scan.width.max(bundle.scan.height)) * 1.2;
            let list = format!("openMVG_main_SfMInit_ImageListing -i images -o matches -f {guess:.0}\n");
            ("matches/sfm_data.json", list, String::new())
        }
    };
    out.push_str(&format!(
        "mkdir -p matches model\n\
         {begin}\
         openMVG_main_ComputeFeatures -i {scene} -o matches\n\
         openMVG_main_PairGenerator -i {scene} -o matches/pairs.bin\n\
         openMVG_main_ComputeMatches -i {scene} -p matches/pairs.bin -o matches/matches.putative.bin\n\
         openMVG_main_GeometricFilter -i {scene} -m matches/matches.putative.bin -o matches/matches.f.bin\n\
         openMVG_main_SfM -i {scene} -m matches -M matches.f.bin -o model --sfm_engine INCREMENTAL{fixed}\n"
    ));
    out
}
