//! Agisoft Metashape: a calibration as XML, positions and angles as CSV.

use std::fmt::Write;

use super::{
    camera::Camera,
    entries::{Bundle, Entry, text},
    readme,
};

/// The files.
pub(super) fn files(bundle: &Bundle<'_>) -> Vec<Entry> {
    let mut out = vec![text("README.txt", readme(bundle))];
    out.extend(bundle.camera.as_ref().map(|camera| text("calibration.xml", calibration(camera))));
    if bundle.poses.is_some() {
        out.push(text("reference.csv", reference(bundle)));
    }
    out.extend(bundle.pictures(|view| format!("masks/{}_mask.png", view.stem)));
    out
}

/// The principal point is relative to the middle of the image.
fn calibration(camera: &Camera) -> String {
    let [width, height] = camera.size;
    let [cx, cy] = camera.centre_by_middle();
    let [k1, k2] = camera.radial;
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<calibration>\n  <projection>frame</projection>\n  \
         <width>{width}</width>\n  <height>{height}</height>\n  <f>{}</f>\n  <cx>{cx}</cx>\n  <cy>{cy}</cy>\n  \
         <k1>{k1}</k1>\n  <k2>{k2}</k2>\n</calibration>\n",
        camera.focal
    )
}

fn reference(bundle: &Bundle<'_>) -> String {
    let mut out = "label,x,y,z,omega,phi,kappa\n".to_owned();
    for (view, pose) in bundle.posed() {
        let [x, y, z] = pose.centre.into();
        let [omega, phi, kappa] = pose.omega_phi_kappa();
        // writing to a String cannot fail
        let _ = writeln!(out, "{},{x},{y},{z},{omega},{phi},{kappa}", view.file());
    }
    out
}

fn readme(bundle: &Bundle<'_>) -> String {
    let mut out = readme::begin(bundle, "Agisoft Metashape", "masks/{name of the image}_mask.png");
    let mut steps = vec!["Workflow > Add Photos: all files of images/."];
    if bundle.has_masks() {
        steps.push("File > Import > Import Masks: method \"From File\", template {filename}_mask.png, folder masks/.");
    }
    if let Some(camera) = &bundle.camera {
        steps.push(match camera.is_fixed() {
            true => {
                "Tools > Camera Calibration: type Precalibrated, load calibration.xml, and fix all parameters under Fixed \
                 parameters."
            }
            false => {
                "Tools > Camera Calibration: type Precalibrated, load calibration.xml, and under Fixed parameters fix all but \
                 f, so that the alignment refines it."
            }
        });
    }
    if bundle.poses.is_some() {
        steps.push(
            "Reference pane > Import: reference.csv, local coordinates, columns label, x, y, z, omega, phi, kappa.",
        );
    }
    steps.push(match bundle.has_masks() {
        true => "Workflow > Align Photos, with \"Apply masks to: Key points\".",
        false => "Workflow > Align Photos.",
    });
    for (at, step) in steps.iter().enumerate() {
        // writing to a String cannot fail
        let _ = writeln!(out, "{}. {step}", at + 1);
    }
    out
}
