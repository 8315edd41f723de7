//! From slice to slice: where to begin, and how the grid is carried outward from there.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::lattice::Places;
use super::search::Motion;
use super::sharpness;
use super::sighting::{self, Sighting, Target};
use super::working::median;
use crate::imaging::{Plane, Slices};
use crate::model::error::FaultPlace;
use crate::model::{Code, Control, Fault, Stop};

/// What the whole stack showed.
#[derive(Debug)]
pub struct Seen {
    /// Width of every slice, px.
    pub width: usize,
    /// Height of every slice, px.
    pub height: usize,
    /// What the target is like.
    pub target: Target,
    /// Per slice its dots; `None` where the grid could not be seen.
    pub sightings: Vec<Option<Sighting>>,
}

/// Slices that are judged for sharpness.
const JUDGED: usize = 9;
/// Slices in which the grid is looked for before giving up.
const TRIED: usize = 4;

/// Looks at every slice.
///
/// # Errors
/// A fault when no slice shows a grid, when slices differ in size, or when one cannot be loaded.
pub fn see_all(slices: &dyn Slices, control: &dyn Control) -> Result<Seen, Stop> {
    let count = slices.count();
    let loader = Loader::new(slices, control)?;
    let mut judged = Vec::new();
    let candidates = sharpness::spread(count, JUDGED);
    for (done, &index) in candidates.iter().enumerate() {
        control.check()?;
        control.progress("surveying", done, candidates.len());
        judged.push((sharpness::of(&loader.load(index)?), index));
    }
    judged.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let done = AtomicUsize::new(0);
    let tick = || control.progress("detecting", done.fetch_add(1, Ordering::Relaxed) + 1, count);
    control.progress("detecting", 0, count);
    let mut first = None;
    for &(_, index) in judged.iter().take(TRIED) {
        let luma = loader.load(index)?;
        let Some((target, lattice)) = sighting::blind(&luma, control)? else { continue };
        if let Some(sighting) = sighting::observe(&luma, target, &lattice.places, control)? {
            first = Some((index, target, sighting));
            break;
        }
    }
    let Some((start, target, sighting)) = first else { return Err(no_grid(slices, &judged).into()) };
    tick();
    let carry = |indices: Vec<usize>| carry(&loader, target, &sighting, indices, control, &tick);
    let (up, down) = rayon::join(|| carry((start + 1..count).collect()), || carry((0..start).rev().collect()));
    let (up, down) = (up?, down?);
    let mut sightings: Vec<Option<Sighting>> = down.into_iter().rev().collect();
    sightings.push(Some(sighting));
    sightings.extend(up);
    Ok(Seen { width: loader.width, height: loader.height, target, sightings })
}

/// Follows the grid through `indices`, which lead away from the slice of `from`. One answer per index.
fn carry(
    loader: &Loader,
    target: Target,
    from: &Sighting,
    indices: Vec<usize>,
    control: &dyn Control,
    tick: &(dyn Fn() + Sync),
) -> Result<Vec<Option<Sighting>>, Stop> {
    let mut places: Places = from.places();
    // scale from one slice to the next as far as it is known, and slices since the last that was seen
    let (mut steps, mut gap): (Vec<f64>, i32) = (Vec::new(), 1);
    let mut all = Vec::with_capacity(indices.len());
    for index in indices {
        control.check()?;
        let luma = loader.load(index)?;
        let step = if steps.is_empty() { 1.0 } else { median(&mut steps.clone()) };
        let around = Motion { scale: step.powi(gap), shift: [0.0, 0.0] };
        let seen = sighting::follow(&luma, target, &places, around, control)?;
        match &seen {
            Some(sighting) => {
                steps.push(sighting.step_scale.powf(1.0 / f64::from(gap)));
                if steps.len() > 3 {
                    steps.remove(0);
                }
                places = sighting.places();
                gap = 1;
            }
            None => gap += 1,
        }
        all.push(seen);
        tick();
    }
    Ok(all)
}

/// Loads slices as grey and holds them to one size.
struct Loader<'a> {
    slices: &'a dyn Slices,
    width: usize,
    height: usize,
    first: usize,
}

impl<'a> Loader<'a> {
    fn new(slices: &'a dyn Slices, control: &dyn Control) -> Result<Self, Stop> {
        control.check()?;
        let first = slices.count() / 2;
        let raster = slices.load(first)?;
        let (width, height) = (raster.width, raster.height);
        if width < 16 || height < 16 {
            let detail = format!("{} is {width} x {height} px; a slice has at least 16 x 16", slices.name(first));
            return Err(Fault::new(Code::TargetNotFound, detail)
                .in_file(slices.name(first), Some(first as u32))
                .into());
        }
        Ok(Self { slices, width, height, first })
    }

    fn load(&self, index: usize) -> Result<Plane<f32>, Fault> {
        let raster = self.slices.load(index)?;
        if (raster.width, raster.height) != (self.width, self.height) {
            let (name, other) = (self.slices.name(index), self.slices.name(self.first));
            let detail = format!(
                "{name} is {} x {} px and {other} is {} x {}: all slices of a stack have one size",
                raster.width, raster.height, self.width, self.height
            );
            return Err(Fault::new(Code::SizeMismatch, detail).in_file(name, Some(index as u32)));
        }
        Ok(raster.luma())
    }
}

fn no_grid(slices: &dyn Slices, judged: &[(f64, usize)]) -> Fault {
    let looked: Vec<usize> = judged.iter().take(TRIED).map(|(_, index)| *index).collect();
    let names: Vec<&str> = looked.iter().map(|&index| slices.name(index)).collect();
    let detail = format!(
        "no grid of dots was found in the sharpest slices ({}): the target needs at least 12 whole round dots in \
         3 rows and 3 columns, sharp in one slice, with even light",
        names.join(", ")
    );
    let mut fault = Fault::new(Code::TargetNotFound, detail);
    for index in looked {
        fault = fault.at(FaultPlace {
            detail: "no grid of dots in this slice".into(),
            pointer: None,
            file: Some(slices.name(index).to_owned()),
            slice: Some(index as u32),
        });
    }
    fault
}
