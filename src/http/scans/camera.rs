//! The camera of a view, as far as all views of a scan must share it.
//!
//! In: the result of a view. Out: what its image says about the camera, so that two views can be compared, and the
//! first difference as words. A reconstruction has one set of intrinsics for all images. Images of another size, crop
//! or profile revision, or with another principal distance, do not fit it, and the surface would be bent without a
//! sign.

use super::table::{View, ViewResult};
use crate::contract::outcome::ImageInfo;

/// What an image says about its camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ViewCamera<'a> {
    /// Width and height, px.
    pub size: [u32; 2],
    /// Position of the top-left pixel in the reference slice, px.
    pub crop_offset: [u32; 2],
    /// Digest of the geometry of the profile: homographies, gains, distortion.
    profile: &'a str,
    /// The bits of the numbers of the pinhole camera, which that digest does not cover; `None` when it is unknown.
    pinhole: Option<Pinhole>,
}

/// Principal distance, size of a pixel, and principal point, which may be unknown.
type Pinhole = ([u64; 2], Option<[u64; 2]>);

impl<'a> ViewCamera<'a> {
    /// The camera of a view with a result.
    pub fn of(view: &'a View, result: &ViewResult) -> Self {
        let ImageInfo { width, height, crop_offset_px, intrinsics, .. } = result.image_info;
        // -0.0 + 0.0 = 0.0: both zeros are one number
        let bits = |number: f64| (number + 0.0).to_bits();
        Self {
            size: [width, height],
            crop_offset: crop_offset_px,
            profile: &view.stack.profile_digest,
            pinhole: intrinsics.map(|camera| {
                let lengths = [camera.principal_distance_mm, camera.pixel_pitch_mm].map(bits);
                (lengths, camera.principal_point_px.map(|point| point.map(bits)))
            }),
        }
    }

    /// In what it differs from another camera; `None` when it is the same. A crop moves the principal point, so only
    /// the first difference is told.
    pub fn difference(&self, usual: &Self) -> Option<String> {
        let [width, height] = self.size;
        let [x, y] = self.crop_offset;
        if self.size != usual.size {
            Some(format!("{width} x {height} px"))
        } else if self.crop_offset != usual.crop_offset {
            Some(format!("a crop at {x},{y}"))
        } else if self.profile != usual.profile {
            Some("another profile revision".to_owned())
        } else if self.pinhole != usual.pinhole {
            Some("another principal distance, pixel pitch or principal point".to_owned())
        } else {
            None
        }
    }
}
