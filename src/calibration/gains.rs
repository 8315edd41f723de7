//! Gains: what each slice is multiplied by to be as bright as the reference.

use super::blur;
use super::chain::Seen;
use super::light::{self, Light};
use super::sighting::Sighting;
use super::working::median;

/// Blur radius of each slice in steps of the grid, against the slice with the strongest pattern; `None` where
/// nothing was seen.
pub fn blurs(seen: &Seen) -> Vec<Option<f64>> {
    let strongest = seen.sightings.iter().flatten().map(|s| s.ripple).fold(1e-9, f64::max);
    seen.sightings.iter().map(|s| s.as_ref().map(|s| blur::radius((s.ripple / strongest).min(1.0)))).collect()
}

/// Diameter of a dot over the pitch, as the sharpest slice shows it.
pub fn fill(seen: &Seen) -> f64 {
    let sharpest = seen.sightings.iter().flatten().max_by(|a, b| a.ripple.total_cmp(&b.ripple));
    sharpest.map_or(0.5, |s| s.width.clamp(0.2, 0.8))
}

/// One gain per slice; 1 for the reference.
pub fn of(seen: &Seen, reference: usize, positions: &[f64]) -> Vec<f64> {
    let clear = light::clear_blur(fill(seen), seen.target.polarity);
    let blurs = blurs(seen);
    let is_clear = |i: usize| blurs[i].is_some_and(|b| b <= clear);
    let sighting = |i: usize| seen.sightings[i].as_ref();
    let count = seen.sightings.len();
    let mut gains: Vec<Option<f64>> = vec![None; count];
    for (i, gain) in gains.iter_mut().enumerate() {
        if let (true, true, Some(slice), Some(base)) =
            (is_clear(i), is_clear(reference), sighting(i), sighting(reference))
        {
            *gain = against(slice, base, |l| l.bright);
        }
    }
    gains[reference] = Some(1.0);
    let anchors: Vec<usize> = (0..count).filter(|&i| gains[i].is_some()).collect();
    let curved = is_curved(seen, &anchors);
    for i in 0..count {
        if gains[i].is_some() {
            continue;
        }
        let nearest = anchors.iter().min_by_key(|a| a.abs_diff(i)).copied().unwrap_or(reference);
        if let (Some(slice), Some(anchor), Some(known)) = (sighting(i), sighting(nearest), gains[nearest]) {
            gains[i] = by_mean(slice, anchor, curved).map(|ratio| ratio * known);
        }
    }
    let known: Vec<(f64, f64)> = (0..count).filter_map(|i| gains[i].map(|g| (positions[i], g.ln()))).collect();
    let through = |z: f64| line_at(&known, z).exp();
    (0..count).map(|i| gains[i].unwrap_or_else(|| through(positions[i])).clamp(0.05, 20.0)).collect()
}

/// What `slice` is multiplied by to be as bright as `anchor`, by the light that blur leaves alone.
fn by_mean(slice: &Sighting, anchor: &Sighting, curved: bool) -> Option<f64> {
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
    Some(level / light::from_light(light::to_light(level) / light))
}

/// Whether values are bent like sRGB rather than proportional to light: among slices whose bright level is untouched
/// by blur, the mean over the bright level is the same in whichever of the two the values are.
fn is_curved(seen: &Seen, anchors: &[usize]) -> bool {
    let shares = |of: &dyn Fn(&Light) -> Option<f64>| -> f64 {
        let per_slice = anchors.iter().filter_map(|&i| seen.sightings[i].as_ref()).filter_map(|s| {
            let mut all: Vec<f64> = s.dots.values().filter_map(|d| of(&d.light)).filter(|v| v.is_finite()).collect();
            (all.len() >= 6).then(|| median(&mut all).ln())
        });
        let values: Vec<f64> = per_slice.collect();
        values.iter().fold(f64::MIN, |m, v| m.max(*v)) - values.iter().fold(f64::MAX, |m, v| m.min(*v))
    };
    let straight = shares(&|l| l.bright.filter(|b| *b > 1.0 && l.linear_mean.is_some()).map(|b| l.mean / b));
    let bent = shares(&|l| Some(l.linear_mean? / l.bright.filter(|b| *b > 1.0).map(light::to_light)?));
    straight > 2e-3 && bent < 0.6 * straight
}

/// Light of `base` over that of `slice`, dot by dot.
fn against(slice: &Sighting, base: &Sighting, measure: impl Fn(&Light) -> Option<f64>) -> Option<f64> {
    light::ratio(
        slice.dots.iter().filter_map(|(label, d)| base.dots.get(label).map(|b| (measure(&d.light), measure(&b.light)))),
    )
}

/// The straight line through `points` at `z`; the mean when they do not make one.
fn line_at(points: &[(f64, f64)], z: f64) -> f64 {
    let n = points.len().max(1) as f64;
    let (mz, mv) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let (zz, zv) = points.iter().fold((0.0, 0.0), |s, p| (s.0 + (p.0 - mz).powi(2), s.1 + (p.0 - mz) * (p.1 - mv)));
    if zz > 0.0 { mv + zv / zz * (z - mz) } else { mv }
}
