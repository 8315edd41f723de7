//! Reading the sizes of the dots: how much darker (on a dark target: brighter) each dot is than the others.
//!
//! The reading is the mean contrast over a disc about as wide as a large dot. Under a blur of radius `r` the image of a
//! dot is flat out to `r` minus its own radius and ends at their sum, so up to `r = 0.5` of the pitch no neighbour
//! contributes noticeably; a size is readable in a slice whose dots overlap completely.

use nalgebra::{SMatrix, SVector};

use crate::calibration::lattice::{self, Label, Places};
use crate::calibration::statistics::median_of;
use crate::imaging::Plane;

/// Radius of the disc, in grid steps.
const RADIUS: f64 = 0.32;
/// Deviation from the mean contrast that counts as a full reading, over the median deviation.
const FULL: f64 = 0.7;
/// Terms of the surface of the mean contrast: 1, x, y, x^2, xy, y^2.
const TERMS: usize = 6;

/// Per dot whose disc lies in the image: its size relative to the others, -1 (small) to 1 (large).
pub(super) fn read(contrast: &Plane<f32>, places: &Places) -> Vec<(Label, f64)> {
    let pitch = lattice::pitch_of(places);
    let means: Vec<(Label, [f64; 2], f64)> = places
        .iter()
        .filter_map(|(label, at)| mean_in_disc(contrast, *at, RADIUS * pitch).map(|mean| (*label, *at, mean)))
        .collect();
    let Some(deviations) = deviations(&means, contrast.width.max(contrast.height) as f64) else { return Vec::new() };
    let full = (FULL * median_of(deviations.iter().map(|d| d.abs()))).max(1e-9);
    means
        .iter()
        .zip(&deviations)
        .map(|((label, ..), deviation)| (*label, (deviation / full).clamp(-1.0, 1.0)))
        .collect()
}

/// Mean over the disc, with pixels at its rim counted partly; `None` when it leaves the plane.
fn mean_in_disc(plane: &Plane<f32>, at: [f64; 2], radius: f64) -> Option<f64> {
    let reach = radius + 0.5;
    let inside = |v: f64, size: usize| v - reach >= 0.0 && v + reach <= size as f64 - 1.0;
    if !inside(at[0], plane.width) || !inside(at[1], plane.height) {
        return None;
    }
    let range = |v: f64| (v - reach).ceil() as usize..=(v + reach).floor() as usize;
    let (mut sum, mut weights) = (0.0, 0.0);
    for y in range(at[1]) {
        let dy = y as f64 - at[1];
        for x in range(at[0]) {
            let dx = x as f64 - at[0];
            let weight = (reach - (dx * dx + dy * dy).sqrt()).clamp(0.0, 1.0);
            sum += weight * f64::from(plane.at(x, y));
            weights += weight;
        }
    }
    (weights > 0.0).then(|| sum / weights)
}

/// Deviations of the means from a surface of degree 2 over the image. `None` when there are too few.
fn deviations(means: &[(Label, [f64; 2], f64)], size: f64) -> Option<Vec<f64>> {
    if means.len() < 2 * TERMS {
        return None;
    }
    let row = |at: &[f64; 2]| {
        let [x, y] = at.map(|v| 2.0 * v / size - 1.0);
        SVector::<f64, TERMS>::from([1.0, x, y, x * x, x * y, y * y])
    };
    let (mut normal, mut right) = (SMatrix::<f64, TERMS, TERMS>::zeros(), SVector::<f64, TERMS>::zeros());
    for (_, at, mean) in means {
        let row = row(at);
        normal += row * row.transpose();
        right += row * *mean;
    }
    normal += SMatrix::identity() * (1e-9 * normal.trace());
    let surface = normal.cholesky()?.solve(&right);
    Some(means.iter().map(|(_, at, mean)| mean - row(at).dot(&surface)).collect())
}
