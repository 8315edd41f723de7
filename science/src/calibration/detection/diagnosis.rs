//! Diagnosis: why a slice shows no grid.

use crate::calibration::statistics::{quantile, thinned};
use crate::calibration::working_image::WorkingImage;
use crate::imaging::{Plane, Raster};

/// A likely reason why no grid was found in a slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Diagnosis {
    /// A large part is at full scale.
    Clipped,
    /// Almost no light.
    Black,
    /// Light, but almost no differences.
    NoContrast,
    /// Differences, but no edges.
    Blurred,
    /// A fine pattern whose period is a few px.
    TooFine,
    /// Stripes of light.
    Striped,
    /// Edges, but no grid of dots.
    Other,
}

impl Diagnosis {
    /// The reason, with what to do; a phrase whose subject is the slice.
    pub(crate) fn phrase(self) -> &'static str {
        match self {
            Self::Clipped => "is clipped in a large part: reduce the exposure",
            Self::Black => "is almost black: increase the exposure, and check the lamp and the shutter",
            Self::NoContrast => "has almost no contrast: check that the target is in view, lit and in focus",
            Self::Blurred => "is blurred everywhere: focus on the target in at least one slice",
            Self::TooFine => {
                "shows a pattern whose period is less than 5 px: use a target with larger, more widely spaced dots, or a \
                 higher resolution"
            }
            Self::Striped => {
                "is crossed by stripes of light: use a lamp on direct current, a longer exposure, or the mechanical shutter"
            }
            Self::Other => "shows no grid that can be followed: use a flat, well printed target that fills the image",
        }
    }
}

/// The likely reason why no grid was found in `slice`.
pub(crate) fn diagnose(slice: &Raster) -> Diagnosis {
    let image = WorkingImage::of(slice, slice.width.max(slice.height).div_ceil(1600).max(1));
    let plane = &image.plane;
    let mut levels = thinned(plane);
    let (dark, bright) = (quantile(&mut levels, 0.02), quantile(&mut levels, 0.98));
    match () {
        () if image.clipped > 0.3 => Diagnosis::Clipped,
        () if bright < 20.0 => Diagnosis::Black,
        () if bright - dark < 0.12 * bright => Diagnosis::NoContrast,
        () if gradient(plane) < 0.02 * (bright - dark) => Diagnosis::Blurred,
        () if image.bin == 1 && is_too_fine(plane) => Diagnosis::TooFine,
        () if is_striped(plane) => Diagnosis::Striped,
        () => Diagnosis::Other,
    }
}

/// Longest period of a pattern that is too fine, px.
const FINE: usize = 4;
/// Correlation of the image with itself, one period away, from which it has a pattern.
const PATTERN: f64 = 0.25;

/// True when rows or columns repeat after at most [`FINE`] px.
fn is_too_fine(plane: &Plane<f32>) -> bool {
    let repeats = |line: &dyn Fn(usize, usize) -> f64, lines: usize, length: usize| {
        let mut sums = [0.0; FINE + 1];
        for k in (0..lines).step_by((lines / 200).max(1)) {
            // second differences: what changes slowly does not count
            let bends: Vec<f64> = (2..length).map(|i| line(k, i) - 2.0 * line(k, i - 1) + line(k, i - 2)).collect();
            for (lag, sum) in sums.iter_mut().enumerate() {
                *sum += bends.iter().zip(&bends[lag.min(bends.len())..]).map(|(a, b)| a * b).sum::<f64>();
            }
        }
        // a blurred edge is alike over a few px, too, but less with each
        (2..=FINE).any(|lag| sums[lag] > PATTERN * sums[0] && sums[lag] > sums[lag - 1])
    };
    let at = |x: usize, y: usize| f64::from(plane.at(x, y));
    repeats(&|y, x| at(x, y), plane.height, plane.width) || repeats(&|x, y| at(x, y), plane.width, plane.height)
}

/// Ratio of the changes of white from row to row (or column to column) to what is left across them that means stripes.
const STRIPED: f64 = 3.0;
/// Least amplitude of stripes, as a share of the light.
const LEAST_STRIPES: f64 = 0.02;

/// True when the white changes from row to row, and hardly across the rows; or from column to column.
fn is_striped(plane: &Plane<f32>) -> bool {
    let whites = |line: &dyn Fn(usize, usize) -> f64, lines: usize, length: usize| -> Vec<f64> {
        let white = |k: usize| quantile(&mut (0..length).map(|i| line(k, i)).collect::<Vec<f64>>(), 0.8);
        (0..lines).map(white).collect()
    };
    let ripple = |whites: &[f64]| {
        let reach = (whites.len() / 8).max(1);
        let mean = |window: &[f64]| window.iter().sum::<f64>() / window.len() as f64;
        let off = whites.windows(2 * reach + 1).map(|window| window[reach] / mean(window).max(1e-3) - 1.0);
        off.map(|off| off * off).sum::<f64>().sqrt() / (whites.len() as f64).sqrt()
    };
    let (width, height) = (plane.width, plane.height);
    let at = |x: usize, y: usize| f64::from(plane.at(x, y));
    let (rows, columns) = (whites(&|y, x| at(x, y), height, width), whites(&|x, y| at(x, y), width, height));
    // what is left in the other direction without them: between the rows of dots, a column shows one part of the
    // stripes
    let across_rows = whites(&|x, y| at(x, y) / rows[y].max(1.0), width, height);
    let across_columns = whites(&|y, x| at(x, y) / columns[x].max(1.0), height, width);
    let is_striped = |lines: &[f64], across: &[f64]| {
        let stripes = ripple(lines);
        stripes > LEAST_STRIPES && stripes > STRIPED * ripple(across)
    };
    is_striped(&rows, &across_rows) || is_striped(&columns, &across_columns)
}

/// 98th percentile of the differences between neighbouring samples.
fn gradient(plane: &Plane<f32>) -> f64 {
    let stride = (plane.height / 200).max(1);
    let mut steps = Vec::new();
    for y in (0..plane.height).step_by(stride) {
        steps.extend(plane.row(y).windows(2).step_by(3).map(|w| f64::from((w[1] - w[0]).abs())));
    }
    quantile(&mut steps, 0.98)
}
