//! From dots to homographies: what agrees, which family of maps, what the rail adds, and how sure each slice is.

mod agreed;
mod maps;
mod unseen;

use agreed::{Agreed, agree, drop_strays, owns};
use maps::{Mapped, Setting, corners, floors, maps};
use unseen::{blind_reference, unseen};

use super::chain::Seen;
use super::choice::{self, Evidence, Model};
use super::events::{self, Event};
use super::families::{self, Family, Frame};
use super::gains::{self, Gain};
use super::lattice::Label;
use super::rail::{self, Law, Own, Source};
use super::sighting::{Sighting, Spotted};
use super::working::quantile;
use super::{Dot, DotUse, robust};
use crate::imaging::Slices;
use crate::types::calibration_options::ModelChoice;
use crate::types::report::ModelCandidate;
use crate::types::{Control, Error, ErrorKind, Homography, Interrupted};

/// The geometry and light of one slice.
#[derive(Debug, Clone)]
pub(super) struct Solved {
    /// Slice px -> reference-slice px.
    pub homography: Homography,
    /// What the law of the rail says it is.
    pub by_law: Option<Homography>,
    /// Multiply by this to match the reference.
    pub gain: f64,
    /// Relative standard deviation of that.
    pub gain_sigma: f64,
    /// Standard deviation of the worst corner, px.
    pub corner_sigma: f64,
    /// RMS of the inliers in the reference slice, px; `None` when predicted.
    pub rms: Option<f64>,
    /// 95th percentile of the same.
    pub p95: Option<f64>,
    /// The dots found.
    pub dots: Vec<Dot>,
    /// Farthest that the slice's own dots put a corner from where the law has it, px.
    pub off_law: Option<f64>,
    /// True when predicted by the law of the rail.
    pub interpolated: bool,
}

/// All slices.
#[derive(Debug, Clone)]
pub(super) struct Solution {
    /// The reference slice.
    pub reference: usize,
    /// One per slice.
    pub slices: Vec<Solved>,
    /// The family that was taken, and why.
    pub model: (Model, String),
    /// What each family would have given.
    pub candidates: Vec<ModelCandidate>,
    /// What the rail did.
    pub events: Vec<Event>,
    /// The positions that the law was fitted with.
    pub positions: Vec<f64>,
    /// Where the scales say that the slices stood, with standard deviations.
    pub stood: Option<Vec<Option<(f64, f64)>>>,
    /// Scale number of each measured slice (0: as the reference) and its standard deviation.
    pub scales: Vec<Option<(f64, f64)>>,
    /// Slopes of scale, rotation and shift over the positions, units.
    pub slopes: Option<[f64; 4]>,
}

/// Uncertainty of a predicted corner beyond which no slice is predicted, px.
const WORST: f64 = 1.5;
/// Distance from where the rail has it, in steps of the grid, from which a slice with merged dots was mistaken.
const STRAY: f64 = 0.3;

/// Solves every slice. `positions` on the rail when they were told.
///
/// # Errors
/// A fault naming the slices that can neither be measured nor predicted.
pub(super) fn solve(
    slices: &dyn Slices,
    seen: &Seen,
    reference: usize,
    told: Option<&[f64]>,
    asked: ModelChoice,
    control: &dyn Control,
) -> Result<Solution, Interrupted> {
    let count = seen.sightings.len();
    let Some(base) = seen.sightings[reference].as_ref() else {
        return Err(blind_reference(slices, reference).into());
    };
    let frame = Frame::new(seen.width, seen.height);
    let (width, height) = (seen.width as u32, seen.height as u32);
    let mut agreed: Vec<Agreed> = Vec::with_capacity(count);
    for (index, sighting) in seen.sightings.iter().enumerate() {
        control.check()?;
        let other = sighting.as_ref().filter(|_| index != reference);
        agreed.push(other.and_then(|s| agree(s, base, &frame)).unwrap_or_default());
    }

    // scale, rotation and shift tell what the rail did, whatever family is taken in the end
    let mut positions: Vec<f64> = told.map_or_else(|| (0..count).map(|i| i as f64).collect(), <[f64]>::to_vec);
    let similar = |agreed: &[Agreed]| owns(Family::Similarity, agreed, reference, &frame, [width, height]);
    let first = similar(&agreed);
    drop_strays(&mut agreed, &first, &positions, seen, base);
    let own = similar(&agreed);
    let sigma = |o: &Own, n: usize| o.covariance[(n, n)].max(0.0).sqrt();
    let scale =
        |own: &[Option<Own>]| own.iter().map(|o| o.as_ref().map(|o| (o.free[0], sigma(o, 0)))).collect::<Vec<_>>();
    let stood = rail::positions_by_scale(&scale(&own), &positions, reference);
    let mut events = stood.as_ref().map_or_else(Vec::new, |stood| events::steps(stood, &positions));
    if let (Some(stood), false) = (&stood, events.is_empty() || told.is_some()) {
        positions = filled(stood, &positions);
    }
    let shifts: Vec<Option<[f64; 2]>> =
        own.iter().map(|o| o.as_ref().map(|o| [o.free[2] * frame.half, o.free[3] * frame.half])).collect();
    events.extend(events::bump(&shifts, &positions, 0.5));
    let jump = events.iter().find_map(|e| if let Event::Bumped { from, .. } = e { Some(*from) } else { None });
    let slopes = Law::fit(&own, &positions, jump).map(|law| std::array::from_fn(|n| law.slopes()[n]));

    let away: Vec<f64> = positions.iter().map(|z| z - positions[reference]).collect();
    let evidence: Vec<Evidence> = agreed.iter().map(|a| a.evidence.clone()).collect();
    let floors = floors(seen, base.pitch);
    let setting =
        Setting { frame: &frame, width, height, reference, positions: &positions, away: &away, jump, floors: &floors };
    let every: Vec<(Model, Vec<Option<Mapped>>)> = [Model::Joint]
        .into_iter()
        .chain(families::ALL.map(Model::PerSlice))
        .map(|model| (model, maps(model, &agreed, &setting)))
        .collect();
    let of = |model: Model| every.iter().find(|e| e.0 == model).map_or(&[][..], |e| &e.1);
    let corners = |model: Model| corners(of(model), of(Model::PerSlice(Family::Homography)), &agreed, &setting);
    let (model, mut candidates, reason) = choice::choose(&evidence, &away, frame.half, &corners, asked);
    let (_, hidden) = choice::bias(&corners(model));
    for candidate in &mut candidates {
        let Some((_, maps)) = every.iter().find(|(m, _)| m.name() == candidate.model) else { continue };
        let others = maps.iter().enumerate().filter(|(i, _)| *i != reference);
        let worst = others.map(|(_, m)| m.as_ref().map(|m| m.sigma)).collect::<Option<Vec<f64>>>();
        candidate.corner_sigma_px = worst.map(|all| all.into_iter().fold(0.0, f64::max));
    }
    let mut maps = every.into_iter().find(|e| e.0 == model).map(|e| e.1).unwrap_or_default();
    // what hides grows with the distance on the rail, as all that the maps do
    let mean_away = away.iter().map(|z| z * z).sum::<f64>() / count as f64;
    for (map, z) in maps.iter_mut().zip(&away) {
        let share = 0.2 + 0.8 * z * z / mean_away.max(1e-30);
        map.iter_mut().for_each(|m| m.sigma = m.sigma.hypot((hidden * share).sqrt()));
    }
    let lost: Vec<usize> = (0..count)
        .filter(|&i| i != reference && maps[i].as_ref().is_none_or(|m| m.source == Source::Law && m.sigma > WORST))
        .collect();
    if !lost.is_empty() {
        let worst = lost.iter().filter_map(|&i| maps[i].as_ref().map(|m| m.sigma)).fold(0.0, f64::max);
        let why = if worst > 0.0 {
            format!(", and from the other slices they could be predicted to {worst:.1} px only ({WORST} px is allowed)")
        } else {
            ", and too few other slices could be to predict them".to_owned()
        };
        return Err(unseen(slices, &lost, &why).into());
    }
    let all_gains = gains::of(seen, reference, &positions);
    let mut out = Vec::with_capacity(count);
    for (index, map) in maps.into_iter().enumerate() {
        let solved = match map {
            Some(map) if index != reference => finished(map, &agreed[index], seen, index, base, all_gains[index]),
            _ => itself(base),
        };
        if let Some(why) = solved.homography.objection(width, height) {
            let name = slices.name(index);
            let detail = format!("the homography of {name} (slice {index}) {why}: this is no view of the same target");
            return Err(Error::new(ErrorKind::TargetNotFound, detail).in_file(name, Some(index as u32)).into());
        }
        out.push(solved);
    }
    let scales = scale(&own);
    Ok(Solution {
        reference,
        slices: out,
        model: (model, reason),
        candidates,
        events,
        positions,
        stood,
        scales,
        slopes,
    })
}

/// Positions by scale where there are any, continued by ordinary steps where there are none.
fn filled(stood: &[Option<(f64, f64)>], positions: &[f64]) -> Vec<f64> {
    let known: Vec<usize> = (0..stood.len()).filter(|&i| stood[i].is_some()).collect();
    (0..stood.len())
        .map(|i| {
            let nearest = known.iter().min_by_key(|k| k.abs_diff(i)).copied().unwrap_or(i);
            stood[nearest].map_or(positions[i], |s| s.0) + positions[i] - positions[nearest]
        })
        .collect()
}

/// The reference slice: the identity by definition.
fn itself(base: &Sighting) -> Solved {
    let dot =
        |(label, dot): (&Label, &Spotted)| Dot { label: *label, at: dot.at, sigma: dot.sigma, used: DotUse::Inlier };
    Solved {
        homography: Homography::IDENTITY,
        by_law: None,
        gain: 1.0,
        gain_sigma: 0.0,
        corner_sigma: 0.0,
        rms: Some(0.0),
        p95: Some(0.0),
        dots: base.dots.iter().map(dot).collect(),
        off_law: None,
        interpolated: false,
    }
}

fn finished(map: Mapped, agreed: &Agreed, seen: &Seen, index: usize, base: &Sighting, gain: Gain) -> Solved {
    let interpolated = map.source == Source::Law;
    let far = |label: &Label, at: [f64; 2]| {
        base.dots.get(label).is_some_and(|b| robust::miss(&map.homography, &(at, b.at)) > STRAY * base.pitch)
    };
    let used = |label: &Label, at: [f64; 2]| match agreed.agrees.get(label) {
        // a grid that was mistaken by half a step
        _ if interpolated && far(label, at) => DotUse::Outlier,
        _ if interpolated => DotUse::Unused,
        Some(true) => DotUse::Inlier,
        Some(false) => DotUse::Outlier,
        None => DotUse::Unused,
    };
    let spotted = seen.sightings[index].iter().flat_map(|s| &s.dots);
    let dots: Vec<Dot> =
        spotted.map(|(label, d)| Dot { label: *label, at: d.at, sigma: d.sigma, used: used(label, d.at) }).collect();
    let inliers = dots.iter().filter(|d| d.used == DotUse::Inlier);
    let mut misses: Vec<f64> =
        inliers.filter_map(|d| base.dots.get(&d.label).map(|b| robust::miss(&map.homography, &(d.at, b.at)))).collect();
    let rms = (!misses.is_empty()).then(|| (misses.iter().map(|m| m * m).sum::<f64>() / misses.len() as f64).sqrt());
    Solved {
        homography: map.homography,
        by_law: map.by_law,
        gain: gain.value,
        gain_sigma: gain.sigma,
        corner_sigma: map.sigma,
        rms,
        p95: rms.map(|_| quantile(&mut misses, 0.95)),
        dots,
        off_law: map.off_law,
        interpolated,
    }
}
