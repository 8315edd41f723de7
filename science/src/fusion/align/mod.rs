//! First pass: resamples each slice to the canvas, measures its focus, and writes it to the scratch file.
//!
//! In: the slices and the plan. Out: [`Aligned`]. Slices are processed in parallel, in any order; the result does not
//! depend on the order.

pub(super) mod coarse_focus;
pub(super) mod focus_measure;
pub(super) mod relevance;
mod scratch;
mod sharpest;

use std::sync::{
    Mutex, OnceLock,
    atomic::{AtomicUsize, Ordering},
};

use rayon::prelude::*;

use super::run::{Run, locked, unlocked};
use crate::{
    imaging::{Coverage, Plane, Sample, grey},
    quality::slice::{Fingerprint, SliceMeasurements, SliceMeter, WarpedSlice},
    types::Interrupted,
};
use coarse_focus::CoarseFocus;
use focus_measure::{FocusMeasure, RowBuffers};
use relevance::CellEnergies;
pub(super) use scratch::{BLOCK as SCRATCH_BLOCK, ScratchFile};
use sharpest::Sharpest;

/// Most slices in flight. Each costs memory; four keep all threads busy while decoders run on one thread.
const MAX_IN_FLIGHT: usize = 4;

/// Number of lanes, each with one slice in flight.
pub(super) fn lanes(threads: usize, slices: usize) -> usize {
    threads.min(MAX_IN_FLIGHT).min(slices).max(1)
}

/// What the first pass hands to the second.
pub(super) struct Aligned {
    /// The warped slices.
    pub scratch: ScratchFile,
    /// Per slice: the part of the canvas that it covers.
    pub coverages: Vec<Coverage>,
    /// Per pixel: the slice with the largest focus measure.
    pub index: Plane<u16>,
    /// Only with [`FocusMeasure::Energy`].
    pub energy: Option<MeasuredEnergy>,
    /// Per slice: what the meter measured; empty without a meter.
    pub measurements: Vec<SliceMeasurements>,
}

/// What the first pass knows of the focus energy.
pub(super) struct MeasuredEnergy {
    /// Per pixel, the largest energy of all slices.
    pub largest: Plane<f32>,
    /// The coarse focus.
    pub coarse: CoarseFocus,
    /// The energy of each slice in cells.
    pub cells: CellEnergies,
}

/// Runs the first pass.
///
/// # Errors
/// The error of the failed slice with the lowest index.
pub(super) fn align<S: Sample, const C: usize>(
    run: &Run<'_>,
    focus: FocusMeasure,
    meter: Option<&SliceMeter<'_>>,
) -> Result<Aligned, Interrupted> {
    let plan = run.plan;
    let slices = plan.slices.len();
    let pass = Pass::<S> {
        run,
        meter,
        scratch: ScratchFile::create(run.scratch_dir, plan.width, plan.height, C)?,
        sharpest: Sharpest::new(plan.width, plan.height, plan.reference),
        cells: match focus {
            FocusMeasure::Saliency(_) => None,
            FocusMeasure::Energy(..) => Some(CellEnergies::create(run.scratch_dir, plan.width, plan.height)?),
        },
        focus,
        buffers: Mutex::new(Vec::new()),
    };
    let (next, done) = (AtomicUsize::new(0), Mutex::new(0));
    let failure: Mutex<Option<(usize, Interrupted)>> = Mutex::new(None);
    let results: Vec<OnceLock<(Coverage, Option<SliceMeasurements>)>> = (0..slices).map(|_| OnceLock::new()).collect();

    // Each lane takes one slice at a time, so there are never more slices in flight than lanes.
    let lanes = lanes(rayon::current_num_threads(), slices);
    (0..lanes).into_par_iter().with_max_len(1).for_each(|_| {
        while locked(&failure).is_none() {
            let slice = next.fetch_add(1, Ordering::Relaxed);
            let Some(result) = results.get(slice) else { return };
            match pass.slice::<C>(slice) {
                Ok(outcome) => {
                    // only one lane takes this slice, so the cell is empty
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
    run.slices.free_memory();
    if let Some((_, stop)) = unlocked(failure) {
        return Err(stop);
    }
    let (coverages, measurements): (Vec<_>, Vec<_>) = results.into_iter().filter_map(OnceLock::into_inner).unzip();
    let measurements = measurements.into_iter().flatten().collect();
    let (index, energy) = match (pass.focus, pass.cells) {
        (FocusMeasure::Energy(_, coarse), Some(cells)) => {
            let (index, largest) = pass.sharpest.finish_with_values();
            (index, Some(MeasuredEnergy { largest, coarse, cells }))
        }
        (FocusMeasure::Saliency(_) | FocusMeasure::Energy(..), _) => (pass.sharpest.finish(), None),
    };
    Ok(Aligned { scratch: pass.scratch, coverages, index, energy, measurements })
}

/// What all lanes share.
struct Pass<'a, S> {
    run: &'a Run<'a>,
    meter: Option<&'a SliceMeter<'a>>,
    scratch: ScratchFile,
    sharpest: Sharpest,
    focus: FocusMeasure,
    /// Only with [`FocusMeasure::Energy`].
    cells: Option<CellEnergies>,
    /// Buffers for warped slices, at most one per lane: fresh memory costs as much as a filter.
    buffers: Mutex<Vec<Vec<S>>>,
}

impl<S: Sample> Pass<'_, S> {
    /// Processes slice `slice`; returns what it covers and its measurements.
    fn slice<const C: usize>(&self, slice: usize) -> Result<(Coverage, Option<SliceMeasurements>), Interrupted> {
        let (plan, control) = (self.run.plan, self.run.control);
        control.check()?;
        let samples = self.run.slices.load::<S, C>(slice)?;
        control.check()?;
        let fingerprint = self.meter.map(|_| Fingerprint::of(&samples, C, plan.width, plan.height));

        let warp = plan.warp(slice)?;
        let buffer = locked(&self.buffers).pop().unwrap_or_default();
        let (warped, spare) = warp.resample_cancellable(samples, C, buffer, || control.check())?;
        self.run.slices.recycle(spare);
        self.scratch.write(slice, &warped)?;
        let coverage = warp.coverage().clone();
        let measurements = self.measure::<C>(slice, &warped, &coverage, fingerprint)?;
        locked(&self.buffers).push(warped);
        Ok((coverage, measurements))
    }

    /// Measures the focus of a warped slice and updates the running argmax and the coarse focus. The meter gets the
    /// same values.
    fn measure<const C: usize>(
        &self,
        slice: usize,
        warped: &[S],
        covered: &Coverage,
        fingerprint: Option<Fingerprint>,
    ) -> Result<Option<SliceMeasurements>, Interrupted> {
        let plan = self.run.plan;
        let (width, height) = (plan.width, plan.height);
        let supported = covered.eroded(self.focus.reach());

        let mut cells = self.focus.cells();
        let of_band = |buffers: &mut RowBuffers, (band, cells): (usize, &mut [f32])| -> Result<Vec<f32>, Interrupted> {
            self.run.control.check()?;
            let mut picked = Vec::new();
            let luma_of = |y: usize, out: &mut [f32]| {
                grey::luma_row(&warped[y * width * C..(y + 1) * width * C], C, out);
            };
            let band = self.sharpest.rows(band);
            let in_grey_levels = self.meter.is_some();
            let size = (width, height);
            self.focus.rows(size, band.clone(), buffers, in_grey_levels, luma_of, |y, values, grey_levels| {
                self.sharpest.update(y, slice, values, covered, &supported);
                let columns = supported.span(y);
                if let Some(meter) = self.meter {
                    meter.points().pick(y, grey_levels, &columns, &mut picked);
                }
                self.focus.add_to_cells(cells, y - band.start, values, columns);
            });
            Ok(picked)
        };
        let cells_of_band = self.focus.cells_in_rows(sharpest::BAND);
        let mut parts: Vec<&mut [f32]> = cells.chunks_mut(cells_of_band.max(1)).collect();
        parts.resize_with(self.sharpest.bands(), Default::default);
        let bands = parts.into_par_iter().enumerate();
        let picked: Vec<Vec<f32>> = bands.map_init(RowBuffers::default, of_band).collect::<Result<_, Interrupted>>()?;
        if let Some(energies) = &self.cells {
            energies.write(slice, &cells)?;
        }
        self.focus.enter_cells(slice, cells);

        let measurements = self.meter.zip(fingerprint).map(|(meter, fingerprint)| {
            let gain = plan.slices[slice].gain;
            let warped = WarpedSlice { samples: warped, channels: C, coverage: covered, gain };
            meter.measure(slice, &warped, picked.concat(), fingerprint)
        });
        Ok(measurements)
    }
}
