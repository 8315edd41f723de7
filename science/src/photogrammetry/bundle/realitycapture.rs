//! RealityCapture: an XMP sidecar and a mask beside each image.

use super::{
    camera::Camera,
    entries::{Bundle, Entry, text},
    pose::Pose,
    readme,
};

/// The files.
pub(super) fn files(bundle: &Bundle<'_>) -> Vec<Entry> {
    let mut out = vec![text("README.txt", readme(bundle))];
    if let Some(camera) = &bundle.camera {
        for (at, view) in bundle.scan.views.iter().enumerate() {
            let pose = bundle.poses.as_ref().and_then(|poses| poses.get(at));
            out.push(text(&format!("images/{}.xmp", view.stem), sidecar(camera, pose)));
        }
    }
    out.extend(bundle.pictures(|view| format!("images/{}.mask.png", view.file())));
    out
}

fn joined(numbers: impl IntoIterator<Item = f64>) -> String {
    numbers.into_iter().map(|number| number.to_string()).collect::<Vec<_>>().join(" ")
}

/// The focal length is for a picture 36 mm wide on its longer side; the principal point is relative to the middle, in
/// units of that side.
fn sidecar(camera: &Camera, pose: Option<&Pose>) -> String {
    let side = camera.longer_side();
    let [u, v] = camera.centre_by_middle().map(|offset| offset / side);
    let prior = if pose.is_some() { " xcr:PosePrior=\"initial\" xcr:Coordinates=\"absolute\"" } else { "" };
    let placed = pose.map_or(String::new(), |pose| {
        format!(
            "   <xcr:Rotation>{}</xcr:Rotation>\n   <xcr:Position>{}</xcr:Position>\n",
            // by rows
            joined(pose.rotation.transpose().iter().copied()),
            joined(pose.centre.iter().copied())
        )
    });
    let [k1, k2] = camera.radial;
    // RealityCapture refines an initial prior, and keeps an exact one
    let certainty = if camera.is_fixed() { "exact" } else { "initial" };
    format!(
        "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\">\n <rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\">\n  \
         <rdf:Description xmlns:xcr=\"http://www.capturingreality.com/ns/xcr/1.1#\" xcr:Version=\"3\"{prior} \
         xcr:DistortionModel=\"brown3\" xcr:FocalLength35mm=\"{}\" xcr:Skew=\"0\" xcr:AspectRatio=\"1\" \
         xcr:PrincipalPointU=\"{u}\" xcr:PrincipalPointV=\"{v}\" xcr:CalibrationPrior=\"{certainty}\" \
         xcr:CalibrationGroup=\"1\" xcr:DistortionGroup=\"1\">\n{placed}   \
         <xcr:DistortionCoeficients>{k1} {k2} 0 0 0 0</xcr:DistortionCoeficients>\n  </rdf:Description>\n </rdf:RDF>\n\
         </x:xmpmeta>\n",
        camera.focal * 36.0 / side
    )
}

fn readme(bundle: &Bundle<'_>) -> String {
    let mut out = readme::begin(bundle, "RealityCapture", "images/{image}.mask.png");
    out.push_str(
        "Workflow > Inputs > Folder: images/. Masks and XMP sidecars beside the images are read with them. The sidecars \
         hold the camera (one group for all views) as an exact prior if it is to be kept, otherwise as an initial one, and \
         the poses as initial ones.\n",
    );
    out
}
