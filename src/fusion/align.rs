//! First pass: each slice warped onto the canvas, its saliency entered, and put into the scratch file.

use std::sync::{
    Mutex, OnceLock,
    atomic::{AtomicUsize, Ordering},
};

use rayon::prelude::*;

use super::{Run, form, locked, scratch::Scratch, unlocked, winner::Winner};
use crate::{
    imaging::{Coverage, Plane, Raster, Sample, filter::saliency::Saliency, grey, warp::Warp},
    model::{Code, Fault, Stop},
    quality::slice::{Fingerprint, Observer, Seen, Warped},
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
    /// What the observer noted, slice by slice; empty without an observer.
    pub seen: Vec<Seen>,
}

/// Runs the first pass. `first` is slice 0, which is loaded already.
pub(super) fn align<S: Sample, const C: usize>(
    run: &Run<'_>,
    first: Raster,
    observer: Option<&Observer<'_>>,
) -> Result<Aligned, Stop> {
    let plan = run.plan;
    let slices = plan.homographies.len();
    let pass = Pass {
        run,
        observer,
        scratch: Scratch::create(run.scratch_dir, plan.width, plan.height, C)?,
        winner: Winner::new(plan.width, plan.height, plan.reference),
        saliency: Saliency::new(plan.params.r_g as usize, plan.params.sigma_g),
        first: Mutex::new(Some(first)),
    };
    let (next, done) = (AtomicUsize::new(0), Mutex::new(0));
    let failure: Mutex<Option<(usize, Stop)>> = Mutex::new(None);
    let results: Vec<OnceLock<(Coverage, Option<Seen>)>> = (0..slices).map(|_| OnceLock::new()).collect();

    // Lanes take slices one by one, so that never more are in flight than there are lanes.
    let lanes = lanes(rayon::current_num_threads(), slices);
    (0..lanes).into_par_iter().with_max_len(1).for_each(|_| {
        while locked(&failure).is_none() {
            let slice = next.fetch_add(1, Ordering::Relaxed);
            let Some(result) = results.get(slice) else { return };
            match pass.slice::<S, C>(slice) {
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
    Ok(Aligned { scratch: pass.scratch, coverages, index: pass.winner.finish(), seen })
}

/// What all slices of the first pass share.
struct Pass<'a> {
    run: &'a Run<'a>,
    observer: Option<&'a Observer<'a>>,
    scratch: Scratch,
    winner: Winner,
    saliency: Saliency,
    first: Mutex<Option<Raster>>,
}

impl Pass<'_> {
    fn slice<S: Sample, const C: usize>(&self, slice: usize) -> Result<(Coverage, Option<Seen>), Stop> {
        let plan = self.run.plan;
        self.run.control.check()?;
        let samples = self.load::<S, C>(slice)?;
        self.run.control.check()?;
        let fingerprint = self.observer.map(|_| Fingerprint::of(&samples, C, plan.width, plan.height));

        let size = (plan.width, plan.height);
        let warp = Warp::new(&plan.homographies[slice], plan.gains[slice], size, size).ok_or_else(|| {
            Fault::new(Code::InvalidProfile, format!("the homography of slice {slice} cannot be inverted"))
        })?;
        let warped = warp.apply_unless(samples, C, || self.run.control.check())?;
        self.scratch.write(slice, &warped)?;
        let coverage = warp.coverage().clone();
        let seen = self.measure::<S, C>(slice, &warped, &coverage, fingerprint)?;
        Ok((coverage, seen))
    }

    fn load<S: Sample, const C: usize>(&self, slice: usize) -> Result<Vec<S>, Stop> {
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
            return Err(Fault::new(Code::SizeMismatch, detail).in_file(name, Some(slice as u32)).into());
        }
        Ok(form::samples_in_form::<S, C>(raster, name, slice)?)
    }

    /// Saliency of a warped slice: entered into the running argmax, and shown to the observer.
    fn measure<S: Sample, const C: usize>(
        &self,
        slice: usize,
        warped: &[S],
        covered: &Coverage,
        fingerprint: Option<Fingerprint>,
    ) -> Result<Option<Seen>, Stop> {
        let plan = self.run.plan;
        let (width, height) = (plan.width, plan.height);
        let supported = covered.eroded(self.saliency.reach());

        let of_band = |band: usize| -> Result<Vec<f32>, Stop> {
            self.run.control.check()?;
            let rows = self.winner.rows(band);
            let start = rows.start;
            let mut values = vec![0.0f32; rows.len() * width];
            let mut picked = Vec::new();
            let luma_of = |y: usize, out: &mut [f32]| {
                grey::luma_row(&warped[y * width * C..(y + 1) * width * C], C, out);
            };
            self.saliency.rows((width, height), rows, luma_of, |y, _, saliency| {
                values[(y - start) * width..(y - start + 1) * width].copy_from_slice(saliency);
                if let Some(observer) = self.observer {
                    observer.points().pick(y, saliency, &supported.span(y), &mut picked);
                }
            });
            self.winner.update(band, slice, &values, covered, &supported);
            Ok(picked)
        };
        let picked: Vec<Vec<f32>> =
            (0..self.winner.bands()).into_par_iter().map(of_band).collect::<Result<_, Stop>>()?;

        let seen = self.observer.zip(fingerprint).map(|(observer, fingerprint)| {
            let warped = Warped { samples: warped, channels: C, coverage: covered, gain: plan.gains[slice] };
            observer.slice(slice, &warped, picked.concat(), fingerprint)
        });
        Ok(seen)
    }
}
