//! nerfstudio: `transforms.json`, with OpenGL axes.

use serde_json::{Value, json};

use super::{
    entries::{Bundle, Entry, json, text},
    readme,
};

/// The files.
pub(super) fn files(bundle: &Bundle<'_>) -> Vec<Entry> {
    let mut out = vec![text("README.txt", readme(bundle))];
    if bundle.camera.is_some() && bundle.poses.is_some() {
        out.push(json("transforms.json", &transforms(bundle)));
    }
    out.extend(bundle.pictures(|view| format!("masks/{}.png", view.stem)));
    out
}

fn transforms(bundle: &Bundle<'_>) -> Value {
    // nerfstudio stops when some frames have a mask and others have none
    let all_have_masks = bundle.without_mask() == 0;
    let frames: Vec<Value> = bundle
        .posed()
        .map(|(view, pose)| {
            let axes = pose.upright();
            let row = |r: usize| json!([axes[(r, 0)], axes[(r, 1)], axes[(r, 2)], pose.centre[r]]);
            let mut frame = json!({
                "file_path": format!("images/{}", view.file()),
                "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
            });
            if all_have_masks {
                frame["mask_path"] = json!(format!("masks/{}.png", view.stem));
            }
            frame
        })
        .collect();
    let mut out =
        json!({ "camera_model": "OPENCV", "w": bundle.scan.width, "h": bundle.scan.height, "frames": frames });
    if let Some(camera) = &bundle.camera {
        let [cx, cy] = camera.centre_by_corner();
        for (name, value) in [
            ("fl_x", camera.focal),
            ("fl_y", camera.focal),
            ("cx", cx),
            ("cy", cy),
            ("k1", camera.radial[0]),
            ("k2", camera.radial[1]),
            ("p1", 0.0),
            ("p2", 0.0),
        ] {
            out[name] = json!(value);
        }
    }
    out
}

fn readme(bundle: &Bundle<'_>) -> String {
    let mut out = readme::begin(bundle, "nerfstudio", "masks/{name of the image}.png");
    let missing = bundle.without_mask();
    if missing > 0 && missing < bundle.scan.views.len() {
        out.push_str(&format!(
            "{} no mask. nerfstudio takes masks for all images or for none, so transforms.json names none.\n\n",
            readme::views_have(missing)
        ));
    }
    if bundle.camera.is_some_and(|camera| !camera.is_fixed()) {
        out.push_str(
            "nerfstudio does not refine the focal length. Where it is only a start, reconstruct the bundle for COLMAP first, \
             and take its cameras.\n\n",
        );
    }
    out.push_str(match bundle.camera.is_some() && bundle.poses.is_some() {
        true => "transforms.json holds the camera, the poses, and masks if all views have one. Run in this folder:\n\nns-train nerfacto --data .\n",
        false => {
            "Camera or poses are unknown, so there is no transforms.json. Run in this folder:\n\nns-process-data images \
             --data images --output-dir processed\nns-train nerfacto --data processed\n"
        }
    });
    out
}
