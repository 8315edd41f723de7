//! Measurement of a slice in which the grid was detected without prior knowledge: the first slice, or one of a coded
//! target whose neighbour does not tell where the grid is.

use super::grid::{detect_grid, flat_field};
use super::motion::{motion_between, slice_middle, turned};
use super::{measure::measure, windows::grid_steps};
use crate::calibration::code::{self, Identity};
use crate::calibration::detected::{Detection, Target};
use crate::calibration::lattice::{Lattice, Places};
use crate::calibration::working_image::WorkingImage;
use crate::imaging::Raster;
use crate::types::{Cancelled, Control};

/// Recognises the code of the target and measures the dots of a slice in which the grid was detected. The target is
/// returned with its code. `None` when fewer than 12 dots can be measured.
pub(in crate::calibration) fn measure_grid(
    slice: &Raster,
    mut target: Target,
    found: &Lattice,
    control: &dyn Control,
) -> Result<Option<(Target, Detection)>, Cancelled> {
    let image = WorkingImage::of(slice, target.bin);
    let places: Places = found.places.iter().map(|(label, p)| (*label, image.to_plane(*p))).collect();
    let field = flat_field(&image, target, &places);
    target.code = code::recognise(&field.contrast(&image.plane), &places);
    let place = target.code.map(|code| code.place);
    let Some(mut detection) = measure(&image, field, places, 1.0, place.as_ref(), control)? else { return Ok(None) };
    detection.identity = target.code.map(|code| Identity { shift: [0; 2], certainty: code.certainty });
    Ok(Some((target, detection)))
}

/// Detects the grid of a coded target in a slice without prediction, and measures its dots. `from` are the dots of a
/// neighbouring slice, px. `None` when the grid or its code is not visible.
pub(in crate::calibration) fn detect_coded(
    slice: &Raster,
    target: Target,
    from: &Places,
    control: &dyn Control,
) -> Result<Option<Detection>, Cancelled> {
    let Some(known) = target.code else { return Ok(None) };
    let Some((found, lattice)) = detect_grid(slice, control)?.filter(|(found, _)| found.polarity == target.polarity)
    else {
        return Ok(None);
    };
    let image = WorkingImage::of(slice, target.bin);
    let places: Places = lattice.places.iter().map(|(label, p)| (*label, image.to_plane(*p))).collect();
    let field = flat_field(&image, found, &places);
    let Some(code) = code::recognise(&field.contrast(&image.plane), &places) else { return Ok(None) };
    let places = code::relabelled(&places, &code.place, &known.place);
    let Some(mut detection) = measure(&image, field, places, 1.0, Some(&known.place), control)? else {
        return Ok(None);
    };
    detection.identity = Some(Identity { shift: [0; 2], certainty: code.certainty });
    detection.turned = turned(grid_steps(from), grid_steps(&detection.places));
    detection.motion = motion_between(from, &detection.places, slice_middle(slice));
    Ok(Some(detection))
}
