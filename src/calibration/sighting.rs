//! The dots of one slice: found blindly in the first slice, followed from slice to slice in the others.

use std::collections::BTreeMap;

use super::blobs;
use super::complete::{self, Completed};
use super::dlt;
use super::field::{Field, Polarity};
use super::lattice::{self, LEAST_DOTS, Label, Lattice, Places};
use super::light::{self, Light};
use super::lockin::{self, Locked, Site};
use super::robust;
use super::search::{Found, Motion, Search};
use super::working::{Working, median, quantile};
use crate::imaging::{Plane, Raster};
use crate::model::{Cancelled, Control};

/// A dot in px of its slice.
#[derive(Debug, Clone, Copy)]
pub struct Spotted {
    /// Centre.
    pub at: [f64; 2],
    /// Standard deviation of each coordinate as noise and what spoils its window would have it.
    pub sigma: f64,
    /// The light around it.
    pub light: Light,
    /// The part of that which its neighbours share.
    pub doubt: f64,
    /// Share of its window that is made up or at full scale: the light there is not to be relied on.
    pub spoilt: f64,
}

/// What one slice showed. Holds no pixels.
#[derive(Debug, Clone)]
pub struct Sighting {
    /// The dots that were measured.
    pub dots: BTreeMap<Label, Spotted>,
    /// All dots that the target is known to have, where they are or would be, px of the slice.
    pub places: Places,
    /// Distance of neighbouring dots, px of the slice.
    pub pitch: f64,
    /// How the picture moved since the slice that it was followed from.
    pub motion: Motion,
    /// Share of the pixels at full scale.
    pub clipped: f64,
    /// Amplitude of the grid's first harmonic over the mean light; negative where blur has inverted the dots.
    pub ripple: f64,
    /// Diameter of a dot over the pitch, as this slice shows it (too wide where it is blurred).
    pub width: f64,
    /// True when neighbouring dots run into one another.
    pub merged: bool,
    /// Measured dots over dots that could have been: where windows overlap less, errors are less alike.
    pub density: f64,
}

/// What stays the same for all slices of a stack once the first has been seen.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// Dark or bright dots.
    pub polarity: Polarity,
    /// Resolution that dots are measured at: pixels per sample along each axis.
    pub bin: usize,
}

/// What is expected of a slice before it is looked at.
#[derive(Debug, Clone, Copy)]
pub struct Expected {
    /// Where the picture goes.
    pub motion: Motion,
    /// True when that is known from the slices before.
    pub sure: bool,
    /// True when blur may have inverted the dots.
    pub maybe_inverted: bool,
}

/// Long side of the picture in which dots are looked for blindly.
const BLIND_SIDE: usize = 2400;
/// Samples of the picture in which dots are measured: more do not make them better.
const SAMPLES: f64 = 7e5;
/// Samples that memory is reckoned with: more only where dots would else be too near to one another.
pub const MOST_SAMPLES: usize = 8_000_000;
/// Distance of dots in that picture below which nothing is gained, px.
const COARSEST_PITCH: f64 = 8.0;
/// In that picture they are at least this far apart, px.
const MEASURED_PITCH: f64 = 16.0;
/// Standard errors by which predicted dots must stand out to be believed.
const SURE: f64 = 6.0;
/// Most dots that are measured in a slice: more do not make its homography better.
const MOST: usize = 1200;
/// About how many dots' light is looked at.
const LIT: usize = 200;
/// Standard deviation, in steps of the grid, per share of a dot's window that is made up, while that is small.
const MADE_UP: f64 = 3e-3;
/// The same per sine of the full-scale samples in its window.
const CUT: f64 = 0.04;
/// Shifts, in steps of the grid, beyond which a dot is not where it was expected.
const LOST: f64 = 0.3;

/// The grid in a slice about which nothing is known, in px of the slice, or `None` when there is none.
///
/// # Errors
/// When the work is cancelled.
pub fn blind(slice: &Raster, control: &dyn Control) -> Result<Option<(Target, Lattice)>, Cancelled> {
    let working = Working::of(slice, slice.width.max(slice.height).div_ceil(BLIND_SIDE).max(1));
    let likely = Polarity::guess(&working.plane);
    // on a dark table the gaps between dark dots may pass for a few bright ones, so both are looked at
    let mut best: Option<(Polarity, Lattice)> = None;
    for polarity in [likely, likely.other()] {
        let found = grid(&working, polarity, control)?;
        if let Some(found) = found
            && best.as_ref().is_none_or(|(_, b)| found.outdoes(b))
        {
            best = Some((polarity, found));
        }
    }
    Ok(best.map(|(polarity, lattice)| {
        let places = lattice.places.iter().map(|(label, p)| (*label, working.to_slice(*p))).collect();
        let pitch = lattice.pitch * working.bin as f64;
        let target = Target { polarity, bin: resolution((slice.width * slice.height) as f64, pitch) };
        (target, Lattice { places, pitch })
    }))
}

/// The largest grid of dots of one polarity.
fn grid(working: &Working, polarity: Polarity, control: &dyn Control) -> Result<Option<Lattice>, Cancelled> {
    let ink = Field::first(&working.plane, polarity, None).ink(&working.plane);
    let mut best: Option<Lattice> = None;
    let largest = working.plane.width.min(working.plane.height) / 4;
    let mut radius = 6;
    while radius <= largest.max(6) {
        control.check()?;
        // a wider surrounding than the steps of the grid tells nothing new
        if best.as_ref().is_some_and(|b| radius as f64 > 2.0 * b.pitch) {
            break;
        }
        if let Some(found) = lattice::index(&blobs::find(&ink, radius))
            && best.as_ref().is_none_or(|b| found.places.len() > b.places.len())
        {
            best = Some(found);
        }
        radius = radius * 3 / 2;
    }
    Ok(best)
}

/// Pixels per sample along each axis, for a slice of so many pixels with dots `pitch` px apart.
fn resolution(pixels: f64, pitch: f64) -> usize {
    let within = |samples: f64| (pixels / samples).sqrt().ceil();
    let good = within(SAMPLES).min(pitch / MEASURED_PITCH);
    // a very fine grid in a very large picture is measured more coarsely than is best for it
    let bounded = within(MOST_SAMPLES as f64).min(pitch / COARSEST_PITCH);
    good.max(bounded).max(1.0) as usize
}

/// Measures the dots of a slice in which the grid was found blindly. `None` when fewer than a dozen can be relied on.
///
/// # Errors
/// When the work is cancelled.
pub fn observe(
    slice: &Raster,
    target: Target,
    found: &Lattice,
    control: &dyn Control,
) -> Result<Option<Sighting>, Cancelled> {
    let working = Working::of(slice, target.bin);
    let places: Places = found.places.iter().map(|(label, p)| (*label, working.place_of(*p))).collect();
    let field = ground(&working, target, &places);
    measure(&working, field, places, 1.0, control)
}

/// Finds the grid of a neighbouring slice again in this one and measures its dots. `None` when it cannot be seen.
///
/// # Errors
/// When the work is cancelled.
pub fn follow(
    slice: &Raster,
    target: Target,
    from: &Places,
    expected: &Expected,
    control: &dyn Control,
) -> Result<Option<Sighting>, Cancelled> {
    let working = Working::of(slice, target.bin);
    let from: Places = from.iter().map(|(label, p)| (*label, working.place_of(*p))).collect();
    let field = ground(&working, target, &from);
    let ink = field.ink(&working.plane);
    let seen: Vec<[f64; 2]> = from.values().filter(|p| in_picture(&working, p)).copied().collect();
    let pitch = lattice::pitch_of(&from);
    let steps = steps_of(&from);
    let bin = working.bin as f64;
    let search = Search { ink: &ink, dots: &seen, steps, pitch };
    let around = Motion { shift: expected.motion.shift.map(|s| s / bin), ..expected.motion };
    let Found { motion, sign, sure, .. } = if expected.sure {
        let near = search.best(around, 0.02, 0.3, 1.0);
        let inverted = expected.maybe_inverted.then(|| search.best(around, 0.02, 0.3, -1.0));
        inverted.filter(|i| i.depth > near.depth).unwrap_or(near)
    } else {
        search.best(around, 0.09, 0.6, 1.0)
    };
    control.check()?;
    let middle = search.middle();
    let strays = (motion.shift[0] - around.shift[0]).hypot(motion.shift[1] - around.shift[1])
        > if expected.maybe_inverted { 0.3 } else { 0.45 } * pitch;
    if sure < SURE || (expected.sure && strays) {
        return Ok(None);
    }
    let predicted: Places = from.iter().map(|(label, p)| (*label, motion.apply(middle, *p))).collect();
    // a first look, to take out rotation and keystone before dots are counted on
    let labels = chosen(&working, &predicted);
    let sites = sites(&labels, &predicted, motion.scale, steps);
    let locked = lockin::lock(&ink, None, &sites);
    let pairs: Vec<dlt::Pair> = sites
        .iter()
        .zip(&locked)
        .filter_map(|(site, locked)| locked.map(|l| (site.at, moved(site, &l, sign))))
        .filter(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]) < LOST * pitch)
        .collect();
    if pairs.len() < LEAST_DOTS || 2 * pairs.len() < sites.len() {
        return Ok(None);
    }
    let Some(shared) = robust::agree(&pairs, 0.02 * pitch, 0.15 * pitch) else { return Ok(None) };
    if 2 * shared.agrees.iter().filter(|a| **a).count() < pairs.len() {
        return Ok(None);
    }
    let places = predicted.into_iter().map(|(label, p)| (label, shared.homography.apply(p))).collect();
    let mut sighting = measure(&working, field, places, sign, control)?;
    if let Some(sighting) = &mut sighting {
        let slice_middle = [(slice.width as f64 - 1.0) / 2.0, (slice.height as f64 - 1.0) / 2.0];
        let back = |p: [f64; 2]| working.to_slice(shared.homography.apply(motion.apply(middle, working.place_of(p))));
        let goes = back(slice_middle);
        sighting.motion = Motion {
            scale: motion.scale * shared.homography.scale_at(middle),
            shift: [goes[0] - slice_middle[0], goes[1] - slice_middle[1]],
        };
    }
    Ok(sighting)
}

/// The ground about the dots, which are about at `places`.
fn ground(working: &Working, target: Target, places: &Places) -> Field {
    let near: Vec<[f64; 2]> = places.values().filter(|p| in_picture(working, p)).copied().collect();
    Field::first(&working.plane, target.polarity, Some((&near, 0.6 * lattice::pitch_of(places))))
}

/// Rounds of the lock-in.
const ROUNDS: usize = 3;

/// Measures all dots from `places` on (px of the working picture), which are right to a tenth of the pitch.
fn measure(
    working: &Working,
    mut field: Field,
    mut places: Places,
    sign: f64,
    control: &dyn Control,
) -> Result<Option<Sighting>, Cancelled> {
    let plane = &working.plane;
    let mut last = None;
    for round in 0..ROUNDS {
        control.check()?;
        let pitch = lattice::pitch_of(&places);
        let ink = field.ink(plane);
        let mut completed = None;
        // more of the grid may show itself beside what was found
        for _ in 0..if round == 0 { 6 } else { 2 } {
            let beside = lattice::beside(&places);
            let Some(done) = complete::complete(&ink, &places, &beside, pitch, round > 0) else { return Ok(None) };
            let grown = !done.grown.is_empty();
            places.extend(done.grown.iter().map(|(label, p)| (*label, *p)));
            completed = Some(done);
            if !grown {
                break;
            }
        }
        let Some(completed) = completed else { return Ok(None) };
        let mut labels = chosen(working, &places);
        labels.retain(|label| !completed.hidden.contains(label));
        if completed.shape.merges(pitch) {
            keep_off(&mut labels, &completed.foul);
        }
        let steps = steps_of(&places);
        let sites = sites(&labels, &places, 1.0, steps);
        let locked = lockin::lock(&completed.ink, Some(&completed.open), &sites);
        let sure = believed(&sites, &locked, sign);
        if sure.iter().filter(|s| **s).count() < LEAST_DOTS {
            return Ok(None);
        }
        // those that were not measured go where the others say
        let pairs: Vec<dlt::Pair> = sites
            .iter()
            .zip(&locked)
            .zip(&sure)
            .filter_map(|((site, locked), sure)| locked.filter(|_| *sure).map(|l| (site.at, moved(site, &l, sign))))
            .collect();
        let Some(shared) = robust::agree(&pairs, 0.01 * pitch, 0.1 * pitch) else { return Ok(None) };
        places.values_mut().for_each(|p| *p = shared.homography.apply(*p));
        let mut measured = BTreeMap::new();
        for (((label, site), locked), sure) in labels.iter().zip(&sites).zip(&locked).zip(&sure) {
            let Some(locked) = locked.filter(|_| *sure) else { continue };
            let at = moved(site, &locked, sign);
            // a dot far off the others' map is dust or a misprint: kept as measured, but not as a place to look next
            let there = places.get(label).copied().unwrap_or(at);
            if (at[0] - there[0]).hypot(at[1] - there[1]) < 0.05 * pitch {
                places.insert(*label, at);
            }
            measured.insert(*label, (at, locked));
        }
        let near: Vec<[f64; 2]> = places.values().filter(|p| in_picture(working, p)).copied().collect();
        let light = field.refined(plane, &completed.picture, &completed.ground, &near, 0.8 * pitch, 2 + round.min(2));
        last = Some((measured, completed, sites.len()));
        field = if round + 1 < ROUNDS { light } else { field };
    }
    Ok(last.and_then(|(measured, completed, sites)| {
        let counted = places.values().filter(|p| in_picture(working, p)).count().max(1);
        sighting(working, &field, &places, &measured, &completed, sign, sites as f64 / counted as f64)
    }))
}

/// Where dots run together, what lies beyond the target runs into the outermost ones: they are left out, when enough
/// others are there.
fn keep_off(labels: &mut Vec<Label>, foul: &[Label]) {
    let near = |l: &Label| foul.iter().any(|f| (f[0] - l[0]).abs() <= 1 && (f[1] - l[1]).abs() <= 1);
    let kept: Vec<Label> = labels.iter().filter(|l| !near(l)).copied().collect();
    if kept.len() >= 2 * LEAST_DOTS {
        *labels = kept;
    }
}

fn sighting(
    working: &Working,
    field: &Field,
    places: &Places,
    measured: &BTreeMap<Label, ([f64; 2], Locked)>,
    completed: &Completed,
    sign: f64,
    density: f64,
) -> Option<Sighting> {
    if measured.len() < LEAST_DOTS {
        return None;
    }
    let bin = working.bin as f64;
    let pitch = lattice::pitch_of(places);
    let steps = steps_of(places);
    let noise = noise_of(&completed.ink);
    let amplitude = |l: &Locked| 0.5 * (l.wave[0].amplitude(sign) + l.wave[1].amplitude(sign));
    let mut ripples: Vec<f64> = Vec::new();
    let mut dots = BTreeMap::new();
    let windows: Vec<Site> = measured.values().map(|(at, _)| Site { at: *at, steps }).collect();
    let made_up = lockin::lock(&completed.made_up, None, &windows);
    let full = working.full.as_ref().map(|full| lockin::lock(full, None, &windows));
    for (k, (label, (at, locked))) in measured.iter().enumerate() {
        let made_up = made_up[k].map_or(0.0, |l| l.mean);
        let full = full.as_ref().and_then(|f| f[k]);
        // where full scale lies on one side of a dot its wave is cut there
        let cut = full.map_or(0.0, |f| f.wave[0].sine.hypot(f.wave[1].sine));
        let doubt = pitch * (MADE_UP * made_up * (1.0 + 10.0 * made_up)).hypot(CUT * cut) * bin;
        let light = light::around(&working.plane, field, &completed.drawn, *at, steps, locked);
        let sigma = pitch * lockin::shift_sigma(noise, amplitude(locked), steps) * bin;
        // mean ink is what the light lacks: amplitude over mean light, whatever the ground is taken to be
        let mean = match field.polarity {
            Polarity::DarkOnLight => 1.0 - locked.mean,
            Polarity::LightOnDark => light.mean / field.span,
        };
        ripples.push(sign * amplitude(locked) / mean.max(0.02));
        let spoilt = made_up + full.map_or(0.0, |f| f.mean);
        dots.insert(*label, Spotted { at: working.to_slice(*at), sigma: sigma.hypot(doubt), doubt, light, spoilt });
    }
    // the light is smooth: some of the dots tell it
    let every = dots.len().div_ceil(LIT);
    let lit: Vec<Label> = dots.keys().step_by(every).copied().collect();
    let sites: Vec<Site> = lit.iter().filter_map(|l| measured.get(l)).map(|(at, _)| Site { at: *at, steps }).collect();
    let means = light::linear_means(&working.plane, field, &completed.drawn, &sites);
    for (label, mean) in lit.iter().zip(means) {
        if let Some(dot) = dots.get_mut(label) {
            dot.light.linear_mean = mean;
        }
    }
    let merged = sign < 0.0 || completed.shape.merges(pitch);
    Some(Sighting {
        dots,
        places: places.iter().map(|(label, p)| (*label, working.to_slice(*p))).collect(),
        pitch: pitch * bin,
        motion: Motion::NONE,
        clipped: working.clipped,
        ripple: median(&mut ripples),
        width: 2.0 * completed.shape.half_width() / pitch,
        merged,
        density: density.min(1.0),
    })
}

/// Standard deviation of the noise, from second differences along rows, which the pattern hardly has.
fn noise_of(plane: &Plane<f32>) -> f64 {
    let stride = (plane.height / 200).max(1);
    let mut bends = Vec::new();
    for y in (0..plane.height).step_by(stride) {
        let row = plane.row(y);
        bends.extend(row.windows(3).step_by(5).map(|w| f64::from((w[0] - 2.0 * w[1] + w[2]).abs())));
    }
    (1.4826 * median(&mut bends) / 6.0_f64.sqrt()).max(1e-5)
}

/// The dots whose windows lie in the picture; an even choice of them when there are very many.
fn chosen(working: &Working, places: &Places) -> Vec<Label> {
    let steps = steps_of(places);
    let fits = |p: &[f64; 2]| lockin::inside(&Site { at: *p, steps }, working.plane.width, working.plane.height);
    let all: Vec<Label> = places.iter().filter(|(_, p)| fits(p)).map(|(label, _)| *label).collect();
    let every = ((all.len() as f64 / MOST as f64).sqrt().ceil() as i32).max(1);
    all.into_iter().filter(|[i, j]| i.rem_euclid(every) == 0 && j.rem_euclid(every) == 0).collect()
}

/// The sites of `labels`, each with the steps that its own neighbours have where they are known.
fn sites(labels: &[Label], places: &Places, scale: f64, steps: [[f64; 2]; 2]) -> Vec<Site> {
    let local = |[i, j]: Label, axis: usize| {
        let d: Label = if axis == 0 { [1, 0] } else { [0, 1] };
        let (next, back) = (places.get(&[i + d[0], j + d[1]]), places.get(&[i - d[0], j - d[1]]));
        let (Some(next), Some(back)) = (next, back) else { return steps[axis].map(|s| s * scale) };
        [0.5 * (next[0] - back[0]), 0.5 * (next[1] - back[1])]
    };
    labels
        .iter()
        .filter_map(|label| places.get(label).map(|at| Site { at: *at, steps: [local(*label, 0), local(*label, 1)] }))
        .collect()
}

/// Where the pattern says that the dot of a site is.
fn moved(site: &Site, locked: &Locked, sign: f64) -> [f64; 2] {
    let shift = locked.wave.map(|w| w.shift(sign));
    [0, 1].map(|a| site.at[a] + shift[0] * site.steps[0][a] + shift[1] * site.steps[1][a])
}

/// Which sites show a pattern as strong as the others do, about where it was expected.
fn believed(sites: &[Site], locked: &[Option<Locked>], sign: f64) -> Vec<bool> {
    let usual = [0, 1]
        .map(|k| median(&mut locked.iter().flatten().map(|l| l.wave[k].amplitude(sign)).collect::<Vec<_>>()).max(1e-6));
    let good = |(_, locked): (&Site, &Option<Locked>)| {
        locked.is_some_and(|l| {
            (0..2).all(|k| {
                let strong = (0.3..1.8).contains(&(l.wave[k].amplitude(sign) / usual[k]));
                strong && l.wave[k].shift(sign).abs() < LOST
            })
        })
    };
    sites.iter().zip(locked).map(good).collect()
}

fn in_picture(working: &Working, p: &[f64; 2]) -> bool {
    p[0] >= 0.0 && p[1] >= 0.0 && p[0] <= working.plane.width as f64 - 1.0 && p[1] <= working.plane.height as f64 - 1.0
}

/// The two steps of the grid: medians over all neighbours.
pub fn steps_of(places: &Places) -> [[f64; 2]; 2] {
    [[1, 0], [0, 1]].map(|step: Label| {
        let between: Vec<[f64; 2]> = places
            .iter()
            .filter_map(|(label, p)| {
                places.get(&[label[0] + step[0], label[1] + step[1]]).map(|q| [q[0] - p[0], q[1] - p[1]])
            })
            .collect();
        [0, 1].map(|a| median(&mut between.iter().map(|d| d[a]).collect::<Vec<_>>()))
    })
}

/// What a slice without a grid looks like, for the person who has to take it again.
pub fn looks(slice: &Raster) -> &'static str {
    let working = Working::of(slice, slice.width.max(slice.height).div_ceil(1600).max(1));
    let plane = &working.plane;
    let stride = (plane.data.len() / 50_000).max(1) | 1;
    let mut levels: Vec<f64> = plane.data.iter().step_by(stride).map(|&v| f64::from(v)).collect();
    let (dark, bright) = (quantile(&mut levels, 0.02), quantile(&mut levels, 0.98));
    match () {
        () if working.clipped > 0.3 => "a large part of it is clipped white: expose less",
        () if bright < 20.0 => "it is almost black: expose more",
        () if bright - dark < 0.12 * bright => {
            "it shows hardly any contrast: it is far out of focus or shows no target"
        }
        () if gradient(plane) < 0.02 * (bright - dark) => {
            "it is blurred all over: focus on the target in at least one slice"
        }
        () => "it shows something else, or too few dots",
    }
}

/// 98th percentile of the steps between neighbouring samples.
fn gradient(plane: &Plane<f32>) -> f64 {
    let stride = (plane.height / 200).max(1);
    let mut steps = Vec::new();
    for y in (0..plane.height).step_by(stride) {
        steps.extend(plane.row(y).windows(2).step_by(3).map(|w| f64::from((w[1] - w[0]).abs())));
    }
    quantile(&mut steps, 0.98)
}
