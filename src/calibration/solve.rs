//! From dots to homographies: what agrees, which family of maps, what the rail adds, and how sure each slice is.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};

use super::chain::Seen;
use super::choice::{self, Corner, Evidence, Model};
use super::dlt::Pair;
use super::events::{self, Event};
use super::families::{self, Departure, Family, Frame, Match};
use super::gains::{self, Gain};
use super::joint::Joint;
use super::lattice::{LEAST_DOTS, Label};
use super::lockin::OVERLAP;
use super::rail::{self, Law, Own, Source};
use super::sighting::Sighting;
use super::working::quantile;
use super::{Dot, DotUse, robust};
use crate::imaging::Slices;
use crate::model::error::FaultPlace;
use crate::model::report::ModelCandidate;
use crate::model::request::ModelChoice;
use crate::model::{Code, Control, Fault, Homography, Stop};

/// The geometry and light of one slice.
#[derive(Debug, Clone)]
pub struct Solved {
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
pub struct Solution {
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
/// Distance beyond which a dot never counts as an inlier, px; or a share of the pitch where that is more.
const MOST: f64 = 1.0;
/// Distance from where the rail has it, in steps of the grid, from which a slice with merged dots was mistaken.
const STRAY: f64 = 0.3;
/// Uncertainty of a corner, px, from which a slice's own dots count as too blurred when the rail knows better.
const FAINT: f64 = 0.4;
/// What no count of dots takes away: lens distortion, printing, the shape of pixels; px, and as a share of the pitch.
const FLOOR: (f64, f64) = (0.006, 4e-4);

/// About how many neighbours what spoils their windows moves alike.
const NEIGHBOURS: f64 = 9.0;

/// Solves every slice. `positions` on the rail when they were told.
///
/// # Errors
/// A fault naming the slices that can neither be measured nor predicted.
pub fn solve(
    slices: &dyn Slices,
    seen: &Seen,
    reference: usize,
    told: Option<&[f64]>,
    asked: ModelChoice,
    control: &dyn Control,
) -> Result<Solution, Stop> {
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
            return Err(Fault::new(Code::TargetNotFound, detail).in_file(name, Some(index as u32)).into());
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

/// The dots that a slice shares with the reference, and which of them agree.
#[derive(Debug, Clone, Default)]
struct Agreed {
    evidence: Evidence,
    agrees: BTreeMap<Label, bool>,
}

/// `None` when too few agree.
fn agree(sighting: &Sighting, base: &Sighting, frame: &Frame) -> Option<Agreed> {
    let shared: Vec<(Label, Pair, [f64; 2])> = sighting
        .dots
        .iter()
        .filter_map(|(label, dot)| {
            let b = base.dots.get(label)?;
            let sigma = [dot.sigma.hypot(b.sigma), dot.doubt.hypot(b.doubt)];
            Some((*label, (dot.at, b.at), sigma))
        })
        .collect();
    let pairs: Vec<Pair> = shared.iter().map(|s| s.1).collect();
    if pairs.len() < LEAST_DOTS {
        return None;
    }
    let consensus = robust::agree(&pairs, 0.15, MOST.max(0.02 * base.pitch))?;
    let inliers = consensus.agrees.iter().filter(|a| **a).count();
    if inliers < LEAST_DOTS || 2 * inliers < pairs.len() {
        return None;
    }
    let floor = FLOOR.0;
    let kept = shared.iter().zip(&consensus.agrees).filter(|(_, agrees)| **agrees);
    let matches = kept
        .clone()
        .map(|((_, (here, at), [sigma, _]), _)| Match {
            base: frame.unit(*at),
            here: frame.unit(*here),
            sigma: sigma.hypot(floor) / frame.half,
        })
        .collect();
    // what neighbours share (light beyond the target, glare) is not averaged away among them
    let (weights, alike) = kept.clone().fold((0.0, 0.0), |(weights, alike), ((_, _, [sigma, doubt]), _)| {
        let weight = 1.0 / (sigma * sigma + floor * floor);
        (weights + weight, alike + weight * weight * doubt * doubt)
    });
    let alike = 1.0 + (NEIGHBOURS - 1.0) * alike / weights.max(1e-30);
    let labels = kept.map(|(s, _)| s.0).collect();
    // where many had to be left out, those that were kept are not as good as their scatter says
    let chosen = (pairs.len() as f64 / inliers as f64).powi(4);
    let overlap = (OVERLAP * sighting.density).max(1.0) * chosen * alike;
    let agrees = shared.iter().map(|s| s.0).zip(consensus.agrees.iter().copied()).collect();
    Some(Agreed { evidence: Evidence { labels, matches, overlap }, agrees })
}

/// What each slice says by itself in one family; the reference is the identity, exactly.
fn owns(
    family: Family,
    agreed: &[Agreed],
    reference: usize,
    frame: &Frame,
    [width, height]: [u32; 2],
) -> Vec<Option<Own>> {
    agreed
        .iter()
        .enumerate()
        .map(|(index, agreed)| {
            let size = family.size();
            if index == reference {
                let covariance = DMatrix::identity(size, size) * 1e-16;
                return Some(Own { free: DVector::zeros(size), covariance });
            }
            let fit = families::fit(family, &agreed.evidence.matches)?;
            let covariance = &fit.covariance * agreed.evidence.overlap;
            // at the corners, which is what counts: numbers apart from one another are too many for so few blocks
            let at_corners = |c: &DMatrix<f64>| families::corner_sigma(family, &fit.free, c, frame, width, height);
            let more = (at_corners(&fit.by_blocks) / at_corners(&covariance).max(1e-12)).max(1.0);
            Some(Own { covariance: covariance * (more * more), free: fit.free })
        })
        .collect()
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

/// Forgets what was measured in slices whose dots run together and whose place contradicts the sharper slices by a good
/// part of the pitch: there the grid was mistaken by half a step or a whole one. From the sharp slices outward, so that
/// one mistaken slice does not speak for another.
fn drop_strays(agreed: &mut [Agreed], own: &[Option<Own>], positions: &[f64], seen: &Seen, base: &Sighting) {
    let frame = Frame::new(seen.width, seen.height);
    let merged = |i: usize| seen.sightings[i].as_ref().is_some_and(|s| s.merged);
    let mut trusted: Vec<Option<Own>> = own.iter().enumerate().map(|(i, o)| o.clone().filter(|_| !merged(i))).collect();
    loop {
        let known: Vec<usize> = (0..own.len()).filter(|&i| trusted[i].is_some()).collect();
        let waiting = (0..own.len()).filter(|&i| {
            own[i].is_some() && merged(i) && trusted[i].is_none() && !agreed[i].evidence.matches.is_empty()
        });
        let nearest = |i: usize| known.iter().map(|k| k.abs_diff(i)).min().unwrap_or(usize::MAX);
        let Some(next) = waiting.min_by_key(|&i| nearest(i)) else { return };
        let off = Law::fit(&trusted, positions, None).zip(own[next].as_ref()).map(|(law, o)| &o.free - law.says(next));
        if off.is_some_and(|off| frame.half * off[2].hypot(off[3]) > STRAY * base.pitch) {
            agreed[next] = Agreed::default();
        } else {
            trusted[next].clone_from(&own[next]);
        }
    }
}

/// What all maps are made in.
struct Setting<'a> {
    frame: &'a Frame,
    width: u32,
    height: u32,
    reference: usize,
    positions: &'a [f64],
    away: &'a [f64],
    jump: Option<usize>,
    floors: &'a [f64],
}

/// The map of one slice.
struct Mapped {
    homography: Homography,
    by_law: Option<Homography>,
    off_law: Option<f64>,
    sigma: f64,
    source: Source,
}

/// What a family's maps do at the corners, beside the homographies, in the slices that were measured.
fn corners(maps: &[Option<Mapped>], full: &[Option<Mapped>], agreed: &[Agreed], s: &Setting) -> Vec<Corner> {
    let measured = (0..maps.len()).filter(|&i| i != s.reference && !agreed[i].evidence.matches.is_empty());
    measured
        .filter_map(|i| maps[i].as_ref().zip(full.get(i)?.as_ref()))
        .map(|(own, full)| Corner {
            sigma: own.sigma,
            full_sigma: full.sigma,
            apart: own.homography.corner_distance(&full.homography, s.width, s.height),
        })
        .collect()
}

/// The maps of all slices in one family; `None` where there is neither a measurement nor a law.
fn maps(model: Model, agreed: &[Agreed], setting: &Setting) -> Vec<Option<Mapped>> {
    match model {
        Model::Joint => joint_maps(agreed, setting),
        Model::PerSlice(family) => slice_maps(family, agreed, setting),
    }
}

/// What no count of dots takes away, px, per slice: it weighs the more the less blur has left of the pattern.
fn floors(seen: &Seen, pitch: f64) -> Vec<f64> {
    let strongest = seen.sightings.iter().flatten().map(|s| s.ripple).fold(1e-9, f64::max);
    let left = |s: &Sighting| (s.ripple / strongest).abs().clamp(0.05, 1.0);
    let floor = |s: &Option<Sighting>| {
        let blurred = s.as_ref().map_or(1.0, |s| 0.5 + 0.5 / left(s));
        (FLOOR.0 + FLOOR.1 * pitch) * blurred
    };
    seen.sightings.iter().map(floor).collect()
}

fn slice_maps(family: Family, agreed: &[Agreed], s: &Setting) -> Vec<Option<Mapped>> {
    let own = owns(family, agreed, s.reference, s.frame, [s.width, s.height]);
    let map = |free: &DVector<f64>| s.frame.homography(&family.departure(free));
    (0..own.len())
        .map(|index| {
            let (settled, source) = rail::settled(&own, s.positions, s.jump, index)?;
            let mut others = own.clone();
            others[index] = None;
            let by_law = Law::fit(&others, s.positions, s.jump).and_then(|law| map(&law.says(index)));
            let alone = own[index].as_ref().and_then(|o| map(&o.free));
            let off_law = alone.zip(by_law).map(|(a, b)| a.corner_distance(&b, s.width, s.height));
            let sigma = families::corner_sigma(family, &settled.free, &settled.covariance, s.frame, s.width, s.height);
            let by_itself = own[index]
                .as_ref()
                .map_or(0.0, |o| families::corner_sigma(family, &o.free, &o.covariance, s.frame, s.width, s.height));
            // its dots had a say, but hardly a voice
            let source = if by_itself > FAINT && sigma < 0.5 * by_itself { Source::Law } else { source };
            Some(Mapped {
                homography: map(&settled.free)?,
                by_law,
                off_law,
                sigma: sigma.hypot(s.floors[index]),
                source,
            })
        })
        .collect()
}

fn joint_maps(agreed: &[Agreed], s: &Setting) -> Vec<Option<Mapped>> {
    let matches: Vec<Vec<Match>> = agreed.iter().map(|a| a.evidence.matches.clone()).collect();
    let overlap = agreed.iter().map(|a| a.evidence.overlap).fold(1.0, f64::max);
    let Some(joint) = Joint::fit(&matches, s.away) else { return agreed.iter().map(|_| None).collect() };
    let own = owns(Family::Homography, agreed, s.reference, s.frame, [s.width, s.height]);
    let map = |p: &Departure| s.frame.homography(p);
    let off = |index: usize| {
        let mine = own[index].as_ref().and_then(|o| map(&Family::Homography.departure(&o.free)))?;
        Some(mine.corner_distance(&map(&joint.departure(s.away[index]))?, s.width, s.height))
    };
    (0..agreed.len())
        .map(|index| {
            let homography = map(&joint.departure(s.away[index]))?;
            // scatter that slices share among their dots is no noise of the dots
            let similar = families::fit(Family::Similarity, &agreed[index].evidence.matches)
                .and_then(|fit| map(&Family::Similarity.departure(&fit.free)))
                .map_or(0.0, |h| h.corner_distance(&homography, s.width, s.height));
            let sigma = s.frame.half * joint.corner_sigma(s.away[index]) * overlap.sqrt();
            let source = if agreed[index].evidence.matches.is_empty() { Source::Law } else { Source::Dots };
            let sigma = sigma.hypot(s.floors[index]).hypot(0.5 * similar);
            Some(Mapped { homography, by_law: Some(homography), off_law: off(index), sigma, source })
        })
        .collect()
}

/// The reference slice: the identity by definition.
fn itself(base: &Sighting) -> Solved {
    let dot = |(label, dot): (&Label, &super::sighting::Spotted)| Dot {
        label: *label,
        at: dot.at,
        sigma: dot.sigma,
        used: DotUse::Inlier,
    };
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

fn blind_reference(slices: &dyn Slices, reference: usize) -> Fault {
    let name = slices.name(reference);
    let detail = format!(
        "the reference slice {name} (slice {reference}) is too blurred to show the dots: name a sharper one with \
         reference_index"
    );
    Fault::new(Code::TargetNotFound, detail).in_file(name, Some(reference as u32))
}

/// The slices that are to be left out at the ends, `None` when that would leave a gap or too few.
fn ends(count: usize, lost: &[usize]) -> Option<String> {
    let first = (0..count).take_while(|i| lost.contains(i)).count();
    let last = (0..count).rev().take_while(|i| lost.contains(i)).count();
    if first + last != lost.len() || count < first + last + 2 {
        return None;
    }
    let some = |n: usize, end: &str| match n {
        0 => None,
        1 => Some(format!("the {end} slice")),
        n => Some(format!("the {end} {n} slices")),
    };
    Some([some(first, "first"), some(last, "last")].into_iter().flatten().collect::<Vec<_>>().join(" and "))
}

fn unseen(slices: &dyn Slices, indices: &[usize], why: &str) -> Fault {
    let mut names: Vec<&str> = indices.iter().take(8).map(|&i| slices.name(i)).collect();
    if indices.len() > names.len() {
        names.push("...");
    }
    let detail = format!(
        "the dots could not be measured in {}{why}: {}use a target with larger, wider spaced dots (pitch at least 2.5 \
         times the largest blur radius)",
        names.join(", "),
        ends(slices.count(), indices)
            .map_or_else(String::new, |ends| format!("leave {ends} out, of the target and of every stack alike, or ")),
    );
    let mut fault = Fault::new(Code::TargetNotFound, detail);
    for &index in indices {
        fault = fault.at(FaultPlace {
            detail: "fewer than 12 dots that agree with the reference slice".into(),
            pointer: None,
            file: Some(slices.name(index).to_owned()),
            slice: Some(index as u32),
        });
    }
    fault
}

#[cfg(test)]
mod tests {
    use super::ends;

    #[test]
    fn slices_at_the_ends_can_be_left_out_and_those_between_cannot() {
        assert_eq!(ends(9, &[0, 1, 8]).as_deref(), Some("the first 2 slices and the last slice"));
        assert_eq!(ends(9, &[7, 8]).as_deref(), Some("the last 2 slices"));
        assert_eq!(ends(9, &[0, 4]), None);
        assert_eq!(ends(3, &[0, 2]), None);
    }
}
