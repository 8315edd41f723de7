//! First pass: resamples each slice to the canvas, measures its focus, and writes it to the scratch file.
//!
//! In: the slices and the plan. Out: [`Aligned`]. Slices are processed in parallel, in any order; the result does not
//! depend on the order. A slice is decoded by one thread and then processed in bands of rows by all threads that are
//! free ([`schedule`]). Each row is warped, measured and stored while it is in the processor's cache
//! ([`decoded_slice`]), so a warped slice is never in memory as a whole. When all are stored, the brightness of the
//! slices is compared, and those that flicker are equalised ([`equalisation`]).

pub(super) mod cell_energies;
pub(super) mod coarse_focus;
mod decoded_slice;
mod equalisation;
pub(super) mod focus_code;
pub(super) mod focus_measure;
pub(super) mod relevance;
mod schedule;
mod scratch;
mod sharpest;

use std::sync::{Arc, Mutex, OnceLock};

use rayon::Scope;

use super::{
    in_flight::slices_in_flight,
    lock::{Spare, locked},
    run::Run,
};
use crate::{
    imaging::{Coverage, Plane, Rect, Sample},
    quality::{
        flicker,
        slice::{Brightness, Cells, Fingerprint, RowMeasurements, SliceMeasurements, SliceMeter, WarpedSlice},
    },
    types::{Error, ErrorKind, Interrupted},
};
use cell_energies::CellEnergies;
use coarse_focus::CoarseFocus;
use decoded_slice::{BandContext, Buffers, DecodedSlice};
use focus_code::FocusCode;
use focus_measure::FocusMeasure;
use schedule::{Schedule, Step};
pub(super) use scratch::{BLOCK as SCRATCH_BLOCK, ScratchFile};
use sharpest::Sharpest;

/// What the first pass hands to the second.
pub(super) struct Aligned {
    /// The warped slices.
    pub scratch: ScratchFile,
    /// Per slice: the part of the canvas that it covers.
    pub coverages: Vec<Coverage>,
    /// Per pixel: the slice with the largest focus measure, or after a method has refined it, that of its decision map.
    pub index: Arc<Plane<u16>>,
    /// Only with [`FocusMeasure::Energy`].
    pub energy: Option<MeasuredEnergy>,
    /// Per slice: what the meter measured; empty without a meter.
    pub measurements: Vec<SliceMeasurements>,
}

/// What the first pass knows of the focus energy.
pub(super) struct MeasuredEnergy {
    /// Per pixel, the largest energy of all slices.
    pub largest: Plane<FocusCode>,
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
    let (slices, threads) = (plan.slices.len(), rayon::current_num_threads());
    let in_flight = slices_in_flight(threads, slices);
    let (width, height) = (plan.width, plan.height);
    let (mut index, mut largest) = (Plane::filled(width, height, 0), Plane::filled(width, height, FocusCode::NONE));
    let pass = Pass::<S> {
        run,
        cells: match focus {
            FocusMeasure::Saliency(_) => None,
            FocusMeasure::Energy(..) => Some(CellEnergies::create(run.scratch_dir, width, height)?),
        },
        bands: BandContext {
            plan,
            meter,
            light: Cells::of(width, height),
            scratch: ScratchFile::create(run.scratch_dir, width, height, C)?,
            sharpest: Sharpest::new(&mut index, &mut largest, plan.reference),
            focus,
        },
        schedule: Schedule::new(slices, in_flight),
        buffers: Spare::new(),
        done: Mutex::new(0),
        results: (0..slices).map(|_| OnceLock::new()).collect(),
    };
    rayon::scope(|scope| pass.call_threads::<C>(scope, in_flight));
    run.slices.free_memory();
    let Pass { bands: BandContext { scratch, focus, .. }, cells, schedule, results, .. } = pass;
    schedule.finish()?;
    let results = results.into_iter().filter_map(OnceLock::into_inner);
    let (coverages, (brightness, measurements)): (Vec<_>, (Vec<_>, Vec<_>)) = results.unzip();
    let measurements = measurements.into_iter().flatten().collect();
    let gains: Vec<f64> = plan.slices.iter().map(|slice| slice.gain).collect();
    scratch.equalise::<S>(&flicker::corrections(&brightness, &gains, plan.reference), run.control)?;
    let energy = match (focus, cells) {
        (FocusMeasure::Energy(_, coarse), Some(cells)) => Some(MeasuredEnergy { largest, coarse, cells }),
        (FocusMeasure::Saliency(_) | FocusMeasure::Energy(..), _) => None,
    };
    Ok(Aligned { scratch, coverages, index: Arc::new(index), energy, measurements })
}

/// What is kept of a finished slice: what it covers, its brightness, and its measurements.
type Finished = (Coverage, (Brightness, Option<SliceMeasurements>));

/// What all threads share.
struct Pass<'a, S> {
    run: &'a Run<'a>,
    bands: BandContext<'a>,
    /// Only with [`FocusMeasure::Energy`].
    cells: Option<CellEnergies>,
    schedule: Schedule<DecodedSlice<S>>,
    buffers: Spare<Buffers<S>>,
    /// Number of finished slices.
    done: Mutex<usize>,
    /// Per finished slice.
    results: Vec<OnceLock<Finished>>,
}

impl<S: Sample> Pass<'_, S> {
    /// Lets up to `threads` more threads work.
    fn call_threads<'s, const C: usize>(&'s self, scope: &Scope<'s>, threads: usize) {
        (0..threads).for_each(|_| scope.spawn(|scope| self.work::<C>(scope)));
    }

    /// Does steps until there is nothing to do. No step waits for other threads: it could be made to wait for the very
    /// thread that it runs on.
    fn work<'s, const C: usize>(&'s self, scope: &Scope<'s>) {
        while let Some(step) = self.schedule.next() {
            let (slice, outcome) = match step {
                Step::Decode(slice) => {
                    let decoded = self.decode::<C>(slice).map(|decoded| {
                        let bands = decoded.bands();
                        self.schedule.decoded(decoded, bands);
                        self.call_threads::<C>(scope, bands.min(rayon::current_num_threads()) - 1);
                    });
                    (slice, decoded)
                }
                Step::Band(slice, band) => (slice.index, self.band::<C>(slice, band)),
            };
            if let Err(stop) = outcome {
                self.schedule.failed(slice, stop);
            }
        }
    }

    fn decode<const C: usize>(&self, slice: usize) -> Result<DecodedSlice<S>, Interrupted> {
        let (plan, control) = (self.run.plan, self.run.control);
        control.check()?;
        let samples = self.run.slices.load::<S, C>(slice)?;
        let fingerprint = self.bands.meter.map(|_| Fingerprint::of(&samples, C, plan.width, plan.height));
        Ok(DecodedSlice::new(slice, samples, plan.warp(slice)?, self.bands.focus.reach(), fingerprint))
    }

    /// Processes a band of `slice`, and finishes the slice with its last one.
    fn band<const C: usize>(&self, slice: Arc<DecodedSlice<S>>, band: usize) -> Result<(), Interrupted> {
        self.run.control.check()?;
        self.buffers.with(Buffers::default, |buffers| slice.process::<C>(&self.bands, band, buffers))?;
        match Arc::into_inner(slice) {
            // a band that failed on another thread is missing: its error ends the fusion
            Some(slice) if slice.is_complete() => self.finish::<C>(slice),
            _ => Ok(()),
        }
    }

    /// Enters what was found in a slice into the coarse focus and the results.
    fn finish<const C: usize>(&self, slice: DecodedSlice<S>) -> Result<(), Interrupted> {
        let (plan, index) = (self.run.plan, slice.index);
        let DecodedSlice { samples, warp, fingerprint, found, .. } = slice;
        self.run.slices.recycle(samples);
        self.schedule.freed();

        let (cells, rows): (Vec<_>, Vec<_>) = found.into_iter().filter_map(OnceLock::into_inner).unzip();
        let cells = cells.concat();
        if let Some(energies) = &self.cells {
            energies.write(index, &cells)?;
        }
        self.bands.focus.enter_cells(index, cells);

        let coverage = warp.coverage().clone();
        let read = |rect: Rect| {
            let mut samples = Vec::new();
            self.bands.scratch.read::<S>(index, rect, &mut samples, &mut Vec::new()).map(|()| samples)
        };
        let warped = WarpedSlice { samples: &read, channels: C, coverage: &coverage, gain: plan.slices[index].gain };
        let rows = RowMeasurements::join(rows);
        let brightness = rows.brightness::<S>(self.bands.light, &coverage, C, warped.gain);
        let measure = |(meter, fingerprint): (&SliceMeter<'_>, Fingerprint)| {
            meter.measure(index, &warped, rows, brightness.clone(), fingerprint)
        };
        let measurements = self.bands.meter.zip(fingerprint).map(measure).transpose()?;
        self.results[index]
            .set((coverage, (brightness, measurements)))
            .map_err(|_| Error::new(ErrorKind::Internal, "a slice was processed twice"))?;
        let mut done = locked(&self.done);
        *done += 1;
        self.run.control.progress("aligning", *done, plan.slices.len());
        Ok(())
    }
}
