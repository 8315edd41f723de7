//! Relocation of the grid of a neighbouring slice in another: first a coarse registration, then a first measurement of
//! the dots.

use super::motion::{motion_between, slice_middle};
use super::windows::{MAX_SHIFT, dot_position, grid_steps, in_picture, selected_labels, windows_at};
use super::{grid::flat_field, measure::measure};
use crate::calibration::coarse_registration::{CoarseRegistration, RegisteredMotion, SimilarityMotion};
use crate::calibration::code::{self, Identification};
use crate::calibration::detected::{Detection, Expected, Target};
use crate::calibration::lattice::{self, MIN_DOTS, Places};
use crate::calibration::working_image::WorkingImage;
use crate::calibration::{dlt, phase, robust};
use crate::imaging::{Plane, Raster};
use crate::types::{Cancelled, Control, Homography};

/// Least contrast of the predicted dots, in standard errors.
const MIN_SIGNIFICANCE: f64 = 6.0;

/// Relocates the grid of a neighbouring slice in this one and measures its dots. `None` when it is not visible.
pub(in crate::calibration) fn relocate_grid(
    slice: &Raster,
    target: Target,
    from: &Places,
    expected: &Expected,
    control: &dyn Control,
) -> Result<Option<Detection>, Cancelled> {
    let image = WorkingImage::of(slice, target.bin);
    let from: Places = from.iter().map(|(label, p)| (*label, image.to_plane(*p))).collect();
    let field = flat_field(&image, target, &from);
    let contrast = field.contrast(&image.plane);
    let Some(found) = locate(&image, &contrast, &from, expected, control)? else { return Ok(None) };
    let places: Places = from.iter().map(|(label, p)| (*label, found.place(*p))).collect();
    let place = target.code.map(|code| code.place);
    let identification = place.map_or(Identification::Unreadable, |place| code::identify(&contrast, &places, &place));
    let (places, identity, turned, is_corrected) = match identification {
        Identification::Unreadable => (places, None, None, false),
        Identification::Confirmed(identity) => (places, Some(identity), None, false),
        Identification::Corrected(places, identity) => (places, Some(identity), None, true),
        Identification::Turned(is_mirrored) => (places, None, Some(is_mirrored), false),
    };
    let code = place.as_ref().filter(|_| turned.is_none());
    let mut detection = measure(&image, field, places, found.sign, code, control)?;
    if let Some(detection) = &mut detection {
        (detection.identity, detection.turned) = (identity, turned);
        let middle = slice_middle(slice);
        detection.motion = if is_corrected {
            let before = from.iter().map(|(label, p)| (*label, image.to_slice(*p))).collect();
            motion_between(&before, &detection.places, middle)
        } else {
            let there = image.to_slice(found.place(image.to_plane(middle)));
            SimilarityMotion {
                scale: found.motion.scale * found.homography.scale_at(found.middle),
                shift: [there[0] - middle[0], there[1] - middle[1]],
            }
        };
    }
    Ok(detection)
}

/// Where the grid of the neighbouring slice lies in this one, px of the working image.
struct Located {
    /// The middle of the image, about which `motion` scales.
    middle: [f64; 2],
    /// By the coarse registration.
    motion: SimilarityMotion,
    /// 1, or -1 where blur has inverted the dots.
    sign: f64,
    /// What a first measurement adds to the motion: rotation and keystone.
    homography: Homography,
}

impl Located {
    /// Where the point `p` of the neighbouring slice is.
    fn place(&self, p: [f64; 2]) -> [f64; 2] {
        self.homography.apply(self.motion.apply(self.middle, p))
    }
}

/// Locates the dots `from` of the neighbouring slice. `None` when they are not visible where they are expected, or too
/// few agree.
fn locate(
    image: &WorkingImage,
    contrast: &Plane<f32>,
    from: &Places,
    expected: &Expected,
    control: &dyn Control,
) -> Result<Option<Located>, Cancelled> {
    let visible: Vec<[f64; 2]> = from.values().filter(|p| in_picture(image, p)).copied().collect();
    let pitch = lattice::pitch_of(from);
    let steps = grid_steps(from);
    let registration = CoarseRegistration { contrast, dots: &visible, steps, pitch };
    let around = SimilarityMotion { shift: expected.motion.shift.map(|s| s / image.bin as f64), ..expected.motion };
    let RegisteredMotion { motion, sign, significance, .. } = if expected.confident {
        let near = registration.best(around, 0.02, 0.3, 1.0);
        let inverted = expected.maybe_inverted.then(|| registration.best(around, 0.02, 0.3, -1.0));
        inverted.filter(|i| i.depth > near.depth).unwrap_or(near)
    } else {
        registration.best(around, 0.09, 0.6, 1.0)
    };
    control.check()?;
    let middle = registration.middle();
    let is_off_course = (motion.shift[0] - around.shift[0]).hypot(motion.shift[1] - around.shift[1])
        > if expected.maybe_inverted { 0.3 } else { 0.45 } * pitch;
    if significance < MIN_SIGNIFICANCE || (expected.confident && is_off_course) {
        return Ok(None);
    }
    let predicted: Places = from.iter().map(|(label, p)| (*label, motion.apply(middle, *p))).collect();
    // a first measurement removes rotation and keystone
    let labels = selected_labels(image, &predicted);
    let windows = windows_at(&labels, &predicted, motion.scale, steps);
    let phases = phase::measure(contrast, None, &windows);
    let pairs: Vec<dlt::Pair> = windows
        .iter()
        .zip(&phases)
        .filter_map(|(window, phase)| phase.map(|p| (window.at, dot_position(window, &p, sign))))
        .filter(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]) < MAX_SHIFT * pitch)
        .collect();
    if pairs.len() < MIN_DOTS || 2 * pairs.len() < windows.len() {
        return Ok(None);
    }
    let Some(shared) = robust::consensus(&pairs, 0.02 * pitch, 0.15 * pitch) else { return Ok(None) };
    if 2 * shared.is_inlier.iter().filter(|a| **a).count() < pairs.len() {
        return Ok(None);
    }
    Ok(Some(Located { middle, motion, sign, homography: shared.homography }))
}
