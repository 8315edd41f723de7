//! OpenDroneMap: the camera of OpenSfM, masks beside the images.
//!
//! The option `--cameras` of ODM takes only cameras with the ids that ODM makes from the EXIF of the images. OpenSfM,
//! which ODM runs in the folder `opensfm`, reads overrides there that can be for all images.

use serde_json::{Value, json};

use super::{
    camera::Camera,
    entries::{Bundle, Entry, json, text},
    readme,
};

/// The files.
pub(super) fn files(bundle: &Bundle<'_>) -> Vec<Entry> {
    let mut out = vec![text("README.txt", readme(bundle))];
    out.extend(bundle.camera.as_ref().map(|camera| json("opensfm/camera_models_overrides.json", &cameras(camera))));
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
    let (camera, fixed) = match bundle.camera {
        Some(camera) => (
            "The camera is in opensfm/camera_models_overrides.json, where ODM finds it without an option; do not run with \
             --rerun-all, which deletes that folder. ",
            if camera.is_fixed() { " --use-fixed-camera-params" } else { "" },
        ),
        None => ("", ""),
    };
    out.push_str(&format!(
        "{camera}ODM reads positions on the earth only, so the poses are not in this bundle. Run in the folder above this \
         one, which is called scan:\n\ndocker run -ti --rm -v \"$PWD:/datasets\" opendronemap/odm --project-path /datasets \
         scan{fixed}\n"
    ));
    out
}
