//! From dots to homographies, slice by slice, and from the others for a slice that cannot be measured.

use super::chain::Seen;
use super::dlt::Pair;
use super::field::Polarity;
use super::lattice::{LEAST_DOTS, Label};
use super::rail::{Known, Law};
use super::sighting::Sighting;
use super::working::{median, quantile};
use super::{Dot, DotUse, refine, robust};
use crate::imaging::Slices;
use crate::model::error::FaultPlace;
use crate::model::{Code, Control, Fault, Homography, Stop};

/// The geometry and light of one slice.
#[derive(Debug, Clone)]
pub struct Solved {
    /// Slice px -> reference-slice px.
    pub homography: Homography,
    /// Multiply by this to match the reference.
    pub gain: f64,
    /// Standard deviation of the worst corner, px.
    pub corner_sigma: f64,
    /// RMS of the inliers in the reference slice, px; `None` when predicted.
    pub rms: Option<f64>,
    /// 95th percentile of the same.
    pub p95: Option<f64>,
    /// The dots found.
    pub dots: Vec<Dot>,
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
    /// The measured ones.
    pub known: Vec<Known>,
}

/// Corner error of the law of the rail beyond which no slice is predicted by it, px.
const WORST_LAW: f64 = 1.0;
/// Uncertainty of the worst corner beyond which a slice counts as not measured, px.
const WORST_CORNER: f64 = 1.5;
/// Distance beyond which a dot never counts as an inlier, px; or a share of the pitch where that is more.
const MOST: f64 = 1.0;

/// Solves every slice.
///
/// # Errors
/// A fault naming the slices that can neither be measured nor predicted.
pub fn solve(slices: &dyn Slices, seen: &Seen, reference: usize, control: &dyn Control) -> Result<Solution, Stop> {
    let (width, height) = (seen.width as u32, seen.height as u32);
    let Some(base) = seen.sightings[reference].as_ref() else {
        return Err(blind_reference(slices, reference).into());
    };
    let mut measured: Vec<Option<Solved>> = Vec::with_capacity(seen.sightings.len());
    for (index, sighting) in seen.sightings.iter().enumerate() {
        control.check()?;
        measured.push(match sighting {
            _ if index == reference => Some(itself(base)),
            Some(sighting) => one(sighting, base, seen),
            None => None,
        });
    }
    let known: Vec<Known> = measured
        .iter()
        .enumerate()
        .filter_map(|(index, s)| s.as_ref().map(|s| Known { index, homography: s.homography, sigma: s.corner_sigma }))
        .collect();
    let missing: Vec<usize> = (0..measured.len()).filter(|&i| measured[i].is_none()).collect();
    let law = if missing.is_empty() { None } else { trusted_law(slices, &known, &missing, width, height)? };
    let mut out = Vec::with_capacity(measured.len());
    for (index, solved) in measured.into_iter().enumerate() {
        let solved = match (solved, &law) {
            (Some(solved), _) => solved,
            (None, Some(law)) => predicted(law, index, seen, base).ok_or_else(|| unseen(slices, &[index], ""))?,
            (None, None) => return Err(unseen(slices, &[index], "").into()),
        };
        if let Some(why) = solved.homography.objection(width, height) {
            let name = slices.name(index);
            let detail = format!("the homography of {name} (slice {index}) {why}: this is no view of the same target");
            return Err(Fault::new(Code::TargetNotFound, detail).in_file(name, Some(index as u32)).into());
        }
        out.push(solved);
    }
    Ok(Solution { reference, slices: out, known })
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
        gain: 1.0,
        corner_sigma: 0.0,
        rms: Some(0.0),
        p95: Some(0.0),
        dots: base.dots.iter().map(dot).collect(),
        interpolated: false,
    }
}

/// One slice from the dots it shares with the reference, or `None` when they do not suffice.
fn one(sighting: &Sighting, base: &Sighting, seen: &Seen) -> Option<Solved> {
    let shared: Vec<(Label, Pair, [f64; 2])> = sighting
        .dots
        .iter()
        .filter_map(|(label, dot)| base.dots.get(label).map(|b| (*label, (dot.at, b.at), [dot.sigma, b.sigma])))
        .collect();
    let pairs: Vec<Pair> = shared.iter().map(|s| s.1).collect();
    if pairs.len() < LEAST_DOTS {
        return None;
    }
    let scale = base.pitch / sighting.pitch;
    let consensus = robust::agree(&pairs, 0.15, MOST.max(0.02 * base.pitch))?;
    let kept: Vec<(Pair, f64)> = shared
        .iter()
        .zip(&consensus.agrees)
        .filter(|(_, agrees)| **agrees)
        .map(|((_, pair, sigmas), _)| (*pair, (scale * sigmas[0]).hypot(sigmas[1])))
        .collect();
    if kept.len() < LEAST_DOTS || 2 * kept.len() < pairs.len() {
        return None;
    }
    let (inliers, sigmas): (Vec<Pair>, Vec<f64>) = kept.into_iter().unzip();
    let refined = refine::refine(&consensus.homography, &inliers, &sigmas, seen.width as u32, seen.height as u32)?;
    if refined.corner_sigma > WORST_CORNER {
        return None;
    }
    let mut misses: Vec<f64> = inliers.iter().map(|pair| robust::miss(&refined.homography, pair)).collect();
    let rms = (misses.iter().map(|m| m * m).sum::<f64>() / misses.len() as f64).sqrt();
    let agrees: std::collections::BTreeMap<Label, bool> =
        shared.iter().map(|s| s.0).zip(consensus.agrees.iter().copied()).collect();
    let used = |label: &Label| match agrees.get(label) {
        Some(true) => DotUse::Inlier,
        Some(false) => DotUse::Outlier,
        None => DotUse::Unused,
    };
    let dots =
        sighting.dots.iter().map(|(label, d)| Dot { label: *label, at: d.at, sigma: d.sigma, used: used(label) });
    Some(Solved {
        homography: refined.homography,
        gain: gain(sighting, base, seen.target.polarity),
        corner_sigma: refined.corner_sigma,
        rms: Some(rms),
        p95: Some(quantile(&mut misses, 0.95)),
        dots: dots.collect(),
        interpolated: false,
    })
}

/// Light of the reference over light of the slice: of the white ground where both show the same dots, or, with
/// bright dots, of what the dots send in all, which blur does not change.
fn gain(sighting: &Sighting, base: &Sighting, polarity: Polarity) -> f64 {
    let ratio = match polarity {
        Polarity::DarkOnLight => {
            let shared = sighting.dots.iter().filter_map(|(label, dot)| base.dots.get(label).map(|b| (dot, b)));
            median(
                &mut shared.map(|(d, b)| base.ground_at(b.at) / sighting.ground_at(d.at).max(0.1)).collect::<Vec<_>>(),
            )
        }
        Polarity::LightOnDark => {
            let scale = base.pitch / sighting.pitch;
            base.flux / (sighting.flux * scale * scale)
        }
    };
    if ratio.is_finite() && ratio > 0.0 { ratio.clamp(0.05, 20.0) } else { 1.0 }
}

/// The law of the rail when it can be trusted to stand in for the slices `missing`.
fn trusted_law(
    slices: &dyn Slices,
    known: &[Known],
    missing: &[usize],
    width: u32,
    height: u32,
) -> Result<Option<Law>, Fault> {
    let enough = known.len() >= 3 && 2 * known.len() >= known.len() + missing.len();
    let law = if enough { Law::fit(known, width, height) } else { None };
    match law {
        Some(law) if law.corner_rms <= WORST_LAW => Ok(Some(law)),
        Some(law) => {
            let why = format!(
                ", and the other slices do not lie evenly enough on the rail to predict them (off by {:.1} px)",
                law.corner_rms
            );
            Err(unseen(slices, missing, &why))
        }
        None => Err(unseen(slices, missing, ", and too few other slices could be to predict them")),
    }
}

fn predicted(law: &Law, index: usize, seen: &Seen, base: &Sighting) -> Option<Solved> {
    let homography = law.predict(index)?;
    let sighting = seen.sightings[index].as_ref();
    let dots = sighting.map(|s| {
        let dot = |(label, d): (&Label, &super::sighting::Spotted)| Dot {
            label: *label,
            at: d.at,
            sigma: d.sigma,
            used: DotUse::Unused,
        };
        s.dots.iter().map(dot).collect()
    });
    Some(Solved {
        homography,
        gain: sighting.map_or(1.0, |s| gain(s, base, seen.target.polarity)),
        corner_sigma: law.corner_rms,
        rms: None,
        p95: None,
        dots: dots.unwrap_or_default(),
        interpolated: true,
    })
}

fn blind_reference(slices: &dyn Slices, reference: usize) -> Fault {
    let name = slices.name(reference);
    let detail = format!(
        "the reference slice {name} (slice {reference}) is too blurred to show the dots: name a sharper one with \
         reference_index"
    );
    Fault::new(Code::TargetNotFound, detail).in_file(name, Some(reference as u32))
}

fn unseen(slices: &dyn Slices, indices: &[usize], why: &str) -> Fault {
    let names: Vec<&str> = indices.iter().map(|&i| slices.name(i)).collect();
    let detail = format!(
        "the dots could not be measured in {}{why}: use a target with larger, wider spaced dots (pitch at least 2.5 \
         times the largest blur radius) or leave these slices out",
        names.join(", ")
    );
    let mut fault = Fault::new(Code::TargetNotFound, detail);
    for &index in indices {
        fault = fault.at(FaultPlace {
            detail: "fewer than 12 dots that the reference slice shows too".into(),
            pointer: None,
            file: Some(slices.name(index).to_owned()),
            slice: Some(index as u32),
        });
    }
    fault
}
