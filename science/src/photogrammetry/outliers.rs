//! Views of a scan that differ from the others, and views that are missing.
//!
//! In: angles and metrics of each view. Out: outliers with what was expected, and the angles at which no view is.
//!
//! What an object looks like changes from view to view: the silhouette of one three times as long as wide changes by 40
//! % within 20 degrees. So a value is compared with the median of the nearest views, not with that of all. The
//! residuals of all views give the scale: a view is an outlier when its residual exceeds [`SIGMAS`] robust standard
//! deviations and the smallest deviation that matters.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::types::view::ViewAngles;

/// Robust standard deviations beyond which a value is an outlier.
const SIGMAS: f64 = 5.0;
/// Views that a value is compared with.
const NEIGHBOURS: usize = 6;
/// Fewest views with a value among which outliers are searched.
const FEWEST: usize = 5;
/// Angles that differ by less are equal, degrees.
const SAME_ANGLE: f64 = 0.01;
/// Largest number of missing views that are listed.
const MOST_MISSING: usize = 200;

/// What is known of a view; `None` where it was not measured.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ViewMeasurements {
    /// Pan and tilt.
    pub angles: Option<ViewAngles>,
    /// Mean squared Sobel gradient of the fused image.
    pub sharpness: Option<f64>,
    /// Share of the canvas that is the object.
    pub mask_area: Option<f64>,
    /// 95th percentile of the residual shifts between neighbouring slices, px.
    pub residual_px: Option<f64>,
    /// Mean luma of the object, 0 to 255.
    pub mean_level: Option<f64>,
}

/// The quantity in which a view differs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum OutlierKind {
    /// Less sharp than its neighbours.
    Sharpness,
    /// The mask is larger or smaller than those of its neighbours.
    MaskArea,
    /// The slices fit one another worse than in other views.
    Residual,
    /// The object is brighter or darker than in other views.
    Exposure,
}

/// A view that differs from its neighbours in one quantity.
#[derive(Debug, Clone, PartialEq)]
pub struct Outlier {
    /// Index of the view.
    pub view: usize,
    /// The quantity.
    pub kind: OutlierKind,
    /// Its value.
    pub value: f64,
    /// The median of the nearest views.
    pub expected: f64,
}

/// How values of a quantity are compared.
struct Rule {
    kind: OutlierKind,
    value: fn(&ViewMeasurements) -> Option<f64>,
    /// Compared by ratio (true) or by difference.
    by_ratio: bool,
    /// Smallest ratio or difference that matters.
    least: f64,
    /// Whether values above, and values below the expectation are outliers.
    above: bool,
    below: bool,
}

const RULES: [Rule; 4] = [
    Rule {
        kind: OutlierKind::Sharpness,
        value: |view| view.sharpness,
        by_ratio: true,
        least: 2.0,
        above: false,
        below: true,
    },
    Rule {
        kind: OutlierKind::MaskArea,
        value: |view| view.mask_area,
        by_ratio: true,
        least: 1.6,
        above: true,
        below: true,
    },
    Rule {
        kind: OutlierKind::Residual,
        value: |view| view.residual_px,
        by_ratio: false,
        least: 0.3,
        above: true,
        below: false,
    },
    Rule {
        kind: OutlierKind::Exposure,
        value: |view| view.mean_level,
        by_ratio: true,
        least: 1.3,
        above: true,
        below: true,
    },
];

/// The outliers among `views`, by view.
pub fn outliers(views: &[ViewMeasurements]) -> Vec<Outlier> {
    let mut found: Vec<Outlier> = RULES.iter().flat_map(|rule| by_rule(views, rule)).collect();
    found.sort_by_key(|outlier| (outlier.view, outlier.kind));
    found
}

fn by_rule(views: &[ViewMeasurements], rule: &Rule) -> Vec<Outlier> {
    let is_usable = |value: &f64| value.is_finite() && (!rule.by_ratio || *value > 0.0);
    let values: Vec<(usize, f64)> =
        views.iter().enumerate().filter_map(|(at, view)| Some((at, (rule.value)(view).filter(is_usable)?))).collect();
    if values.len() < FEWEST {
        return Vec::new();
    }
    let scaled = |value: f64| if rule.by_ratio { value.ln() } else { value };
    let least = scaled(rule.least);
    let expected: Vec<f64> = values.iter().map(|&(at, _)| expectation(views, &values, at)).collect();
    let residuals: Vec<f64> =
        values.iter().zip(&expected).map(|(&(_, value), &expected)| scaled(value) - scaled(expected)).collect();
    let spread = 1.4826 * median(residuals.iter().map(|residual| residual.abs()).collect());
    let limit = least.max(SIGMAS * spread);
    let differs = |residual: f64| (rule.above && residual > limit) || (rule.below && residual < -limit);
    let all = values.iter().zip(&expected).zip(&residuals);
    all.filter(|(_, residual)| differs(**residual))
        .map(|((&(view, value), &expected), _)| Outlier { view, kind: rule.kind, value, expected })
        .collect()
}

/// The median of the values nearest to view `at` in angle, without its own; of all others where angles are unknown.
fn expectation(views: &[ViewMeasurements], values: &[(usize, f64)], at: usize) -> f64 {
    let others = values.iter().filter(|(other, _)| *other != at);
    let Some(own) = views[at].angles else { return median(others.map(|(_, value)| *value).collect()) };
    let own = own.direction();
    let mut near: Vec<(f64, f64)> = others
        .filter_map(|&(other, value)| {
            let direction = views[other].angles?.direction();
            let cosine: f64 = own.iter().zip(direction).map(|(a, b)| a * b).sum();
            Some((-cosine, value))
        })
        .collect();
    if near.is_empty() {
        return median(values.iter().map(|(_, value)| *value).collect());
    }
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    median(near.into_iter().take(NEIGHBOURS).map(|(_, value)| value).collect())
}

/// The median; 0 of nothing.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => 0.0,
        n if n % 2 == 1 => values[n / 2],
        n => f64::midpoint(values[n / 2 - 1], values[n / 2]),
    }
}

/// The angles at which a view is missing from the grid of pan and tilt that the other views form, at most
/// 200, by tilt and pan. Empty when the views form no grid: fewer than two positions of pan, or rings of
/// different positions.
///
/// A position belongs to the grid when at least half of the rings (views of equal tilt) have it, or when it closes a
/// gap of a whole number of steps within a ring.
pub fn missing_views(angles: &[ViewAngles]) -> Vec<ViewAngles> {
    let rings = rings(angles);
    let mut missing = Vec::new();
    for (tilt_deg, pans) in &rings {
        let of_other_rings = rings.iter().flat_map(|(_, pans)| pans).copied();
        let is_common = |pan: f64| 2 * rings.iter().filter(|(_, pans)| has(pans, pan)).count() >= rings.len();
        let candidates = of_other_rings.filter(|&pan| rings.len() > 1 && is_common(pan)).chain(gaps(pans));
        for pan_deg in candidates {
            let is_listed = |view: &ViewAngles| view.tilt_deg == *tilt_deg && same(view.pan_deg, pan_deg);
            if !has(pans, pan_deg) && !missing.iter().any(is_listed) && missing.len() < MOST_MISSING {
                missing.push(ViewAngles { pan_deg, tilt_deg: *tilt_deg });
            }
        }
    }
    missing.sort_by(|a, b| a.tilt_deg.total_cmp(&b.tilt_deg).then(a.pan_deg.total_cmp(&b.pan_deg)));
    missing
}

/// The views by tilt: the sorted pans, 0 to 360, of each.
fn rings(angles: &[ViewAngles]) -> Vec<(f64, Vec<f64>)> {
    let mut sorted: Vec<ViewAngles> =
        angles.iter().filter(|view| view.pan_deg.is_finite() && view.tilt_deg.is_finite()).copied().collect();
    sorted.sort_by(|a, b| a.tilt_deg.total_cmp(&b.tilt_deg));
    let mut rings: Vec<(f64, Vec<f64>)> = Vec::new();
    for view in sorted {
        let pan = view.pan_deg.rem_euclid(360.0);
        match rings.last_mut() {
            Some((tilt, pans)) if view.tilt_deg - *tilt < SAME_ANGLE => pans.push(pan),
            _ => rings.push((view.tilt_deg, vec![pan])),
        }
    }
    for (_, pans) in &mut rings {
        pans.sort_by(f64::total_cmp);
        pans.dedup_by(|a, b| same(*a, *b));
    }
    rings
}

/// The positions that are missing between neighbours of a ring, by the median step. A gap of more than half a turn is
/// taken for the end of a partial ring.
fn gaps(pans: &[f64]) -> Vec<f64> {
    if pans.len() < 4 {
        return Vec::new();
    }
    let next = |at: usize| if at + 1 < pans.len() { pans[at + 1] } else { pans[0] + 360.0 };
    let step = median((0..pans.len()).map(|at| next(at) - pans[at]).collect());
    let mut missing = Vec::new();
    for (at, &pan) in pans.iter().enumerate() {
        let gap = next(at) - pan;
        let steps = (gap / step).round();
        let is_whole = (gap - steps * step).abs() < 0.1 * step;
        if steps < 1.5 || gap > 180.0 || !is_whole {
            continue;
        }
        missing.extend((1..steps as usize).map(|k| (pan + gap * k as f64 / steps).rem_euclid(360.0)));
    }
    missing
}

fn has(pans: &[f64], pan: f64) -> bool {
    pans.iter().any(|&other| same(other, pan))
}

/// Whether two pans are the same direction.
fn same(a: f64, b: f64) -> bool {
    let difference = (a - b).rem_euclid(360.0);
    difference.min(360.0 - difference) < SAME_ANGLE
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(pans: usize, tilts: &[f64]) -> Vec<ViewAngles> {
        let ring =
            |tilt_deg: f64| (0..pans).map(move |k| ViewAngles { pan_deg: 360.0 / pans as f64 * k as f64, tilt_deg });
        tilts.iter().flat_map(|&tilt| ring(tilt)).collect()
    }

    /// An elongated object: area and sharpness depend on the pan.
    fn scan() -> Vec<ViewMeasurements> {
        let of = |(at, angles): (usize, ViewAngles)| {
            // an ellipsoid three times as long as wide
            let side = (1.0 + 8.0 * angles.pan_deg.to_radians().sin().powi(2)).sqrt();
            let jitter = 1.0 + 0.01 * ((at * 7) % 5) as f64;
            ViewMeasurements {
                angles: Some(angles),
                sharpness: Some(400.0 * side.sqrt() * jitter),
                mask_area: Some(0.05 * side * jitter),
                residual_px: Some(0.2 + 0.05 * jitter),
                mean_level: Some(90.0 * jitter),
            }
        };
        grid(18, &[0.0, 12.0]).into_iter().enumerate().map(of).collect()
    }

    #[test]
    fn an_object_that_looks_different_from_each_side_has_no_outliers() {
        assert_eq!(outliers(&scan()), []);
    }

    #[test]
    fn each_kind_of_outlier_is_named_at_its_view_only() {
        let mut views = scan();
        views[3].sharpness = views[3].sharpness.map(|value| value / 4.0);
        views[10].mask_area = views[10].mask_area.map(|value| 4.0 * value);
        views[20].residual_px = Some(1.5);
        views[30].mean_level = Some(60.0);
        let found: Vec<(usize, OutlierKind)> = outliers(&views).iter().map(|o| (o.view, o.kind)).collect();
        let expected = [
            (3, OutlierKind::Sharpness),
            (10, OutlierKind::MaskArea),
            (20, OutlierKind::Residual),
            (30, OutlierKind::Exposure),
        ];
        assert_eq!(found, expected);
    }

    #[test]
    fn sharper_views_and_smaller_residuals_are_no_outliers() {
        let mut views = scan();
        views[3].sharpness = views[3].sharpness.map(|value| 3.0 * value);
        views[20].residual_px = Some(0.01);
        assert_eq!(outliers(&views), []);
    }

    #[test]
    fn values_that_are_missing_or_not_finite_are_passed_over() {
        let mut views = scan();
        views.iter_mut().for_each(|view| view.angles = None);
        views[0].mask_area = Some(f64::NAN);
        views[1].mask_area = None;
        views[2].mean_level = Some(9.0);
        let found: Vec<(usize, OutlierKind)> = outliers(&views).iter().map(|o| (o.view, o.kind)).collect();
        assert_eq!(found, [(2, OutlierKind::Exposure)]);
        assert_eq!(outliers(&views[..FEWEST - 1]), []);
    }

    #[test]
    fn missing_positions_of_the_grid_are_found() {
        let mut angles = grid(18, &[0.0, 6.0, 12.0]);
        assert_eq!(missing_views(&angles), []);
        let removed = [angles.remove(40), angles.remove(17), angles.remove(0)];
        let mut missing = missing_views(&angles);
        missing.reverse();
        assert_eq!(missing, removed);
    }

    #[test]
    fn a_gap_in_a_single_ring_is_found_and_a_partial_ring_has_none() {
        let mut ring = grid(12, &[0.0]);
        ring.remove(5);
        ring.remove(5);
        let pans: Vec<f64> = missing_views(&ring).iter().map(|view| view.pan_deg.round()).collect();
        assert_eq!(pans, [150.0, 180.0]);
        let partial: Vec<ViewAngles> = grid(36, &[0.0]).into_iter().take(12).collect();
        assert_eq!(missing_views(&partial), []);
        assert_eq!(missing_views(&[]), []);
    }
}
