//! Views of a scan that differ from the others.
//!
//! In: angles and metrics of each view. Out: outliers with what was expected.
//!
//! What an object looks like changes from view to view: the silhouette of one three times as long as wide changes by 40
//! % within 20 degrees. So a value is compared with the median of the nearest views, not with that of all. The
//! residuals of all views give the scale: a view is an outlier when its residual exceeds [`SIGMAS`] robust standard
//! deviations and the smallest deviation that matters.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::statistics::median;
use crate::types::view::ViewAngles;

/// Robust standard deviations beyond which a value is an outlier.
const SIGMAS: f64 = 5.0;
/// Views that a value is compared with.
const NEIGHBOURS: usize = 6;
/// Fewest views with a value among which outliers are searched.
const FEWEST: usize = 5;
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

/// The outliers among `views`, by view. The time grows with the square of their number.
pub fn outliers(views: &[ViewMeasurements]) -> Vec<Outlier> {
    let directions: Vec<Option<[f64; 3]>> =
        views.iter().map(|view| view.angles.map(|angles| angles.direction())).collect();
    let mut found: Vec<Outlier> = RULES.iter().flat_map(|rule| by_rule(views, &directions, rule)).collect();
    found.sort_by_key(|outlier| (outlier.view, outlier.kind));
    found
}

fn by_rule(views: &[ViewMeasurements], directions: &[Option<[f64; 3]>], rule: &Rule) -> Vec<Outlier> {
    let is_usable = |value: &f64| value.is_finite() && (!rule.by_ratio || *value > 0.0);
    let values: Vec<(usize, f64)> =
        views.iter().enumerate().filter_map(|(at, view)| Some((at, (rule.value)(view).filter(is_usable)?))).collect();
    if values.len() < FEWEST {
        return Vec::new();
    }
    let scaled = |value: f64| if rule.by_ratio { value.ln() } else { value };
    let least = scaled(rule.least);
    let overall = median(values.iter().map(|(_, value)| *value).collect());
    let expectation = |&(at, _): &(usize, f64)| near(directions, &values, at).map_or(overall, median);
    let expected: Vec<f64> = values.iter().map(expectation).collect();
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

/// The values of the views that are nearest in angle to view `at`, without its own; `None` where angles are unknown.
fn near(directions: &[Option<[f64; 3]>], values: &[(usize, f64)], at: usize) -> Option<Vec<f64>> {
    let own = directions[at]?;
    let mut others: Vec<(f64, f64)> = values
        .iter()
        .filter(|(other, _)| *other != at)
        .filter_map(|&(other, value)| {
            let cosine: f64 = own.iter().zip(directions[other]?).map(|(a, b)| a * b).sum();
            Some((-cosine, value))
        })
        .collect();
    if others.len() > NEIGHBOURS {
        // equal distances are told apart by the values, so that the choice does not depend on the order of the views
        others.select_nth_unstable_by(NEIGHBOURS, |a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        others.truncate(NEIGHBOURS);
    }
    (!others.is_empty()).then(|| others.into_iter().map(|(_, value)| value).collect())
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

    /// Two thousand views at angles of their own: work that grew with the cube of their number would not end.
    #[test]
    fn a_scan_of_many_rings_is_searched_in_bounded_time() {
        let of = |at: i32| ViewMeasurements {
            angles: Some(ViewAngles { pan_deg: f64::from(at % 360), tilt_deg: -90.0 + f64::from(at) * 0.018 }),
            mean_level: Some(90.0),
            ..ViewMeasurements::default()
        };
        assert_eq!(outliers(&(0..2000).map(of).collect::<Vec<_>>()), []);
    }
}
