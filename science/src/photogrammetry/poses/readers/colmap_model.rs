//! The views of a COLMAP model with their whole cameras: `images` and `cameras`, as text or binary.
//!
//! <https://colmap.github.io/format.html>

use std::collections::HashMap;

use super::{
    colmap_binary,
    colmap_cameras::{self, Record},
    colmap_text,
    found::{Found, shown},
    text,
};
use crate::{
    photogrammetry::poses::{MAX_FOCAL_PX, invalid},
    types::{Error, pinhole::PinholeCamera},
};

/// Largest side of a picture, px: that of a JPEG.
const MAX_SIDE: u64 = 65_535;

/// The name and the camera of each registered view, in the order of the file. `images` and `cameras` are each a file
/// with its name; one that ends in `.bin` is binary.
///
/// # Errors
/// [`crate::types::error::ErrorKind::InvalidPoses`], with the line or the camera: a damaged file, a view without a
/// camera, a camera with a distortion other than radial or with impossible numbers, and a model without views.
pub fn colmap_views(images: (&str, &[u8]), cameras: (&str, &[u8])) -> Result<Vec<(String, PinholeCamera)>, Error> {
    let mut found = Found::default();
    match images.0.ends_with(".bin") {
        true => colmap_binary::read(images.1, &mut found)?,
        false => colmap_text::read(text(images.1)?, &mut found)?,
    }
    let records = colmap_cameras::records(cameras.0, cameras.1, |_| true)?;
    let records: HashMap<String, Record> = records.into_iter().map(|record| (record.id.to_string(), record)).collect();
    if found.poses.is_empty() {
        return Err(invalid(format!("{} has no view with a pose; reconstruct the scan first", images.0)));
    }
    let view = |(pose, id): (super::super::Pose, String)| {
        let record = records.get(&id).ok_or_else(|| {
            let name = shown(&pose.name);
            invalid(format!(
                "{}: camera {id} of '{name}' is not in {}; take both files from one model",
                images.0, cameras.0
            ))
        })?;
        let rotation = pose.rotation.unwrap_or_default();
        let camera = camera(record).map_err(|what| invalid(format!("{}: camera {id} {what}", cameras.0)))?;
        Ok((pose.name, PinholeCamera { rotation, centre: pose.centre, ..camera }))
    };
    found.poses.into_iter().zip(found.camera_ids).map(view).collect()
}

/// The camera of a record at the origin, or what is wrong with it. COLMAP counts from the corner of the top-left pixel.
fn camera(record: &Record) -> Result<PinholeCamera, String> {
    let (focal_px, [cx, cy], radial) = match (record.model(), &record.parameters[..]) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => ([f, f], [cx, cy], [0.0; 2]),
        ("PINHOLE", &[fx, fy, cx, cy]) | ("OPENCV", &[fx, fy, cx, cy, 0.0, 0.0, 0.0, 0.0]) => {
            ([fx, fy], [cx, cy], [0.0; 2])
        }
        ("SIMPLE_RADIAL", &[f, cx, cy, k1]) => ([f, f], [cx, cy], [k1, 0.0]),
        ("RADIAL", &[f, cx, cy, k1, k2]) => ([f, f], [cx, cy], [k1, k2]),
        ("OPENCV", &[fx, fy, cx, cy, k1, k2, 0.0, 0.0]) => ([fx, fy], [cx, cy], [k1, k2]),
        (model, _) => {
            return Err(format!(
                "has the model {model} with a distortion that is not read here; run colmap image_undistorter on images and \
                 masks, and use its model"
            ));
        }
    };
    let is_focal = |f: &f64| *f > 0.0 && *f <= MAX_FOCAL_PX;
    let is_size = |side: &u64| (1..=MAX_SIDE).contains(side);
    if !focal_px.iter().all(is_focal) || ![cx, cy, radial[0], radial[1]].iter().all(|value| value.is_finite()) {
        return Err(
            "has a focal length that is not positive, or a number that is not finite; is it damaged?".to_owned()
        );
    }
    if !record.size.iter().all(is_size) {
        return Err(format!(
            "has {} x {} px; a picture has 1 to {MAX_SIDE} px per side",
            record.size[0], record.size[1]
        ));
    }
    Ok(PinholeCamera {
        rotation: [[0.0; 3]; 3],
        centre: [0.0; 3],
        focal_px,
        principal_point_px: [cx - 0.5, cy - 0.5],
        radial,
        size: record.size.map(|side| side as usize),
    })
}
