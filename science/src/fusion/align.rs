//! First pass: each slice warped onto the canvas, its saliency entered, and put into the scratch file.

use std::sync::{
    Mutex, OnceLock,
    atomic::{AtomicUsize, Ordering},
};

use rayon::prelude::*;

use super::{
    Run, form,
    halo_corrected::Survey,
    locked,
    measure::{Measure, Rows},
    scratch::Scratch,
    unlocked,
    winner::Winner,
};
use crate::{
    imaging::{Coverage, Plane, Raster, Sample, grey, warp::Warp},
    quality::slice::{Fingerprint, SliceMeasurements, SliceMeter, WarpedSlice},
    types::{Error, ErrorKind, Interrupted},
};

/// A slice in flight costs memory, and four keep a decoder's pauses filled.
const MOST_IN_FLIGHT: usize = 4;

/// How many slices are decoded and warped at the same time.
pub(super) fn lanes(threads: usize, slices: usize) -> usize {
    threads.min(MOST_IN_FLIGHT).min(slices).max(1)
}

/// What the first pass leaves to the second.
pub(super) struct Aligned {
    pub scratch: Scratch,
    /// Per slice: what it covers.
    pub coverages: Vec<Coverage>,
    /// The sharpest slice per pixel.
    pub index: Plane<u16>,
    /// What only fusion by labels asks for: how sharp that slice is there, and what was seen of wide surroundings.
    pub surveyed: Option<(Plane<f32>, Survey)>,
    /// What the observer noted, slice by slice; empty without an observer.
    pub seen: Vec<SliceMeasurements>,
}

/// Runs the first pass. `first` is slice 0, which is loaded already.
pub(super) fn align<S: Sample, const C: usize>(
    run: &Run<'_>,
    first: Raster,
    observer: Option<&SliceMeter<'_>>,
) -> Result<Aligned, Interrupted> {
    let plan = run.plan;
    let slices = plan.homographies.len();
    let pass = Pass::<S> {
        run,
        observer,
        scratch: Scratch::create(run.scratch_dir, plan.width, plan.height, C)?,
        winner: Winner::new(plan.width, plan.height, plan.reference),
        measure: Measure::of(plan),
        first: Mutex::new(Some(first)),
        buffers: Mutex::new(Vec::new()),
    };
    let (next, done) = (AtomicUsize::new(0), Mutex::new(0));
    let failure: Mutex<Option<(usize, Interrupted)>> = Mutex::new(None);
    let results: Vec<OnceLock<(Coverage, Option<SliceMeasurements>)>> = (0..slices).map(|_| OnceLock::new()).collect();

    // Lanes take slices one by one, so that never more are in flight than there are lanes.
    let lanes = lanes(rayon::current_num_threads(), slices);
    (0..lanes).into_par_iter().with_max_len(1).for_each(|_| {
        while locked(&failure).is_none() {
            let slice = next.fetch_add(1, Ordering::Relaxed);
            let Some(result) = results.get(slice) else { return };
            match pass.slice::<C>(slice) {
                Ok(outcome) => {
                    // each slice is taken by one lane only, so that the cell is empty
                    let _ = result.set(outcome);
                    let mut done = locked(&done);
                    *done += 1;
                    run.control.progress("aligning", *done, slices);
                }
                Err(stop) => {
                    let mut failure = locked(&failure);
                    if failure.as_ref().is_none_or(|(other, _)| slice < *other) {
                        *failure = Some((slice, stop));
                    }
                }
            }
        }
    });
    if let Some((_, stop)) = unlocked(failure) {
        return Err(stop);
    }
    let (coverages, seen): (Vec<_>, Vec<_>) = results.into_iter().filter_map(OnceLock::into_inner).unzip();
    let seen = seen.into_iter().flatten().collect();
    let (index, surveyed) = match pass.measure.into_survey() {
        None => (pass.winner.finish(), None),
        Some(survey) => {
            let (index, values) = pass.winner.finish_with_values();
            (index, Some((values, survey)))
        }
    };
    Ok(Aligned { scratch: pass.scratch, coverages, index, surveyed, seen })
}

/// What all slices of the first pass share.
struct Pass<'a, S> {
    run: &'a Run<'a>,
    observer: Option<&'a SliceMeter<'a>>,
    scratch: Scratch,
    winner: Winner,
    measure: Measure,
    first: Mutex<Option<Raster>>,
    /// Room for warped slices, at most one per lane: new memory costs as much as a filter.
    buffers: Mutex<Vec<Vec<S>>>,
}

impl<S: Sample> Pass<'_, S> {
    fn slice<const C: usize>(&self, slice: usize) -> Result<(Coverage, Option<SliceMeasurements>), Interrupted> {
        let plan = self.run.plan;
        self.run.control.check()?;
        let samples = self.load::<C>(slice)?;
        self.run.control.check()?;
        let fingerprint = self.observer.map(|_| Fingerprint::of(&samples, C, plan.width, plan.height));

        let size = (plan.width, plan.height);
        let warp = Warp::new(&plan.homographies[slice], plan.gains[slice], size, size).ok_or_else(|| {
            Error::new(ErrorKind::InvalidProfile, format!("the homography of slice {slice} cannot be inverted"))
        })?;
        let buffer = locked(&self.buffers).pop().unwrap_or_default();
        let warped = warp.apply_unless(samples, C, buffer, || self.run.control.check())?;
        self.scratch.write(slice, &warped)?;
        let coverage = warp.coverage().clone();
        let seen = self.measure::<C>(slice, &warped, &coverage, fingerprint)?;
        locked(&self.buffers).push(warped);
        Ok((coverage, seen))
    }

    fn load<const C: usize>(&self, slice: usize) -> Result<Vec<S>, Interrupted> {
        let loaded = if slice == 0 { locked(&self.first).take() } else { None };
        let raster = match loaded {
            Some(raster) => raster,
            None => self.run.slices.load(slice)?,
        };
        let (plan, name) = (self.run.plan, self.run.slices.name(slice));
        if (raster.width, raster.height) != (plan.width, plan.height) {
            let detail = format!(
                "'{name}' (slice {slice}) is {} x {} px; the profile is for {} x {} px: use the camera's settings of \
                 the calibration",
                raster.width, raster.height, plan.width, plan.height
            );
            return Err(Error::new(ErrorKind::SizeMismatch, detail).in_file(name, Some(slice as u32)).into());
        }
        Ok(form::samples_in_form::<S, C>(raster, name, slice)?)
    }

    /// Saliency of a warped slice: entered into the running argmax, and shown to the observer.
    fn measure<const C: usize>(
        &self,
        slice: usize,
        warped: &[S],
        covered: &Coverage,
        fingerprint: Option<Fingerprint>,
    ) -> Result<Option<SliceMeasurements>, Interrupted> {
        let plan = self.run.plan;
        let (width, height) = (plan.width, plan.height);
        let supported = covered.eroded(self.measure.reach());

        let mut sheet = self.measure.sheet();
        let of_band = |rows: &mut Rows, (band, cells): (usize, &mut [f32])| -> Result<Vec<f32>, Interrupted> {
            self.run.control.check()?;
            let mut picked = Vec::new();
            let luma_of = |y: usize, out: &mut [f32]| {
                grey::luma_row(&warped[y * width * C..(y + 1) * width * C], C, out);
            };
            let band = self.winner.rows(band);
            let levels = self.observer.is_some();
            self.measure.rows((width, height), band.clone(), rows, levels, luma_of, |y, values, saliency| {
                self.winner.update(y, slice, values, covered, &supported);
                let sure = supported.span(y);
                if let Some(observer) = self.observer {
                    observer.points().pick(y, saliency, &sure, &mut picked);
                }
                self.measure.note(cells, y - band.start, values, sure);
            });
            Ok(picked)
        };
        let cells = self.measure.cells_of(super::winner::BAND);
        let mut parts: Vec<&mut [f32]> = sheet.chunks_mut(cells.max(1)).collect();
        parts.resize_with(self.winner.bands(), Default::default);
        let bands = parts.into_par_iter().enumerate();
        let picked: Vec<Vec<f32>> = bands.map_init(Rows::default, of_band).collect::<Result<_, Interrupted>>()?;
        self.measure.enter(slice, sheet);

        let seen = self.observer.zip(fingerprint).map(|(observer, fingerprint)| {
            let warped = WarpedSlice { samples: warped, channels: C, coverage: covered, gain: plan.gains[slice] };
            observer.measure(slice, &warped, picked.concat(), fingerprint)
        });
        Ok(seen)
    }
}
