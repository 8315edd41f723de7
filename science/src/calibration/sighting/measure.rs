//! From places that are about right to dots that are measured, in rounds.

use std::collections::BTreeMap;

use super::sites::{chosen, in_picture, moved, sites, steps_of};
use super::{LOST, Sighting, Spotted};
use crate::calibration::complete::{self, Completed};
use crate::calibration::dlt;
use crate::calibration::field::{Field, Polarity};
use crate::calibration::lattice::{self, LEAST_DOTS, Label, Places};
use crate::calibration::light;
use crate::calibration::lockin::{self, Locked, Site};
use crate::calibration::robust;
use crate::calibration::search::Motion;
use crate::calibration::working::{Working, median};
use crate::imaging::Plane;
use crate::types::{Cancelled, Control};

/// About how many dots' light is looked at.
const LIT: usize = 200;
/// Standard deviation, in steps of the grid, per share of a dot's window that is made up, while that is small.
const MADE_UP: f64 = 3e-3;
/// The same per sine of the full-scale samples in its window.
const CUT: f64 = 0.04;
/// Rounds of the lock-in.
const ROUNDS: usize = 3;

/// Measures all dots from `places` on (px of the working picture), which are right to a tenth of the pitch.
pub(super) fn measure(
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
