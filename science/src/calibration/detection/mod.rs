//! Detection of the dots of one slice: without prior knowledge in the first slice, relocated from its neighbour in
//! every other.

mod diagnosis;
mod measure;
mod relocation;
mod windows;

use std::collections::BTreeMap;

pub(super) use diagnosis::{Diagnosis, diagnose};
pub(super) use relocation::relocate_grid;
pub(super) use windows::grid_steps;

use measure::measure;
use windows::in_picture;

use super::blobs;
use super::coarse_registration::SimilarityMotion;
use super::code::{self, Identity, RecognisedCode};
use super::dot_photometry::DotBrightness;
use super::flat_field::{FlatField, Polarity};
use super::identity::{self, Fingerprint};
use super::lattice::{self, Label, Lattice, Places};
use super::statistics::median;
use super::working_image::WorkingImage;
use crate::imaging::Raster;
use crate::types::{Cancelled, Control};

/// Most memory that is kept of a slice after its detection, bytes: the fingerprint, the measured dots and the places of
/// the known ones. Nodes of a map are two thirds full on average.
pub const SLICE_BYTES: usize = identity::MAX_BYTES
    + (windows::MAX_DOTS * size_of::<(Label, MeasuredDot)>() + MAX_PLACES * size_of::<(Label, [f64; 2])>()) * 3 / 2;
/// Most places of dots that are kept of a slice: those in its middle.
const MAX_PLACES: usize = identity::MAX_CELLS;

/// A measured dot, in px of its slice.
#[derive(Debug, Clone, Copy)]
pub(super) struct MeasuredDot {
    /// Centre.
    pub at: [f64; 2],
    /// Standard deviation of each coordinate, from noise and from the invalid part of its window.
    pub sigma: f64,
    /// Brightness around it.
    pub light: DotBrightness,
    /// The part of `sigma` that neighbouring dots share (glare, inpainting).
    pub shared_sigma: f64,
    /// Share of its window that is synthetic or at full scale: brightness is unreliable there.
    pub invalid: f64,
}

/// The dots of one slice; at most [`SLICE_BYTES`].
#[derive(Debug, Clone)]
pub(super) struct Detection {
    /// The dots that were measured.
    pub dots: BTreeMap<Label, MeasuredDot>,
    /// All known dots of the target at their measured or predicted positions, px of the slice.
    pub places: Places,
    /// Distance of neighbouring dots, px of the slice.
    pub pitch: f64,
    /// Motion of the image since the slice from which the grid was followed.
    pub motion: SimilarityMotion,
    /// Share of the pixels at full scale.
    pub clipped: f64,
    /// Amplitude of the first harmonic over the mean level; negative where blur has inverted the dots.
    pub modulation: f64,
    /// Dot diameter over the pitch as seen in this slice (too large where it is blurred).
    pub fill: f64,
    /// True when neighbouring dots merge.
    pub merged: bool,
    /// Measured dots over the dots that could have been measured. The lower it is, the less their windows overlap.
    pub density: f64,
    /// What tells which dot is which, relative to the slice in which the grid was found; `None` when only tracking
    /// does.
    pub identity: Option<Identity>,
    /// True (mirrored) or false (turned by quarter turns) when the slice does not have the orientation of the slice in
    /// which the grid was found.
    pub turned: Option<bool>,
    /// `ln` of red over green and of blue over green light; `None` for a grey or a clipped slice.
    pub tint: Option<[f64; 2]>,
    /// True when the slice was found where the motion of the other slices does not lead. It counts only if the
    /// fingerprint confirms it.
    pub is_tentative: bool,
    /// Standard deviation, per coordinate, of an error that all dots of the slice share, px.
    pub common_sigma: f64,
    /// Amplitude of stripes across the image, as a share of the light; `None` without stripes.
    pub stripes: Option<f64>,
    /// What makes the cells of the grid differ; `None` when the grid is degenerate.
    pub fingerprint: Option<Fingerprint>,
}

impl Detection {
    /// Forgets what later stages do not need, so that a slice takes at most [`SLICE_BYTES`].
    pub(super) fn shrink(&mut self) {
        middle_places(&mut self.places);
    }

    /// Adds `shift` to all labels.
    pub(super) fn relabel(&mut self, shift: Label) {
        if shift == [0, 0] {
            return;
        }
        let moved = |l: Label| [l[0] + shift[0], l[1] + shift[1]];
        self.dots = std::mem::take(&mut self.dots).into_iter().map(|(l, d)| (moved(l), d)).collect();
        self.places = std::mem::take(&mut self.places).into_iter().map(|(l, p)| (moved(l), p)).collect();
        if let Some(print) = &mut self.fingerprint {
            print.relabel(shift);
        }
    }
}

/// Keeps the [`MAX_PLACES`] places in the middle of the grid.
fn middle_places(places: &mut Places) {
    if places.len() <= MAX_PLACES {
        return;
    }
    let middle = |axis: usize| median(&mut places.keys().map(|l| f64::from(l[axis])).collect::<Vec<_>>());
    let middle = [middle(0), middle(1)];
    let off = |l: &Label| (0..2).map(|a| (f64::from(l[a]) - middle[a]).abs()).fold(0.0, f64::max);
    let mut labels: Vec<Label> = places.keys().copied().collect();
    labels.sort_by(|a, b| off(a).total_cmp(&off(b)).then(a.cmp(b)));
    for label in &labels[MAX_PLACES..] {
        places.remove(label);
    }
}

/// Properties of the target that are the same in all slices.
#[derive(Debug, Clone, Copy)]
pub(super) struct Target {
    /// Dark or bright dots.
    pub polarity: Polarity,
    /// Pixels per sample, along each axis, of the image in which dots are measured.
    pub bin: usize,
    /// The code of a coded target, and where the labels lie in it.
    pub code: Option<RecognisedCode>,
}

/// Prediction for a slice from the slices before it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Expected {
    /// Expected motion.
    pub motion: SimilarityMotion,
    /// True when the motion is known from the slices before.
    pub confident: bool,
    /// True when blur may have inverted the dots.
    pub maybe_inverted: bool,
}

impl Expected {
    /// The slice from which the places are.
    pub(super) const NOTHING_MOVES: Self =
        Self { motion: SimilarityMotion::NONE, confident: true, maybe_inverted: false };
}

/// Longer side of the image in which the grid is detected, samples.
const DETECTION_SIDE: usize = 2400;
/// Samples of the image in which dots are measured; more do not improve them.
const SAMPLES: f64 = 7e5;
/// Upper bound of those samples, used to budget memory; reached only by very fine grids.
pub const MAX_SAMPLES: usize = 8_000_000;
/// Smallest dot pitch in that image, px, unless [`MAX_SAMPLES`] requires a coarser one.
const MEASURED_PITCH: f64 = 16.0;
/// Largest distance of a dot from its predicted position, grid steps.
const MAX_SHIFT: f64 = 0.3;

/// Detects the grid in a slice without prior knowledge. Positions are px of the slice; `None` when no grid is found.
///
/// # Errors
/// When the work is cancelled.
pub(super) fn detect_grid(slice: &Raster, control: &dyn Control) -> Result<Option<(Target, Lattice)>, Cancelled> {
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
        if let Some(found) = lattice::index(&blobs::find(&contrast, radius))
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

/// Recognises the code of the target and measures the dots of a slice in which the grid was detected. The target is
/// returned with its code. `None` when fewer than 12 dots can be measured.
///
/// # Errors
/// When the work is cancelled.
pub(super) fn measure_grid(
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
///
/// # Errors
/// When the work is cancelled.
pub(super) fn detect_coded(
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

/// Whether a grid with steps `to` is mirrored (true) or turned by more than 45 degrees (false) against one with steps
/// `from`; `None` when it has the same orientation.
fn turned(from: [[f64; 2]; 2], to: [[f64; 2]; 2]) -> Option<bool> {
    let area = |[u, v]: [[f64; 2]; 2]| u[0] * v[1] - u[1] * v[0];
    let along = |k: usize| from[k][0] * to[k][0] + from[k][1] * to[k][1];
    let across = from[0][0] * to[0][1] - from[0][1] * to[0][0];
    let is_mirrored = area(from) * area(to) < 0.0;
    (is_mirrored || along(0) < across.abs()).then_some(is_mirrored)
}

/// The motion from one slice to another by the dots that both show.
fn motion_between(from: &Places, to: &Places, middle: [f64; 2]) -> SimilarityMotion {
    let scale = lattice::pitch_of(to) / lattice::pitch_of(from).max(1e-9);
    let shifts: Vec<[f64; 2]> = from
        .iter()
        .filter_map(|(label, p)| to.get(label).map(|q| [0, 1].map(|a| q[a] - middle[a] - scale * (p[a] - middle[a]))))
        .collect();
    let mean = |a: usize| shifts.iter().map(|s| s[a]).sum::<f64>() / shifts.len().max(1) as f64;
    SimilarityMotion { scale, shift: [mean(0), mean(1)] }
}

/// The centre of the image, px.
fn slice_middle(slice: &Raster) -> [f64; 2] {
    [(slice.width as f64 - 1.0) / 2.0, (slice.height as f64 - 1.0) / 2.0]
}

/// The flat field around the approximate dot positions `places`.
fn flat_field(image: &WorkingImage, target: Target, places: &Places) -> FlatField {
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

    #[test]
    fn of_a_very_large_grid_the_middle_is_kept() {
        let mut places: Places =
            (0..200).flat_map(|y| (0..150).map(move |x| ([x - 40, y], [f64::from(x), f64::from(y)]))).collect();
        middle_places(&mut places);
        assert_eq!(places.len(), MAX_PLACES);
        let (low, high) = places.keys().fold(([i32::MAX; 2], [i32::MIN; 2]), |(low, high), l| {
            ([0, 1].map(|a| low[a].min(l[a])), [0, 1].map(|a| high[a].max(l[a])))
        });
        assert!((low[0] + high[0] - 69).abs() <= 1 && (low[1] + high[1] - 199).abs() <= 1, "{low:?} {high:?}");
        let before = places.clone();
        middle_places(&mut places);
        assert_eq!(places, before);
    }
}
