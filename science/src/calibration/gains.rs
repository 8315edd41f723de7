//! Gains: what each slice is multiplied by to be as bright as the reference.

use super::blur;
use super::detection::Detection;
use super::dot_photometry::{self, DotLight};
use super::tracking::Tracked;
use super::working_image::median;

/// Blur radius of each slice in steps of the grid, against the slice with the strongest pattern; `None` where
/// nothing was tracked.
pub(super) fn blurs(tracked: &Tracked) -> Vec<Option<f64>> {
    let strongest = tracked.detections.iter().flatten().map(|s| s.modulation).fold(1e-9, f64::max);
    tracked.detections.iter().map(|s| s.as_ref().map(|s| blur::radius((s.modulation / strongest).min(1.0)))).collect()
}

/// Diameter of a dot over the pitch, as the sharpest slice shows it.
pub(super) fn fill(tracked: &Tracked) -> f64 {
    let sharpest = tracked.detections.iter().flatten().max_by(|a, b| a.modulation.total_cmp(&b.modulation));
    sharpest.map_or(0.5, |s| s.fill.clamp(0.2, 0.8))
}

/// What a slice is multiplied by, and how sure that is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Gain {
    /// The factor.
    pub value: f64,
    /// Its relative standard deviation.
    pub sigma: f64,
}

/// Relative uncertainty beyond which a gain is not taken as measured.
pub(super) const MAX_SIGMA: f64 = 0.005;
/// Share of a dot's window that may be made up or at full scale when light is compared.
const MAX_INVALID: f64 = 0.02;
/// How far a camera's curve may be from what it is taken for, as a share of what that makes.
const ODD_CURVE: f64 = 0.1;

/// One gain per slice; 1 for the reference. What is measured badly is replaced by what the other slices' gains, which lie
/// on a straight line over the rail in logarithms, say of it.
pub(super) fn of(tracked: &Tracked, reference: usize, positions: &[f64]) -> Vec<Gain> {
    let measured = measured(tracked, reference, positions);
    let sure: Vec<(f64, f64)> = (0..measured.len())
        .filter_map(|i| measured[i].filter(|g| g.sigma <= MAX_SIGMA).map(|g| (positions[i], g.value.ln())))
        .collect();
    let through = |z: f64| line_at(&sure, z);
    let scatter =
        (sure.iter().map(|(z, v)| (v - through(*z)).powi(2)).sum::<f64>() / (sure.len() as f64 - 2.0).max(1.0)).sqrt();
    let line = |i: usize| Gain {
        value: through(positions[i]).exp(),
        // a line through two points or fewer is a guess
        sigma: if sure.len() < 3 { f64::INFINITY } else { 2.0 * scatter.max(5e-4) },
    };
    let settle = |i: usize| {
        let gain = match measured[i] {
            Some(own) if own.sigma <= MAX_SIGMA || own.sigma <= line(i).sigma => own,
            _ => line(i),
        };
        Gain { value: gain.value.clamp(0.05, 20.0), ..gain }
    };
    (0..measured.len()).map(settle).collect()
}

/// What the light itself says.
fn measured(tracked: &Tracked, reference: usize, positions: &[f64]) -> Vec<Option<Gain>> {
    let clear = dot_photometry::clear_blur(fill(tracked), tracked.target.polarity);
    let blurs = blurs(tracked);
    let is_clear = |i: usize| blurs[i].is_some_and(|b| b <= clear);
    let detection = |i: usize| tracked.detections[i].as_ref();
    let count = tracked.detections.len();
    let mut gains: Vec<Option<Gain>> = vec![None; count];
    for (i, gain) in gains.iter_mut().enumerate() {
        if let (true, true, Some(slice), Some(base)) =
            (is_clear(i), is_clear(reference), detection(i), detection(reference))
        {
            *gain = against(slice, base, |l| l.bright);
        }
    }
    gains[reference] = Some(Gain { value: 1.0, sigma: 0.0 });
    let anchors: Vec<usize> = (0..count).filter(|&i| gains[i].is_some()).collect();
    let curve = curve(tracked, &anchors, reference, positions);
    for i in 0..count {
        if gains[i].is_some() {
            continue;
        }
        let nearest = anchors.iter().min_by_key(|a| a.abs_diff(i)).copied().unwrap_or(reference);
        let (Some(slice), Some(anchor), Some(known)) = (detection(i), detection(nearest), gains[nearest]) else {
            continue;
        };
        let [straight, bent] = [false, true].map(|curved| by_mean(slice, anchor, curved));
        let (taken, other, doubt) = match curve {
            Curve::Linear => (straight, bent, ODD_CURVE),
            Curve::Srgb => (bent, straight, ODD_CURVE),
            Curve::Unknown => (straight, bent, 0.5),
        };
        gains[i] = taken.map(|gain| {
            let between = other.map_or(0.0, |o| (o.value / gain.value).ln().abs());
            Gain { value: gain.value * known.value, sigma: gain.sigma.hypot(known.sigma).hypot(doubt * between) }
        });
    }
    gains
}

/// What `slice` is multiplied by to be as bright as `anchor`, by the light that blur leaves alone.
fn by_mean(slice: &Detection, anchor: &Detection, curved: bool) -> Option<Gain> {
    if !curved {
        return against(slice, anchor, |l| Some(l.mean));
    }
    let light = against(slice, anchor, |l| l.linear_mean.map(|m| 255.0 * m))?;
    let mut levels: Vec<f64> = anchor.dots.values().filter_map(|d| d.light.bright).collect();
    if levels.is_empty() {
        return None;
    }
    let level = median(&mut levels);
    // so much light less makes the bright level so much lower, along the curve
    Some(Gain {
        value: level / dot_photometry::from_light(dot_photometry::to_light(level) / light.value),
        sigma: light.sigma,
    })
}

/// How values follow from light.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Curve {
    /// They are proportional to it.
    Linear,
    /// They are sRGB.
    Srgb,
    /// That cannot be told.
    Unknown,
}

/// Differences below this tell nothing about the curve.
const TELLING: f64 = 2e-3;

/// Whether values are bent like sRGB or proportional to light. In the right one of the two, the light on the target is a
/// straight line over the rail in logarithms, whereas in the wrong one blur adds to it, most at the ends of the stack;
/// and the mean over the bright level is the same in all slices whose bright level is untouched by blur.
fn curve(tracked: &Tracked, anchors: &[usize], reference: usize, positions: &[f64]) -> Curve {
    let off_line = |curved: bool| -> Option<f64> {
        let base = tracked.detections[reference].as_ref()?;
        let points: Vec<(f64, f64)> = (0..positions.len())
            .filter_map(|i| Some((positions[i], by_mean(tracked.detections[i].as_ref()?, base, curved)?.value.ln())))
            .collect();
        let square = points.iter().map(|(z, v)| (v - line_at(&points, *z)).powi(2)).sum::<f64>();
        (points.len() >= 5).then(|| (square / (points.len() as f64 - 2.0)).sqrt())
    };
    let shares = |of: &dyn Fn(&DotLight) -> Option<f64>| -> f64 {
        let per_slice = anchors.iter().filter_map(|&i| tracked.detections[i].as_ref()).filter_map(|s| {
            let clean = s.dots.values().filter(|d| d.invalid < MAX_INVALID);
            let mut all: Vec<f64> = clean.filter_map(|d| of(&d.light)).filter(|v| v.is_finite()).collect();
            (all.len() >= 6).then(|| median(&mut all).ln())
        });
        let values: Vec<f64> = per_slice.collect();
        values.iter().fold(f64::MIN, |m, v| m.max(*v)) - values.iter().fold(f64::MAX, |m, v| m.min(*v))
    };
    let straight = shares(&|l| l.bright.filter(|b| *b > 1.0 && l.linear_mean.is_some()).map(|b| l.mean / b));
    let bent = shares(&|l| Some(l.linear_mean? / l.bright.filter(|b| *b > 1.0).map(dot_photometry::to_light)?));
    let lines = off_line(false).zip(off_line(true));
    for (straight, bent) in lines.into_iter().chain([(straight, bent)]) {
        if straight > TELLING && bent < 0.6 * straight {
            return Curve::Srgb;
        }
        if bent > TELLING && straight < 0.6 * bent {
            return Curve::Linear;
        }
    }
    Curve::Unknown
}

/// DotLight of `base` over that of `slice`, dot by dot; by the dots whose surroundings are their own in both, where there
/// are any.
fn against(slice: &Detection, base: &Detection, measure: impl Fn(&DotLight) -> Option<f64>) -> Option<Gain> {
    let ratio = |most: f64| {
        let shared = slice.dots.iter().filter_map(|(label, d)| base.dots.get(label).map(|b| (d, b)));
        let clean = shared.filter(|(d, b)| d.invalid.max(b.invalid) < most);
        dot_photometry::ratio(clean.map(|(d, b)| (measure(&d.light), measure(&b.light))))
    };
    let clean = ratio(MAX_INVALID);
    // what is drawn in is a guess, and what is at full scale tells nothing
    let doubt = if clean.is_some() { 0.0 } else { MAX_SIGMA };
    let (value, sigma) = clean.or_else(|| ratio(10.0 * MAX_INVALID)).or_else(|| ratio(f64::INFINITY))?;
    Some(Gain { value, sigma: sigma.hypot(doubt) })
}

/// The straight line through `points` at `z`; the mean when they do not make one.
fn line_at(points: &[(f64, f64)], z: f64) -> f64 {
    let n = points.len().max(1) as f64;
    let (mz, mv) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let (zz, zv) = points.iter().fold((0.0, 0.0), |s, p| (s.0 + (p.0 - mz).powi(2), s.1 + (p.0 - mz) * (p.1 - mv)));
    if zz > 0.0 { mv + zv / zz * (z - mz) } else { mv }
}
