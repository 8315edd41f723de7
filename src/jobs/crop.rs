//! The option `crop`: which rectangle of the canvas is written.

use crate::contract::{Code, Fault, options::Crop};
use pinstack_science::{fusion::crop::valid_rect, imaging::Rect, types::profile::ProfileInput};

/// The rectangle that `crop` selects from the canvas of `profile`.
///
/// # Errors
/// [`Code::InvalidRequest`] when a rectangle is empty or extends beyond the canvas; [`Code::InvalidProfile`] when
/// `crop=valid` and the slices of the profile have no pixel in common.
pub(super) fn crop_rect(crop: Crop, profile: &ProfileInput) -> Result<Rect, Fault> {
    let (columns, rows) = (profile.image_width, profile.image_height);
    match crop {
        Crop::None => Ok(Rect::whole(columns as usize, rows as usize)),
        Crop::Valid => valid_rect(&profile.homographies, profile.distortion.as_ref(), columns, rows).ok_or_else(|| {
            let detail =
                "crop=valid is empty: the slices of this profile have no pixel in common; use crop=none or recalibrate";
            Fault::new(Code::InvalidProfile, detail)
        }),
        Crop::Rect { x, y, width, height } => {
            let inside = |start: u32, length: u32, all: u32| {
                length > 0 && start.checked_add(length).is_some_and(|end| end <= all)
            };
            if !inside(x, width, columns) || !inside(y, height, rows) {
                let detail = format!(
                    "crop={x},{y},{width},{height} is empty or extends beyond the canvas of {columns} x {rows} px; choose a \
                     rectangle inside it"
                );
                return Err(Fault::new(Code::InvalidRequest, detail));
            }
            let [x, y, width, height] = [x, y, width, height].map(|v| v as usize);
            Ok(Rect { x, y, width, height })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinstack_science::types::Homography;

    fn profile(homographies: Vec<Homography>) -> ProfileInput {
        ProfileInput {
            image_width: 60,
            image_height: 40,
            reference_index: 0,
            homographies,
            gains: None,
            ..ProfileInput::default()
        }
    }

    #[test]
    fn the_crop_is_the_canvas_the_common_part_or_the_rectangle() {
        let shifted = profile(vec![Homography::IDENTITY, Homography::similarity(1.0, [3.0, 0.0])]);
        assert_eq!(crop_rect(Crop::None, &shifted), Ok(Rect::whole(60, 40)));
        assert_eq!(crop_rect(Crop::Valid, &shifted), Ok(Rect { x: 3, y: 0, width: 57, height: 40 }));
        let given = Crop::Rect { x: 10, y: 20, width: 50, height: 20 };
        assert_eq!(crop_rect(given, &shifted), Ok(Rect { x: 10, y: 20, width: 50, height: 20 }));
    }

    #[test]
    fn a_crop_beyond_the_canvas_or_without_pixels_is_refused() {
        let aligned = profile(vec![Homography::IDENTITY; 2]);
        for (x, width) in [(11, 50), (60, 1), (u32::MAX, 2), (0, 61)] {
            let crop = Crop::Rect { x, y: 0, width, height: 1 };
            assert_eq!(crop_rect(crop, &aligned).map_err(|f| f.code), Err(Code::InvalidRequest), "{x} {width}");
        }
        let apart = profile(vec![Homography::similarity(1.0, [40.0, 0.0]), Homography::similarity(1.0, [-40.0, 0.0])]);
        assert_eq!(crop_rect(Crop::Valid, &apart).map_err(|f| f.code), Err(Code::InvalidProfile));
    }
}
