//! Meshroom (AliceVision): an SfM file with views, intrinsics and poses. The intrinsics are locked if the focal length
//! is known well.
//!
//! The file has version 1.2.8 of the format. Numbers are strings, and a rotation is stored column by column. The node
//! CameraInit of Meshroom ignores the version and the poses, and copies the members of views and intrinsics that it
//! knows: since Meshroom 2023 the focal length in mm, the size of the sensor, and the principal point in px relative to
//! the middle of the image. A view with an `intrinsicId` counts as complete, and its EXIF is not read; so there is no
//! file without a camera.

use serde_json::{Value, json};

use super::{
    entries::{Bundle, Entry, json, text},
    readme,
};

/// The id of the intrinsics.
const INTRINSIC: u32 = 1;

/// The files.
pub(super) fn files(bundle: &Bundle<'_>) -> Vec<Entry> {
    let mut out = vec![text("README.txt", readme(bundle))];
    out.extend(bundle.camera.as_ref().map(|_| json("cameras.sfm", &sfm(bundle))));
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
                true => ("radialk3", strings([camera.radial[0], camera.radial[1], 0.0])),
                false => ("none", Vec::new()),
            };
            let focal = (camera.focal * camera.pixel_mm).to_string();
            let [mode, locked] = if camera.is_fixed() { ["calibrated", "1"] } else { ["estimated", "0"] };
            let sensor = camera.size.map(|side| (side * camera.pixel_mm).to_string());
            json!({
                "intrinsicId": INTRINSIC.to_string(), "width": width, "height": height,
                "sensorWidth": sensor[0], "sensorHeight": sensor[1],
                "serialNumber": format!("pinstack-{}", scan.name), "type": "pinhole",
                "initializationMode": mode, "focalLength": focal, "initialFocalLength": focal,
                "pixelRatio": "1", "pixelRatioLocked": "1", "principalPoint": strings(camera.centre_by_middle()),
                "distortionType": kind, "distortionInitializationMode": "calibrated",
                "distortionParams": distortion, "undistortionType": "none", "undistortionParams": [],
                "undistortionOffset": ["0", "0"], "scaleLocked": locked, "offsetLocked": "1", "distortionLocked": "1",
                "locked": locked
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
    json!({ "version": ["1", "2", "8"], "views": views, "intrinsics": intrinsics, "poses": poses })
}

fn readme(bundle: &Bundle<'_>) -> String {
    let mut out = readme::begin(bundle, "Meshroom", "masks/{name of the image}.png");
    let masks = match bundle.has_masks() {
        true => " \\\n    --paramOverrides FeatureExtraction:masksFolder=$PWD/masks",
        false => "",
    };
    let Some(camera) = &bundle.camera else {
        out.push_str(&format!("Run in this folder:\n\nmeshroom_batch --input images --output mesh{masks}\n"));
        return out;
    };
    let dense = match bundle.has_masks() {
        true => "Set masksFolders of the node PrepareDenseScene to the same folder, to mask the depth maps. ",
        false => "",
    };
    let version = if camera.is_distorted() { "2025.1 (2023.3 does not read the distortion)" } else { "2023.3" };
    let locked = if camera.is_fixed() { "locked" } else { "its focal length free" };
    out.push_str(&format!(
        "cameras.sfm lists the images with the camera, {locked}. It is for Meshroom {version} or newer. Meshroom needs \
         absolute paths; run in this folder:\n\nsed -i \"s|\\\"images/|\\\"$PWD/images/|\" cameras.sfm\n\
         meshroom_batch --input cameras.sfm --output mesh{masks}\n\n{dense}The node CameraInit takes no poses: those \
         of cameras.sfm are for the programs of AliceVision.\n\nFor images without cameras.sfm, the sensor is {} mm \
         wide.\n",
        camera.size[0] * camera.pixel_mm
    ));
    out
}
