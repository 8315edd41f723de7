//! The dots of one slice: found blindly in the first slice, followed from slice to slice in the others.

use std::collections::BTreeMap;

use super::blobs;
use super::centres::{self, Effort, Measured, Sought};
use super::field::{Field, Polarity};
use super::lattice::{self, LEAST_DOTS, Label, Lattice, Places};
use super::robust;
use super::search::{Motion, Search};
use super::working::{Working, median};
use crate::imaging::Plane;
use crate::model::{Cancelled, Control};

/// A dot in px of its slice.
#[derive(Debug, Clone, Copy)]
pub struct Spotted {
    /// Centre.
    pub at: [f64; 2],
    /// Standard deviation of each coordinate.
    pub sigma: f64,
}

/// What one slice showed. Holds no pixels.
#[derive(Debug, Clone)]
pub struct Sighting {
    /// The dots.
    pub dots: BTreeMap<Label, Spotted>,
    /// Distance of neighbouring dots, px of the slice.
    pub pitch: f64,
    /// Scale against the slice that it was followed from (greater: dots farther apart).
    pub step_scale: f64,
    /// Share of the pixels at full scale.
    pub clipped: f64,
    /// Ink of one dot times its area, px^2 of the slice times grey levels for bright dots.
    pub flux: f64,
    field: Field,
    bin: usize,
}

impl Sighting {
    /// Where the dots are.
    pub fn places(&self) -> Places {
        self.dots.iter().map(|(label, dot)| (*label, dot.at)).collect()
    }

    /// Level of the ground at a pixel of the slice, 0..255.
    pub fn ground_at(&self, p: [f64; 2]) -> f64 {
        let k = self.bin as f64;
        self.field.ground_at(p.map(|v| (v - (k - 1.0) / 2.0) / k))
    }
}

/// What stays the same for all slices of a stack once the first has been seen.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// Dark or bright dots.
    pub polarity: Polarity,
    /// Resolution that dots are measured at: pixels per sample along each axis.
    pub bin: usize,
}

/// Long side of the picture in which dots are looked for blindly.
const BLIND_SIDE: usize = 2400;
/// Dots are measured in a picture in which they are at least this far apart, px.
const MEASURED_PITCH: f64 = 32.0;
/// In the picture for the rough measurement they are at least this far apart, px.
const COARSE_PITCH: f64 = 10.0;
/// Rounds of the measurement.
const ROUNDS: usize = 8;
/// Rounds when places and light are nearly right already.
const SETTLED_ROUNDS: usize = 4;
/// Standard errors by which predicted dots must stand out to be believed.
const SURE: f64 = 6.0;

/// The grid in a slice about which nothing is known, in px of the slice, or `None` when there is none.
///
/// # Errors
/// When the work is cancelled.
pub fn blind(luma: &Plane<f32>, control: &dyn Control) -> Result<Option<(Target, Lattice)>, Cancelled> {
    let bin = luma.width.max(luma.height).div_ceil(BLIND_SIDE).max(1);
    let working = Working::new(luma, bin);
    let likely = Polarity::guess(&working.plane);
    for polarity in [likely, likely.other()] {
        let ink = Field::first(&working.plane, polarity).ink(&working.plane);
        let mut best: Option<Lattice> = None;
        let largest = working.plane.width.min(working.plane.height) / 4;
        let mut radius = 6;
        while radius <= largest.max(6) {
            control.check()?;
            let found = lattice::index(&blobs::find(&ink, radius));
            // a wider surrounding than the steps of the grid tells nothing new
            if best.as_ref().is_some_and(|b| radius as f64 > 2.0 * b.pitch) {
                break;
            }
            if let Some(found) = found
                && best.as_ref().is_none_or(|b| found.places.len() > b.places.len())
            {
                best = Some(found);
            }
            radius = radius * 3 / 2;
        }
        if let Some(lattice) = best {
            let places = lattice.places.iter().map(|(label, p)| (*label, working.to_slice(*p))).collect();
            let pitch = lattice.pitch * bin as f64;
            let target = Target { polarity, bin: ((pitch / MEASURED_PITCH) as usize).max(1) };
            return Ok(Some((target, Lattice { places, pitch })));
        }
    }
    Ok(None)
}

/// Measures the dots at (nearly) known places, and those beside them that show themselves. `None` when
/// fewer than a dozen can be relied on.
///
/// # Errors
/// When the work is cancelled.
pub fn observe(
    luma: &Plane<f32>,
    target: Target,
    expected: &Places,
    control: &dyn Control,
) -> Result<Option<Sighting>, Cancelled> {
    let coarse = Working::new(luma, coarse_bin(target, lattice::pitch_of(expected)));
    observe_from(luma, target, expected, &coarse, None, control)
}

/// Few pixels tell which dots there are and nearly where; what they leave open is then measured in the finer
/// picture in a few rounds. `light` is the ground of the coarse picture when it is known already.
fn observe_from(
    luma: &Plane<f32>,
    target: Target,
    expected: &Places,
    coarse: &Working,
    light: Option<Field>,
    control: &dyn Control,
) -> Result<Option<Sighting>, Cancelled> {
    let pitch = lattice::pitch_of(expected);
    let mut known = expected.clone();
    let settled = light.is_some();
    let field = light.unwrap_or_else(|| Field::first(&coarse.plane, target.polarity));
    if coarse.bin > target.bin {
        let effort = Effort { rounds: if settled { SETTLED_ROUNDS } else { ROUNDS }, enough: 0.05, settled };
        if let Some(found) = grown(coarse, field, &mut known, pitch, effort, control)? {
            known.extend(found.centres.iter().map(|c| (c.label, coarse.to_slice(c.at))));
        }
    }
    let fine;
    let working = if coarse.bin > target.bin {
        fine = Working::new(luma, target.bin);
        &fine
    } else {
        coarse
    };
    // the levels of the dots are wanted as well here, so ground and shape settle from scratch
    let effort = Effort { rounds: ROUNDS, enough: 0.002, settled: false };
    let light = Field::first(&working.plane, target.polarity);
    let measured = grown(working, light, &mut known, pitch, effort, control)?;
    Ok(measured.and_then(|m| sighting(&m, working, luma, pitch)))
}

/// Measures again as long as dots show themselves beside the known ones, to which they are added.
fn grown(
    working: &Working,
    field: Field,
    known: &mut Places,
    pitch: f64,
    effort: Effort,
    control: &dyn Control,
) -> Result<Option<Measured>, Cancelled> {
    let mut measured: Option<Measured> = None;
    for _ in 0..4 {
        let sought = sought(known, working);
        let found =
            centres::measure(&working.plane, field.clone(), &sought, pitch / working.bin as f64, effort, control)?;
        let Some(found) = found else { break };
        let before = known.len();
        known.extend(found.centres.iter().map(|c| (c.label, working.to_slice(c.at))));
        measured = Some(found);
        if known.len() == before {
            break;
        }
    }
    Ok(measured)
}

/// Pixels of the slice per sample of the picture for the first, rough measurement.
fn coarse_bin(target: Target, pitch: f64) -> usize {
    ((pitch / COARSE_PITCH) as usize).max(target.bin)
}

/// Finds the grid of the neighbouring slice `from` again in this one and measures its dots. `around` is the
/// motion that is expected. `None` when the grid cannot be seen.
///
/// # Errors
/// When the work is cancelled.
pub fn follow(
    luma: &Plane<f32>,
    target: Target,
    from: &Places,
    around: Motion,
    control: &dyn Control,
) -> Result<Option<Sighting>, Cancelled> {
    let working = Working::new(luma, coarse_bin(target, lattice::pitch_of(from)));
    let field = Field::first(&working.plane, target.polarity);
    let ink = field.ink(&working.plane);
    let dots: Vec<[f64; 2]> = from.values().map(|p| working.place_of(*p)).collect();
    let pitch = lattice::pitch_of(from) / working.bin as f64;
    let search = Search { ink: &ink, dots: &dots, steps: steps_of(from, working.bin), pitch };
    let (mut motion, mut sure) = search.best(around, if around.scale == 1.0 { 0.09 } else { 0.03 });
    if sure < SURE && around.scale != 1.0 {
        (motion, sure) = search.best(Motion::NONE, 0.12);
    }
    control.check()?;
    if sure < SURE {
        return Ok(None);
    }
    let middle = search.middle();
    let moved = |p: [f64; 2]| working.to_slice(motion.apply(middle, working.place_of(p)));
    let predicted: Places = from.iter().map(|(label, p)| (*label, moved(*p))).collect();
    let sought = sought(&predicted, &working);
    let effort = Effort { rounds: 3, enough: 0.02, settled: false };
    let Some(rough) = centres::measure(&working.plane, field, &sought, pitch * motion.scale, effort, control)? else {
        return Ok(None);
    };
    let pairs: Vec<_> =
        rough.centres.iter().filter_map(|c| predicted.get(&c.label).map(|p| (*p, working.to_slice(c.at)))).collect();
    if pairs.len() < LEAST_DOTS {
        return Ok(None);
    }
    let slice_pitch = pitch * working.bin as f64;
    let Some(shared) = robust::agree(&pairs, 0.02 * slice_pitch, 0.2 * slice_pitch) else { return Ok(None) };
    let agreeing = shared.agrees.iter().filter(|a| **a).count();
    if agreeing < LEAST_DOTS || 2 * agreeing < pairs.len() {
        return Ok(None);
    }
    let expected: Places = predicted.iter().map(|(label, p)| (*label, shared.homography.apply(*p))).collect();
    let Some(mut seen) = observe_from(luma, target, &expected, &working, Some(rough.field), control)? else {
        return Ok(None);
    };
    seen.step_scale = lattice_scale(from, &seen.dots);
    Ok(Some(seen))
}

/// Everything that is looked for: the known dots near the picture and the places beside them.
fn sought(known: &Places, working: &Working) -> Vec<Sought> {
    let pitch = lattice::pitch_of(known);
    let bounds = [working.plane.width * working.bin, working.plane.height * working.bin];
    let near = |p: &[f64; 2]| (0..2).all(|a| p[a] > -pitch && p[a] < bounds[a] as f64 + pitch);
    let place = |known: bool| {
        move |(label, at): (&Label, &[f64; 2])| Sought { label: *label, at: working.place_of(*at), known }
    };
    let beside = lattice::beside(known);
    let near_known = known.iter().filter(|(_, p)| near(p)).map(place(true));
    let near_beside = beside.iter().filter(|(_, p)| near(p)).map(place(false));
    near_known.chain(near_beside).collect()
}

fn sighting(measured: &Measured, working: &Working, luma: &Plane<f32>, pitch: f64) -> Option<Sighting> {
    if measured.centres.len() < LEAST_DOTS {
        return None;
    }
    let bin = working.bin as f64;
    let spotted = |c: &centres::Centre| Spotted { at: working.to_slice(c.at), sigma: c.sigma * bin };
    let clipped = luma.data.iter().filter(|v| **v >= 254.5).count() as f64 / luma.data.len().max(1) as f64;
    Some(Sighting {
        dots: measured.centres.iter().map(|c| (c.label, spotted(c))).collect(),
        pitch,
        step_scale: 1.0,
        clipped,
        flux: measured.shape.flux() * measured.field.span * bin * bin,
        field: measured.field.clone(),
        bin: working.bin,
    })
}

/// Ratio of the distances of neighbouring dots that both slices show.
fn lattice_scale(from: &Places, to: &BTreeMap<Label, Spotted>) -> f64 {
    let mut ratios = Vec::new();
    for (label, dot) in to {
        for step in [[1, 0], [0, 1]] {
            let next = [label[0] + step[0], label[1] + step[1]];
            let (Some(b), Some(c), Some(d)) = (to.get(&next), from.get(label), from.get(&next)) else { continue };
            let (now, then) = ((dot.at[0] - b.at[0]).hypot(dot.at[1] - b.at[1]), (c[0] - d[0]).hypot(c[1] - d[1]));
            ratios.push(now / then.max(1e-9));
        }
    }
    if ratios.is_empty() { 1.0 } else { median(&mut ratios) }
}

/// The two steps of the grid in px of the working plane: medians over all neighbours.
fn steps_of(places: &Places, bin: usize) -> [[f64; 2]; 2] {
    [[1, 0], [0, 1]].map(|step: Label| {
        let between: Vec<[f64; 2]> = places
            .iter()
            .filter_map(|(label, p)| {
                places.get(&[label[0] + step[0], label[1] + step[1]]).map(|q| [q[0] - p[0], q[1] - p[1]])
            })
            .collect();
        [0, 1].map(|a| median(&mut between.iter().map(|d| d[a]).collect::<Vec<_>>()) / bin as f64)
    })
}
