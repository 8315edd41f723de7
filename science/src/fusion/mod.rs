//! Fusing a stack: warp, saliency, weights, blend (Li & Nguyen 2019 after Li, Kang & Hu 2013), and the mask.
//!
//! Two passes. The first warps each slice onto the canvas of the reference slice, notes per pixel the sharpest
//! slice that covers it, and puts the warped slice into a scratch file. The second goes over tiles: where
//! several slices meet, each slice's part in the choice is smoothed by two guided filters into weights for its
//! base and its detail layer; where one slice alone is in reach, its pixels are copied, which is the same.
//!
//! - Memory does not grow with the number of slices; the scratch file does.
//! - The same input gives the same bytes whatever the number of threads and the size of the tiles.
//! - A pixel that a slice does not cover never wins and enters no statistic of that slice.

mod align;
mod blend;
pub mod crop;
mod form;
mod halo_corrected;
mod measure;
mod observe;
mod presence;
mod pyramid;
mod scratch;
mod sums;
mod tile;
mod winner;

#[cfg(test)]
mod tests;

use std::{
    path::Path,
    sync::{Mutex, MutexGuard, PoisonError},
};

use crate::{
    imaging::{Depth, Plane, Raster, Rect, Sample, Slices},
    quality::{StackQuality, score::ScoreSums},
    types::{
        Control, Error, ErrorKind, Homography, Interrupted, Warning,
        fusion_options::{GuidedParams, Method},
    },
};
use form::Form;

/// Value of [`Fused::index`] where no slice covers the canvas.
pub const UNCOVERED: u16 = u16::MAX;

/// Share of pixels that may leave the range of their depth before they are clamped, without a warning.
const OVERSHOOT_WORTH_A_WARNING: f64 = 0.01;

/// How a stack is to be fused.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Columns of the canvas, which is the frame of the reference slice, and of every slice, px.
    pub width: usize,
    /// Rows of the same.
    pub height: usize,
    /// Per slice: slice pixel to canvas pixel.
    pub homographies: Vec<Homography>,
    /// Per slice: what its samples are multiplied by, above 0.
    pub gains: Vec<f64>,
    /// 0-based index of the reference slice: chosen where nothing is sharp anywhere.
    pub reference: usize,
    /// How the slices are fused.
    pub method: Method,
    /// Parameters of [`Method::Guided`].
    pub params: GuidedParams,
    /// Where on the rail each slice was taken, in any unit: tells how far apart in focus slices are. Without
    /// it their distances are taken to be equal.
    pub rail: Option<Vec<f64>>,
    /// Whether the first slice is in focus nearest to the camera, and the last farthest from it; without it the
    /// slices are asked.
    pub near_first: Option<bool>,
}

impl Plan {
    /// A plan for `slices` slices that are aligned already and equally bright, with the middle one as the
    /// reference, guided filtering and the parameters of Li, Kang & Hu 2013.
    pub fn aligned(width: usize, height: usize, slices: usize) -> Self {
        Self {
            width,
            height,
            homographies: vec![Homography::IDENTITY; slices],
            gains: vec![1.0; slices],
            reference: slices / 2,
            method: Method::Guided,
            params: GuidedParams::default(),
            rail: None,
            near_first: None,
        }
    }

    /// Bytes of memory that [`fuse`] holds at most, in round numbers, with `threads` threads and samples of
    /// `depth` in three channels: for whoever shares the memory of a machine. It does not depend on the number
    /// of slices. `metrics` says whether [`Watch::metrics`] will be set.
    ///
    /// With `s` bytes per sample, per pixel of the canvas, in the first pass: 6 for the best saliency and its slice, and for
    /// each slice in flight (one per thread, at most four) `9 s` for its file, its samples and the warped ones. In the second
    /// pass `3 + 3 s`, and `14 + 3 s` more for [`Method::HaloCorrected`]. For each thread 48 MiB of tiles and rows, 32 MiB for
    /// everything else, and 32 MiB for what the metrics keep.
    pub fn memory_bytes(&self, threads: usize, depth: Depth, metrics: bool) -> u64 {
        let pixels = (self.width * self.height) as u64;
        let pixel = 3 * depth.bytes() as u64;
        // decoded, warped, and a buffer for the next
        let in_flight = 3 * pixel;
        let first_pass = 6 + in_flight * align::lanes(threads, self.homographies.len()) as u64;
        // labels beside the picture from pyramids
        let labels = if self.method == Method::HaloCorrected { 14 + pixel } else { 0 };
        let second_pass = 3 + pixel + labels;
        // what is kept at the points and in the blocks of the metrics
        let kept = if metrics { 32 } else { 0 };
        pixels * first_pass.max(second_pass) + (threads as u64 * 48 + 32 + kept) * (1 << 20)
    }

    /// Bytes of the scratch file that [`fuse`] makes for slices of `channels` samples of `depth`: their samples, and what
    /// fills the squares that they are cut into.
    pub fn scratch_bytes(&self, channels: usize, depth: Depth) -> u64 {
        let side = |length: usize| length.next_multiple_of(scratch::BLOCK) as u64;
        side(self.width) * side(self.height) * (channels * depth.bytes() * self.homographies.len()) as u64
    }

    fn check(&self, slices: usize) -> Result<(), Error> {
        if slices == 0 || self.homographies.len() != slices || self.gains.len() != slices {
            return Err(Error::new(
                ErrorKind::SliceCountMismatch,
                format!(
                    "the stack has {slices} slices and its profile {}; they must be as many, and at least one",
                    self.homographies.len()
                ),
            ));
        }
        let internal = |what: &str| Err(Error::new(ErrorKind::Internal, format!("the plan of the fusion {what}")));
        if slices >= usize::from(UNCOVERED) {
            return Err(Error::new(ErrorKind::ArchiveTooLarge, "a stack has at most 65534 slices".to_owned()));
        }
        if self.width == 0 || self.height == 0 || self.reference >= slices {
            return internal("has an empty canvas or no such reference slice");
        }
        let params = &self.params;
        if params.average.is_multiple_of(2) || params.average > 255 || params.r1 > 512 || params.r2 > 512 {
            return internal("has filters that are out of range");
        }
        if let Some(slice) = self.gains.iter().position(|gain| !gain.is_finite() || *gain <= 0.0) {
            return Err(Error::new(
                ErrorKind::InvalidProfile,
                format!("the gain of slice {slice} is {}; it must be above 0", self.gains[slice]),
            ));
        }
        Ok(())
    }
}

/// How many slices are decoded and warped at the same time with so many threads.
pub fn slices_in_flight(threads: usize, slices: usize) -> usize {
    align::lanes(threads, slices)
}

/// What is measured on the way.
#[derive(Debug, Clone, Copy, Default)]
pub struct Watch<'a> {
    /// Whether [`Fused::quality`] is wanted.
    pub metrics: bool,
    /// Silhouette of the object, 255 inside and 0 outside, of the size of the canvas: restricts the metrics.
    pub object: Option<&'a Plane<u8>>,
}

/// A fused stack.
#[derive(Debug, Clone, PartialEq)]
pub struct Fused {
    /// The picture, in the depth of the slices; 1 channel when they are grey, else 3. Black where no slice
    /// covers the canvas.
    pub image: Raster,
    /// 0-based index of the sharpest slice; [`UNCOVERED`] where no slice covers the canvas.
    pub index: Plane<u16>,
    /// 255 where some slice covers the canvas, else 0.
    pub valid: Plane<u8>,
    /// What was measured, when it was wanted.
    pub quality: Option<StackQuality>,
    /// What the user should know.
    pub warnings: Vec<Warning>,
}

/// Fuses a stack by guided filtering.
///
/// Where nothing is sharp in any slice (saliency 0 everywhere), the reference slice is chosen if it covers the
/// pixel, else the first that does. The saliency of a slice counts only where all that it looks at is covered;
/// nearer to the rim of what a slice covers, that slice is chosen only if no other can be.
///
/// A stack has the depth and the channels of its first slice: grey slices among coloured ones and 8-bit slices
/// among 16-bit ones are brought to that form, the other way round is refused. Warped slices lie in an unnamed
/// file in `scratch_dir` until this returns.
///
/// # Errors
/// [`Interrupted::Cancelled`] when `control` says so; a fault that names the slice when one cannot be read, has
/// another size or form, or has a homography that cannot be inverted; a fault when the scratch file cannot be
/// written.
pub fn fuse(
    slices: &dyn Slices,
    plan: &Plan,
    watch: &Watch<'_>,
    scratch_dir: &Path,
    control: &dyn Control,
) -> Result<Fused, Interrupted> {
    plan.check(slices.count())?;
    if watch.object.is_some_and(|object| (object.width, object.height) != (plan.width, plan.height)) {
        return Err(Error::new(ErrorKind::Internal, "the mask is not of the size of the canvas").into());
    }
    control.check()?;
    control.progress("aligning", 0, slices.count());
    let first = slices.load(0)?;
    let run = Run { slices, plan, watch, scratch_dir, control, tile: blend::TILE };
    match Form::of(&first).map_err(|fault| fault.in_file(slices.name(0), Some(0)))? {
        Form { depth: Depth::Eight, channels: 1 } => run.fuse::<u8, 1>(first),
        Form { depth: Depth::Eight, .. } => run.fuse::<u8, 3>(first),
        Form { depth: Depth::Sixteen, channels: 1 } => run.fuse::<u16, 1>(first),
        Form { depth: Depth::Sixteen, .. } => run.fuse::<u16, 3>(first),
    }
}

/// One call of [`fuse`], with the size of the tiles.
struct Run<'a> {
    slices: &'a dyn Slices,
    plan: &'a Plan,
    watch: &'a Watch<'a>,
    scratch_dir: &'a Path,
    control: &'a dyn Control,
    tile: usize,
}

impl Run<'_> {
    fn fuse<S: Sample, const C: usize>(&self, first: Raster) -> Result<Fused, Interrupted> {
        let (width, height) = (self.plan.width, self.plan.height);
        let observer = observe::observer(self.plan, self.watch);
        let mut aligned = align::align::<S, C>(self, first, observer.as_ref())?;
        let alignment = observe::alignment::<S>(&aligned, self.plan, self.watch, self.control)?;
        let blended = match aligned.surveyed.take() {
            None if self.plan.method == Method::Pyramid => pyramid::blend::<S, C>(self, &aligned)?,
            None => blend::blend::<S, C>(self, &aligned)?,
            Some((energy, survey)) => {
                let (blended, labels) = halo_corrected::fuse::<S, C>(self, &aligned, &energy, survey)?;
                aligned.index = labels;
                blended
            }
        };
        let sums = match &observer {
            Some(observer) => observe::score::<S, C>(self, &aligned, observer.blocks(), &blended.pixels)?,
            None => ScoreSums::default(),
        };

        let valid = aligned.index.map(|slice| if slice == UNCOVERED { 0 } else { 255 });
        let quality = observe::finish(self, observer.as_ref(), aligned.seen, &sums, alignment, &aligned.index);
        let covered = valid.data.iter().filter(|&&v| v != 0).count();
        let image = Raster { width, height, channels: C, samples: S::wrap(blended.pixels) };
        let warnings = warnings(Rect::whole(width, height), covered, blended.clamped);
        Ok(Fused { image, index: aligned.index, valid, quality, warnings })
    }
}

fn warnings(canvas: Rect, covered: usize, clamped: usize) -> Vec<Warning> {
    let mut warnings = Vec::new();
    let pixels = canvas.width * canvas.height;
    if covered < pixels {
        let share = 100.0 * (pixels - covered) as f64 / pixels as f64;
        warnings.push(Warning::new(
            "canvas_not_covered",
            format!("{share:.2} % of the canvas is covered by no slice and is transparent; crop=valid cuts it off"),
        ));
    }
    let share = clamped as f64 / covered.max(1) as f64;
    if share > OVERSHOOT_WORTH_A_WARNING {
        warnings.push(Warning::new(
            "fusion_overshoot",
            format!(
                "{:.1} % of the fused pixels left the range of their bit depth and were clamped: look for halos, or \
                 expose the slices away from the ends of the range",
                100.0 * share
            ),
        ));
    }
    warnings
}

/// The guarded value; a thread that panicked with it leaves nothing half-written that would matter here.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The same, when the mutex is no longer needed.
fn unlocked<T>(mutex: Mutex<T>) -> T {
    mutex.into_inner().unwrap_or_else(PoisonError::into_inner)
}
