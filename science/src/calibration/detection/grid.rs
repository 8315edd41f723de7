//! Detection of the grid in a slice without prior knowledge, and the flat field around it.

use super::windows::in_picture;
use crate::calibration::flat_field::{FlatField, Polarity};
use crate::calibration::lattice::{self, Lattice, Places};
use crate::calibration::{blobs, detected::Target, grid_indexing, working_image::WorkingImage};
use crate::imaging::Raster;
use crate::types::{Cancelled, Control};

/// Longer side of the image in which the grid is detected, samples.
const DETECTION_SIDE: usize = 2400;
/// Samples of the image in which dots are measured; more do not improve them.
const SAMPLES: f64 = 7e5;
/// Upper bound of those samples, used to budget memory; reached only by very fine grids.
pub const MAX_SAMPLES: usize = 8_000_000;
/// Smallest dot pitch in that image, px, unless [`MAX_SAMPLES`] requires a coarser one.
const MEASURED_PITCH: f64 = 16.0;
/// Detects the grid in a slice without prior knowledge. Positions are px of the slice; `None` when no grid is found.
pub(in crate::calibration) fn detect_grid(
    slice: &Raster,
    control: &dyn Control,
) -> Result<Option<(Target, Lattice)>, Cancelled> {
    let image = WorkingImage::of(slice, slice.width.max(slice.height).div_ceil(DETECTION_SIDE).max(1));
    let likely = Polarity::guess(&image.plane);
    // on a dark table the gaps between dark dots may look like bright dots, so both polarities are tried
    let mut best: Option<(Polarity, Lattice)> = None;
    for polarity in [likely, likely.other()] {
        let found = largest_grid(&image, polarity, control)?;
        if let Some(found) = found
            && best.as_ref().is_none_or(|(_, b)| found.outdoes(b))
        {
            best = Some((polarity, found));
        }
    }
    Ok(best.map(|(polarity, lattice)| {
        let places = lattice.places.iter().map(|(label, p)| (*label, image.to_slice(*p))).collect();
        let pitch = lattice.pitch * image.bin as f64;
        let target = Target { polarity, bin: resolution((slice.width * slice.height) as f64, pitch), code: None };
        (target, Lattice { places, pitch })
    }))
}

/// The largest grid of one polarity, over several sizes of the threshold window.
fn largest_grid(image: &WorkingImage, polarity: Polarity, control: &dyn Control) -> Result<Option<Lattice>, Cancelled> {
    let contrast = FlatField::estimate(&image.plane, polarity, None).contrast(&image.plane);
    let mut best: Option<Lattice> = None;
    let largest = image.plane.width.min(image.plane.height) / 4;
    let mut radius = 6;
    while radius <= largest.max(6) {
        control.check()?;
        // larger windows than the pitch find nothing new
        if best.as_ref().is_some_and(|b| radius as f64 > 2.0 * b.pitch) {
            break;
        }
        if let Some(found) = grid_indexing::index(&blobs::find(&contrast, radius))
            && best.as_ref().is_none_or(|b| found.places.len() > b.places.len())
        {
            best = Some(found);
        }
        radius = radius * 3 / 2;
    }
    Ok(best)
}

/// Pixels per sample, along each axis, for a slice of `pixels` px whose dots are `pitch` px apart.
fn resolution(pixels: f64, pitch: f64) -> usize {
    let within = |samples: f64| (pixels / samples).sqrt().ceil();
    let good = within(SAMPLES).min(pitch / MEASURED_PITCH);
    // a very fine grid in a very large slice is measured more coarsely than is best for it, but never more coarsely
    // than it was detected
    good.max(within(MAX_SAMPLES as f64)).max(1.0) as usize
}

/// The flat field around the approximate dot positions `places`.
pub(super) fn flat_field(image: &WorkingImage, target: Target, places: &Places) -> FlatField {
    let near: Vec<[f64; 2]> = places.values().filter(|p| in_picture(image, p)).copied().collect();
    FlatField::estimate(&image.plane, target.polarity, Some((&near, 0.6 * lattice::pitch_of(places))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slice_is_measured_with_at_most_the_samples_that_memory_is_budgeted_for() {
        for (width, height, pitch) in [(4800, 4800, 15.0), (12_000, 12_000, 30.0), (6000, 4000, 10.0), (300, 200, 9.0)]
        {
            let bin = resolution(f64::from(width * height), pitch);
            let samples = (width as usize / bin) * (height as usize / bin);
            assert!(samples <= MAX_SAMPLES, "{width} x {height} px, pitch {pitch}: {samples} samples");
        }
    }
}
