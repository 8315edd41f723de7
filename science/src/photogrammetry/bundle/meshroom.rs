//! Meshroom (AliceVision): an SfM file with views, locked intrinsics and poses.
//!
//! The file has version 1.0.0 of the format, which all versions read: the focal length and the principal point are in
//! px, numbers are strings, and a rotation is stored column by column.

use serde_json::{Value, json};

use super::{Bundle, Entry, json, readme, text};

/// The id of the intrinsics.
const INTRINSIC: u32 = 1;

/// The files.
pub(super) fn files(bundle: &Bundle<'_>) -> Vec<Entry> {
    let mut out = vec![text("README.txt", readme(bundle)), json("cameras.sfm", &sfm(bundle))];
    out.extend(bundle.pictures(|view| format!("masks/{}.png", view.stem)));
    out
}

fn strings(numbers: impl IntoIterator<Item = f64>) -> Vec<String> {
    numbers.into_iter().map(|number| number.to_string()).collect()
}

fn sfm(bundle: &Bundle<'_>) -> Value {
    let scan = bundle.scan;
    let (width, height) = (scan.width.to_string(), scan.height.to_string());
    let id = |at: usize| (at + 1).to_string();
    let views: Vec<Value> = scan
        .views
        .iter()
        .enumerate()
        .map(|(at, view)| {
            json!({
                "viewId": id(at), "poseId": id(at), "intrinsicId": INTRINSIC.to_string(),
                "path": format!("images/{}", view.file()), "width": width, "height": height, "metadata": {}
            })
        })
        .collect();
    let intrinsics: Vec<Value> = bundle
        .camera
        .iter()
        .map(|camera| {
            let (kind, distortion) = match camera.is_distorted() {
                true => ("radial3", strings([camera.radial[0], camera.radial[1], 0.0])),
                false => ("pinhole", Vec::new()),
            };
            json!({
                "intrinsicId": INTRINSIC.to_string(), "width": width, "height": height, "type": kind,
                "serialNumber": format!("pinstack-{}", scan.name), "initializationMode": "calibrated",
                "pxFocalLength": camera.focal.to_string(), "pxInitialFocalLength": camera.focal.to_string(),
                "principalPoint": strings(camera.centre_by_corner()), "distortionParams": distortion, "locked": "1"
            })
        })
        .collect();
    let poses: Vec<Value> = bundle
        .posed()
        .enumerate()
        .map(|(at, (_, pose))| {
            // nalgebra stores matrices column by column, too
            let rotation = strings(pose.rotation.iter().copied());
            let centre = strings(pose.centre.iter().copied());
            json!({
                "poseId": id(at),
                "pose": { "transform": { "rotation": rotation, "center": centre }, "locked": "0" }
            })
        })
        .collect();
    json!({ "version": ["1", "0", "0"], "views": views, "intrinsics": intrinsics, "poses": poses })
}

fn readme(bundle: &Bundle<'_>) -> String {
    let mut out = readme::begin(bundle, "Meshroom", "masks/{name of the image}.png");
    out.push_str(
        "cameras.sfm lists the images with the camera (locked) and the poses. Run in this folder:\n\n\
         meshroom_batch --input cameras.sfm --output mesh \\\n    --paramOverrides FeatureExtraction:masksFolder=$PWD/masks\n\n\
         Or drop images/ into Meshroom, set the folder of masks in the node FeatureExtraction (and in PrepareDenseScene), \
         and enter the focal length above in the node CameraInit.\n",
    );
    out
}
