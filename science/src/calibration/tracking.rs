//! Tracking of the grid through the stack: detection in one slice, then from slice to slice outward in both directions.
//!
//! Input: the slices. Output: per slice the measured dots, or `None`. Each slice is decoded once (twice where the grid
//! was searched for in vain before it was found in another slice). Its pixels are not kept.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::detected::{Detection, Expected, Target};
use super::detection::{self, Diagnosis};
use super::{
    coarse_registration::SimilarityMotion, identity, lateral_colour, lattice::Places, names::first_names,
    statistics::median_of, tint, tracked::Tracked,
};
use crate::imaging::{Raster, Slices};
use crate::types::error::ErrorLocation;
use crate::types::{Control, Error, ErrorKind, Interrupted};

/// Most slices in which the grid is searched for, besides the reference.
const MAX_TRIED: usize = 9;

/// Least distance of neighbouring dots, px. Nearer ones are a few samples, whose pattern may be that of another grid.
const MIN_PITCH: f64 = 4.75;

/// Tracks the grid through all slices. Detection starts with `reference` and, when that shows no grid, continues with
/// slices spread over the stack.
///
/// # Errors
/// An error when no slice shows a grid, when slices differ in size, or when a slice cannot be loaded.
pub(super) fn track_all(slices: &dyn Slices, reference: usize, control: &dyn Control) -> Result<Tracked, Interrupted> {
    let count = slices.count();
    control.check()?;
    let done = AtomicUsize::new(0);
    let tick = || control.progress("detecting", done.fetch_add(1, Ordering::Relaxed) + 1, count);
    control.progress("detecting", 0, count);
    let mut loader = Loader { slices, size: None };
    let mut tried = Vec::new();
    let mut first = None;
    for index in candidates(count, reference) {
        control.check()?;
        let slice = loader.load(index)?;
        if slice.width < 16 || slice.height < 16 {
            let name = slices.name(index);
            let detail =
                format!("{name} is {} x {} px: slices must have at least 16 x 16 px", slice.width, slice.height);
            return Err(Error::new(ErrorKind::TargetNotFound, detail).in_file(name, Some(index as u32)).into());
        }
        loader.size = Some((slice.width, slice.height, index));
        if let Some((target, lattice)) = detection::detect_grid(&slice, control)?
            && let Some((target, mut detection)) = detection::measure_grid(&slice, target, &lattice, control)?
            && detection.pitch >= MIN_PITCH
        {
            detection.tint = tint::tint(&slice, &detection);
            let colours = lateral_colour::measure(&slice, target, &detection, control)?;
            first = Some((index, target, detection, colours));
            break;
        }
        tried.push((index, detection::diagnose(&slice)));
    }
    let Some((start, target, mut detection, colours)) = first else { return Err(no_grid(slices, &tried).into()) };
    tick();
    let follow = |indices: Vec<usize>| follow(&loader, target, &detection, indices, control, &tick);
    let (up, down) = rayon::join(|| follow((start + 1..count).collect()), || follow((0..start).rev().collect()));
    let (up, down) = (up?, down?);
    detection.shrink();
    let (width, height, _) = loader.size.unwrap_or_default();
    let found = (Some(detection), None);
    let (mut detections, diagnoses): (Vec<_>, Vec<_>) = down.into_iter().rev().chain([found]).chain(up).unzip();
    let labelling = identity::resolve_labels(&mut detections, start);
    same_orientation(slices, &detections, start, target.code.is_some())?;
    Ok(Tracked { width, height, target, detections, diagnoses, labelling, colours })
}

/// The reference slice, then slices spread over the stack, from the middle outward.
fn candidates(count: usize, reference: usize) -> Vec<usize> {
    let spread = MAX_TRIED.min(count);
    let mut out: Vec<usize> = (0..spread).map(|k| (2 * k + 1) * count / (2 * spread)).collect();
    out.sort_by_key(|&index| index.abs_diff(count / 2));
    out.retain(|&index| index != reference);
    out.insert(0, reference);
    out
}

/// The motion so far, which predicts the next slice.
struct Course {
    /// The last three motions from slice to slice.
    motions: Vec<SimilarityMotion>,
    /// Slices since the last one with a detection.
    gap: i32,
    merged: bool,
}

impl Course {
    fn expected(&self) -> Expected {
        let middle = |of: &dyn Fn(&SimilarityMotion) -> f64| median_of(self.motions.iter().map(of));
        let maybe_inverted = self.merged || self.gap > 1;
        if self.motions.is_empty() {
            return Expected { motion: SimilarityMotion::NONE, confident: false, maybe_inverted };
        }
        let gap = f64::from(self.gap);
        let motion = SimilarityMotion {
            scale: middle(&|m| m.scale).powi(self.gap),
            shift: [middle(&|m| m.shift[0]) * gap, middle(&|m| m.shift[1]) * gap],
        };
        Expected { motion, confident: true, maybe_inverted }
    }

    fn update(&mut self, detection: &Detection) {
        let gap = f64::from(self.gap);
        let motion = detection.motion;
        self.motions
            .push(SimilarityMotion { scale: motion.scale.powf(1.0 / gap), shift: motion.shift.map(|s| s / gap) });
        if self.motions.len() > 3 {
            self.motions.remove(0);
        }
        self.gap = 1;
        self.merged = detection.merged;
    }
}

/// The dots of a slice, or the likely reason why there are none.
type Followed = (Option<Detection>, Option<Diagnosis>);

/// Follows the grid through `indices`, which lead away from the slice of `from`. Returns one result per index.
fn follow(
    loader: &Loader,
    target: Target,
    from: &Detection,
    indices: Vec<usize>,
    control: &dyn Control,
    tick: &(dyn Fn() + Sync),
) -> Result<Vec<Followed>, Interrupted> {
    let mut places: Places = from.places.clone();
    let mut course = Course { motions: Vec::new(), gap: 1, merged: from.merged };
    let mut all = Vec::with_capacity(indices.len());
    for index in indices {
        control.check()?;
        let slice = loader.load(index)?;
        let expected = course.expected();
        let mut detected = detection::relocate_grid(&slice, target, &places, &expected, control)?;
        if detected.is_none() && expected.confident {
            // the rail may have jumped: try again without assuming a shift
            let open = Expected {
                motion: SimilarityMotion { shift: [0.0; 2], ..expected.motion },
                confident: false,
                ..expected
            };
            detected = detection::relocate_grid(&slice, target, &places, &open, control)?;
            if let Some(detection) = &mut detected {
                detection.is_tentative = expected.maybe_inverted && detection.identity.is_none();
            }
        }
        if detected.is_none() {
            detected = detection::detect_coded(&slice, target, &places, control)?;
        }
        match &mut detected {
            Some(detection) => {
                detection.tint = tint::tint(&slice, detection);
                if detection.is_tentative {
                    course.gap += 1;
                } else {
                    course.update(detection);
                    places.clone_from(&detection.places);
                }
            }
            None => course.gap += 1,
        }
        if let Some(detection) = &mut detected {
            detection.shrink();
        }
        let diagnosis = detected.is_none().then(|| detection::diagnose(&slice));
        all.push((detected, diagnosis));
        tick();
    }
    Ok(all)
}

/// Checks that no slice is mirrored or turned against the slice `start`, in which the grid was found. The code of a
/// coded target tells, or the missing dots of another one.
fn same_orientation(
    slices: &dyn Slices,
    detections: &[Option<Detection>],
    start: usize,
    is_coded: bool,
) -> Result<(), Error> {
    let is_turned = |(index, detection): (usize, &Option<Detection>)| Some((index, detection.as_ref()?.turned?));
    let turned: Vec<(usize, bool)> = detections.iter().enumerate().filter_map(is_turned).collect();
    let Some((first, is_mirrored)) = turned.first().copied() else { return Ok(()) };
    let (how, advice) = if is_mirrored {
        ("is mirrored", "take it without mirroring")
    } else {
        ("is turned by quarter turns", "give all slices the same orientation")
    };
    let others = match turned.len() - 1 {
        0 => String::new(),
        1 => " (and 1 other slice has another orientation, too)".to_owned(),
        n => format!(" (and {n} other slices have another orientation, too)"),
    };
    let name = slices.name(first);
    let detail = format!(
        "{name} (slice {first}) {how} against {}, by {}{others}: {advice}, or omit it",
        slices.name(start),
        if is_coded { "the code of the target" } else { "its missing dots" }
    );
    Err(Error::new(ErrorKind::TargetNotFound, detail).in_file(name, Some(first as u32)))
}

/// Loads slices and checks that they have one size.
struct Loader<'a> {
    slices: &'a dyn Slices,
    /// Width, height, and the slice that set them.
    size: Option<(usize, usize, usize)>,
}

impl Loader<'_> {
    fn load(&self, index: usize) -> Result<Raster, Error> {
        let raster = self.slices.load(index)?;
        if let Some((width, height, first)) = self.size
            && (raster.width, raster.height) != (width, height)
        {
            let (name, other) = (self.slices.name(index), self.slices.name(first));
            let detail = format!(
                "{name} is {} x {} px but {other} is {width} x {height} px: all slices of a stack must have the same size",
                raster.width, raster.height
            );
            return Err(Error::new(ErrorKind::SizeMismatch, detail).in_file(name, Some(index as u32)));
        }
        Ok(raster)
    }
}

fn no_grid(slices: &dyn Slices, tried: &[(usize, Diagnosis)]) -> Error {
    let searched: Vec<usize> = tried.iter().map(|(index, _)| *index).collect();
    let same = tried
        .first()
        .filter(|(_, first)| tried.iter().all(|(_, diagnosis)| diagnosis == first))
        .map(|(_, diagnosis)| diagnosis.phrase());
    let subject = if tried.len() == 1 { "it" } else { "each" };
    let why = same.map_or(String::new(), |diagnosis| format!("; {subject} {diagnosis}"));
    let slices_searched = if tried.len() == 1 {
        "the slice that was searched".to_owned()
    } else {
        format!("the {} slices that were searched", tried.len())
    };
    let detail = format!(
        "no grid of dots was found in {slices_searched} ({}){why}; the target needs at least 12 whole \
         round dots in 3 rows and 3 columns, sharp in at least one slice, evenly lit and not clipped",
        first_names(slices, &searched, 5),
    );
    let mut error = Error::new(ErrorKind::TargetNotFound, detail);
    for (index, diagnosis) in tried {
        error = error.at(ErrorLocation {
            detail: format!("no grid of dots in this slice, which {}", diagnosis.phrase()),
            pointer: None,
            file: Some(slices.name(*index).to_owned()),
            slice: Some(*index as u32),
        });
    }
    error
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reference_is_tried_first_and_then_slices_spread_over_the_stack() {
        assert_eq!(candidates(4, 2), [2, 1, 3, 0]);
        let many = candidates(61, 7);
        assert_eq!((many[0], many[1]), (7, 30));
        assert!(many.len() <= MAX_TRIED + 1 && many.iter().all(|k| *k < 61));
        assert!(many.iter().any(|k| *k < 10) && many.iter().any(|k| *k > 50));
    }
}
