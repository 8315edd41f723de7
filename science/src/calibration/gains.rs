//! Gains: the factor per slice that makes it as bright as the reference slice.

use super::blur;
use super::detection::Detection;
use super::dot_photometry::{self, DotLight};
use super::statistics::median;
use super::tracking::Tracked;

/// Blur radius of each slice in grid steps, relative to the slice with the strongest pattern; `None` where no grid was
/// found.
pub(super) fn blurs(tracked: &Tracked) -> Vec<Option<f64>> {
    let strongest = tracked.detections.iter().flatten().map(|s| s.modulation).fold(1e-9, f64::max);
    tracked.detections.iter().map(|s| s.as_ref().map(|s| blur::radius((s.modulation / strongest).min(1.0)))).collect()
}

/// Dot diameter over the pitch, from the sharpest slice.
pub(super) fn fill(tracked: &Tracked) -> f64 {
    let sharpest = tracked.detections.iter().flatten().max_by(|a, b| a.modulation.total_cmp(&b.modulation));
    sharpest.map_or(0.5, |s| s.fill.clamp(0.2, 0.8))
}

/// A gain with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Gain {
    /// The factor.
    pub value: f64,
    /// Relative standard deviation.
    pub sigma: f64,
}

/// Largest relative standard deviation of a gain that counts as measured.
pub(super) const MAX_SIGMA: f64 = 0.005;
/// Largest share of a dot's window that may be synthetic or at full scale when brightness is compared.
const MAX_INVALID: f64 = 0.02;
/// Uncertainty of the camera's response curve, as a share of the difference between the linear and the sRGB result.
const CURVE_DOUBT: f64 = 0.1;

/// One gain per slice; 1 for the reference. An uncertain gain is replaced by the line through the other slices' gains,
/// `ln(gain) = a + b z`, when the line is more certain.
pub(super) fn of(tracked: &Tracked, reference: usize, positions: &[f64]) -> Vec<Gain> {
    let measured = measured(tracked, reference, positions);
    let certain: Vec<(f64, f64)> = (0..measured.len())
        .filter_map(|i| measured[i].filter(|g| g.sigma <= MAX_SIGMA).map(|g| (positions[i], g.value.ln())))
        .collect();
    let through = |z: f64| line_at(&certain, z);
    let scatter = (certain.iter().map(|(z, v)| (v - through(*z)).powi(2)).sum::<f64>()
        / (certain.len() as f64 - 2.0).max(1.0))
    .sqrt();
    let line = |i: usize| Gain {
        value: through(positions[i]).exp(),
        // a line through two points or fewer has no known uncertainty
        sigma: if certain.len() < 3 { f64::INFINITY } else { 2.0 * scatter.max(5e-4) },
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

/// Gains from the measured brightness alone.
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
        let [linear, srgb] = [false, true].map(|as_srgb| by_mean(slice, anchor, as_srgb));
        let (taken, other, share) = match curve {
            Curve::Linear => (linear, srgb, CURVE_DOUBT),
            Curve::Srgb => (srgb, linear, CURVE_DOUBT),
            Curve::Unknown => (linear, srgb, 0.5),
        };
        gains[i] = taken.map(|gain| {
            let between = other.map_or(0.0, |o| (o.value / gain.value).ln().abs());
            Gain { value: gain.value * known.value, sigma: gain.sigma.hypot(known.sigma).hypot(share * between) }
        });
    }
    gains
}

/// The gain of `slice` relative to `anchor` from the mean over whole grid steps, which blur does not change; in sRGB
/// when `as_srgb`.
fn by_mean(slice: &Detection, anchor: &Detection, as_srgb: bool) -> Option<Gain> {
    if !as_srgb {
        return against(slice, anchor, |l| Some(l.mean));
    }
    let light = against(slice, anchor, |l| l.linear_mean.map(|m| 255.0 * m))?;
    let mut levels: Vec<f64> = anchor.dots.values().filter_map(|d| d.light.bright).collect();
    if levels.is_empty() {
        return None;
    }
    let level = median(&mut levels);
    // converts the ratio of light to a ratio of values, at the bright level
    Some(Gain {
        value: level / dot_photometry::from_light(dot_photometry::to_light(level) / light.value),
        sigma: light.sigma,
    })
}

/// The response curve of the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Curve {
    /// Values are proportional to light.
    Linear,
    /// Values are sRGB.
    Srgb,
    /// Undecided.
    Unknown,
}

/// Deviations below this do not decide the response curve.
const MIN_DIFFERENCE: f64 = 2e-3;

/// Decides between a linear and an sRGB response. Two tests, the first that decides: (1) with the right curve,
/// ln(light) over the rail is a straight line; with the wrong one blur changes it, most at the ends of the stack; (2)
/// mean over bright level is the same in all slices whose bright level is free of blur.
fn curve(tracked: &Tracked, anchors: &[usize], reference: usize, positions: &[f64]) -> Curve {
    let off_line = |as_srgb: bool| -> Option<f64> {
        let base = tracked.detections[reference].as_ref()?;
        let points: Vec<(f64, f64)> = (0..positions.len())
            .filter_map(|i| Some((positions[i], by_mean(tracked.detections[i].as_ref()?, base, as_srgb)?.value.ln())))
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
    let linear = shares(&|l| l.bright.filter(|b| *b > 1.0 && l.linear_mean.is_some()).map(|b| l.mean / b));
    let srgb = shares(&|l| Some(l.linear_mean? / l.bright.filter(|b| *b > 1.0).map(dot_photometry::to_light)?));
    let lines = off_line(false).zip(off_line(true));
    for (linear, srgb) in lines.into_iter().chain([(linear, srgb)]) {
        if linear > MIN_DIFFERENCE && srgb < 0.6 * linear {
            return Curve::Srgb;
        }
        if srgb > MIN_DIFFERENCE && linear < 0.6 * srgb {
            return Curve::Linear;
        }
    }
    Curve::Unknown
}

/// Median over the shared dots of brightness in `base` over brightness in `slice`. Uses dots with valid windows in both
/// slices when there are enough of them.
fn against(slice: &Detection, base: &Detection, measure: impl Fn(&DotLight) -> Option<f64>) -> Option<Gain> {
    let ratio = |max_invalid: f64| {
        let shared = slice.dots.iter().filter_map(|(label, d)| base.dots.get(label).map(|b| (d, b)));
        let clean = shared.filter(|(d, b)| d.invalid.max(b.invalid) < max_invalid);
        dot_photometry::ratio(clean.map(|(d, b)| (measure(&d.light), measure(&b.light))))
    };
    let clean = ratio(MAX_INVALID);
    // synthetic and full-scale samples carry no information about brightness
    let extra = if clean.is_some() { 0.0 } else { MAX_SIGMA };
    let (value, sigma) = clean.or_else(|| ratio(10.0 * MAX_INVALID)).or_else(|| ratio(f64::INFINITY))?;
    Some(Gain { value, sigma: sigma.hypot(extra) })
}

/// The least-squares line through `points` at `z`; the mean when all are at one z.
fn line_at(points: &[(f64, f64)], z: f64) -> f64 {
    let n = points.len().max(1) as f64;
    let (mz, mv) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let (zz, zv) = points.iter().fold((0.0, 0.0), |s, p| (s.0 + (p.0 - mz).powi(2), s.1 + (p.0 - mz) * (p.1 - mv)));
    if zz > 0.0 { mv + zv / zz * (z - mz) } else { mv }
}
