//! OpenDroneMap: the camera of OpenSfM, masks beside the images.

use serde_json::{Value, json};

use super::{Bundle, Entry, camera::Camera, json, readme, text};

/// The files.
pub(super) fn files(bundle: &Bundle<'_>) -> Vec<Entry> {
    let mut out = vec![text("README.txt", readme(bundle))];
    out.extend(bundle.camera.as_ref().map(|camera| json("cameras.json", &cameras(camera))));
    out.extend(bundle.pictures(|view| format!("images/{}_mask.png", view.stem)));
    out
}

/// Lengths are in units of the longer side; the principal point is relative to the middle. The key `all` stands for the
/// camera of every image.
fn cameras(camera: &Camera) -> Value {
    let side = camera.longer_side();
    let [cx, cy] = camera.centre_by_middle().map(|offset| offset / side);
    let [k1, k2] = camera.radial;
    json!({ "all": {
        "projection_type": "brown", "width": camera.size[0], "height": camera.size[1],
        "focal_x": camera.focal / side, "focal_y": camera.focal / side, "c_x": cx, "c_y": cy,
        "k1": k1, "k2": k2, "p1": 0.0, "p2": 0.0, "k3": 0.0
    } })
}

fn readme(bundle: &Bundle<'_>) -> String {
    let mut out = readme::begin(bundle, "OpenDroneMap", "images/{name of the image}_mask.png");
    let camera =
        if bundle.camera.is_some() { " --cameras /datasets/scan/cameras.json --use-fixed-camera-params" } else { "" };
    out.push_str(&format!(
        "ODM reads positions on the earth only, so the poses are not in this bundle. Run in the folder above this one, which \
         is called scan:\n\ndocker run -ti --rm -v \"$PWD:/datasets\" opendronemap/odm --project-path /datasets \
         scan{camera}\n"
    ));
    out
}
