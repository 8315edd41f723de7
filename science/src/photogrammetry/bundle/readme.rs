//! What the README of every bundle says.

use super::{camera::Camera, entries::Bundle};

/// The beginning of the README: what the bundle holds, the camera, the poses.
pub(super) fn begin(bundle: &Bundle<'_>, program: &str, masks: &str) -> String {
    let scan = bundle.scan;
    let with_mask = scan.views.iter().filter(|view| view.has_mask).count();
    let mut out = format!(
        "Scan {name} for {program}\n\n{views} views of {width} x {height} px in images/. {masks}\n\n",
        name = scan.name,
        views = scan.views.len(),
        width = scan.width,
        height = scan.height,
        masks = match with_mask {
            0 => "There are no masks: the stacks had no back light.".to_owned(),
            n => format!("Masks: {masks}; white is the object, black is to be ignored ({n} views have one)."),
        },
    );
    out.push_str(&camera(bundle));
    out.push_str(&poses(bundle));
    out
}

fn camera(bundle: &Bundle<'_>) -> String {
    let Some(camera) = &bundle.camera else {
        return "Camera: unknown. The calibration profile lacks the principal distance or the pixel pitch, so the program \
                has to estimate the focal length. At the narrow field of view of macro photography that is uncertain. The \
                report of the calibration says what would make it known; then fuse the scan again.\n\n"
            .to_owned();
    };
    let [cx, cy] = camera.centre_by_corner();
    let centre = match camera.centre_is_known {
        true => "measured".to_owned(),
        false => "assumed: the centre of the uncropped image, because it was not measured".to_owned(),
    };
    let distortion = match camera.is_distorted() {
        true => format!("Radial distortion k1 = {:.8}, k2 = {:.8} (OpenCV).\n", camera.radial[0], camera.radial[1]),
        false => "No lens distortion.\n".to_owned(),
    };
    format!(
        "Camera: one for all views. Focal length {:.4} px ({:.4} mm at {:.6} mm per pixel): this is the principal distance of \
         the pinhole camera, f (1 + M / P) with the pupil ratio P of the lens, and not the focal length f engraved on it. \
         Principal point ({cx:.3}, {cy:.3}) px from the corner of the image ({centre}). {distortion}{}\n\n",
        camera.focal,
        camera.focal_mm,
        camera.pixel_mm,
        certainty(camera)
    )
}

/// How certain the focal length is, and so whether the program may change it.
fn certainty(camera: &Camera) -> String {
    match camera.sigma {
        Some(sigma) if camera.is_fixed() => format!(
            "The focal length is known to {:.2} %. Keep these values fixed: a free focal length drifts by more than that at \
             such a narrow field of view.",
            100.0 * sigma
        ),
        Some(sigma) => format!(
            "The focal length is known to {:.0} % only, so it is a start: let the program refine it, and keep the others \
             fixed. The report of the calibration says how to measure it.",
            (100.0 * sigma).ceil()
        ),
        None => "How well the focal length is known is not stated in the profile, so it is a start: let the program refine it, \
                 and keep the others fixed. A calibration, or principal_distance_sigma_mm of the profile, states it."
            .to_owned(),
    }
}

fn poses(bundle: &Bundle<'_>) -> String {
    if bundle.poses.is_none() {
        return "Poses: none, because pan or tilt of some views is unknown.\n\n".to_owned();
    }
    let scale = match bundle.scan.radius_mm {
        Some(radius) => format!("The cameras are {radius} mm from the point where the axes of pan and tilt meet."),
        None => {
            "The distance of the cameras from the axes is unknown and set to 1, so lengths have no unit; set radius_mm \
                 of the scan."
                .to_owned()
        }
    };
    format!(
        "Poses: from the commanded pan and tilt. z is the axis of the turntable, upwards; at pan 0 and tilt 0 the camera is \
         on the x axis and looks at the origin. {scale} They are as exact as the turntable and its alignment with the \
         camera: use them as a start or a check, and let the program refine them.\n\n"
    )
}

/// A paragraph for a program that cannot open images of 16 bits per sample, if there are any. `program`: the beginning
/// of the sentence `COLMAP 3 cannot open such images`.
pub(super) fn deep_images(bundle: &Bundle<'_>, program: &str) -> String {
    let scan = bundle.scan;
    let deep = scan.views.iter().filter(|view| view.bit_depth > 8).count();
    if deep == 0 {
        return String::new();
    }
    format!(
        "{} 16 bits per sample. {program} cannot open such images: fuse the scan again with 8 bits (POST \
         /v1/scans/{}/rerun with {{\"bit_depth\": 8}}).\n\n",
        views_have(deep),
        scan.name
    )
}

/// The beginning of a sentence: `1 view has`, `2 views have`.
pub(super) fn views_have(count: usize) -> String {
    if count == 1 { "1 view has".to_owned() } else { format!("{count} views have") }
}
