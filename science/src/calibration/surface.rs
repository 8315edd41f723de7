//! A polynomial surface over the image, fitted robustly to levels.

use nalgebra::{DMatrix, DVector};

use super::statistics::{mad_sigma, median_of};

/// A polynomial surface over the image, in coordinates (u, v) from -1 to 1 along each axis.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Surface {
    degree: usize,
    coefficients: Vec<f64>,
}

/// A sample for the fit of a surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct LevelSample {
    /// Horizontal coordinate, -1..1.
    pub u: f64,
    /// Vertical coordinate, -1..1.
    pub v: f64,
    /// Level at (u, v), 0..255.
    pub value: f64,
}

/// Highest degree of a surface.
pub(super) const HIGHEST: usize = 4;

/// Exponents of u and v with a sum of at most `degree`.
fn terms(degree: usize) -> impl Iterator<Item = (i32, i32)> {
    (0..=degree as i32).flat_map(move |j| (0..=degree as i32 - j).map(move |i| (i, j)))
}

impl Surface {
    /// Robust least squares with Tukey's biweight. With `upper` (true: the ground is the upper envelope, false: the
    /// lower), values on the dots' side of the surface get less weight in the first rounds. Falls back to lower degrees
    /// when there are too few values.
    pub(super) fn fit(levels: &[LevelSample], degree: usize, upper: Option<bool>) -> Self {
        let count = terms(degree).count();
        let degree = degree.min(HIGHEST);
        let fitted = (levels.len() >= 3 * count).then(|| Self::try_fit(levels, degree, upper)).flatten();
        match fitted {
            Some(surface) => surface,
            None if degree > 0 => Self::fit(levels, degree - 1, upper),
            None => Self { degree: 0, coefficients: vec![median_of(levels.iter().map(|l| l.value))] },
        }
    }

    fn try_fit(levels: &[LevelSample], degree: usize, upper: Option<bool>) -> Option<Self> {
        let powers: Vec<(i32, i32)> = terms(degree).collect();
        let size = powers.len();
        let rows: Vec<f64> =
            levels.iter().flat_map(|l| powers.iter().map(|&(i, j)| l.u.powi(i) * l.v.powi(j))).collect();
        let mut weights = vec![1.0; levels.len()];
        let mut surface: Option<Self> = None;
        for round in 0..10 {
            let mut sums = vec![0.0; size * size];
            let mut right = DVector::zeros(size);
            for ((row, level), &weight) in rows.chunks_exact(size).zip(levels).zip(&weights) {
                if weight == 0.0 {
                    continue;
                }
                for (a, sums) in sums.chunks_exact_mut(size).enumerate() {
                    let weighted = weight * row[a];
                    right[a] += weighted * level.value;
                    sums.iter_mut().zip(&row[..=a]).for_each(|(sum, other)| *sum += weighted * other);
                }
            }
            // only the lower triangle of the sums is filled and read
            let mut normal = DMatrix::from_row_slice(size, size, &sums);
            let ridge = 1e-9 * normal.trace();
            for a in 0..size {
                normal[(a, a)] += ridge;
            }
            let solved = Self { degree, coefficients: normal.cholesky()?.solve(&right).iter().copied().collect() };
            let level_of = |row: &[f64]| row.iter().zip(&solved.coefficients).map(|(r, c)| r * c).sum::<f64>();
            let residuals: Vec<f64> =
                rows.chunks_exact(size).zip(levels).map(|(row, l)| l.value - level_of(row)).collect();
            let spread = mad_sigma(residuals.iter().copied()).max(1e-3);
            for (weight, residual) in weights.iter_mut().zip(&residuals) {
                let t = residual / (4.685 * spread);
                *weight = if t.abs() < 1.0 { (1.0 - t * t).powi(2) } else { 0.0 };
                let doubted = match upper {
                    Some(true) => *residual < -0.5 * spread,
                    Some(false) => *residual > 0.5 * spread,
                    None => false,
                };
                if doubted && round < 5 {
                    *weight *= 0.1;
                }
            }
            // changes below a hundredth of a grey level do not move a dot
            let settled = round >= 5 - 4 * usize::from(upper.is_none())
                && surface.as_ref().is_some_and(|before| before.nearly(&solved));
            surface = Some(solved);
            if settled {
                break;
            }
        }
        surface.filter(|s| s.coefficients.iter().all(|c| c.is_finite()))
    }

    /// True when the coefficients differ by less than a hundredth of a grey level.
    fn nearly(&self, other: &Self) -> bool {
        self.coefficients.iter().zip(&other.coefficients).all(|(a, b)| (a - b).abs() < 0.01)
    }

    /// The level at (u, v).
    pub(super) fn at(&self, u: f64, v: f64) -> f64 {
        terms(self.degree).zip(&self.coefficients).map(|((i, j), c)| c * u.powi(i) * v.powi(j)).sum()
    }

    /// Coefficients of the polynomial in u along row `v`.
    pub(super) fn along_row(&self, v: f64) -> Vec<f64> {
        let mut row = vec![0.0; self.degree + 1];
        for ((i, j), c) in terms(self.degree).zip(&self.coefficients) {
            row[i as usize] += c * v.powi(j);
        }
        row
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_surface_follows_a_polynomial_through_gross_errors() {
        let truth = |u: f64, v: f64| 200.0 - 20.0 * u + 5.0 * v - 30.0 * u * u + 10.0 * u * v - 12.0 * v * v;
        let levels: Vec<LevelSample> = (0..400)
            .map(|k| {
                let (u, v) = (f64::from(k % 20) / 10.0 - 0.95, f64::from(k / 20) / 10.0 - 0.95);
                let gross = if k % 7 == 0 { -90.0 } else { 0.0 };
                LevelSample { u, v, value: truth(u, v) + gross }
            })
            .collect();
        let surface = Surface::fit(&levels, 2, None);
        assert!((surface.at(0.3, -0.4) - truth(0.3, -0.4)).abs() < 0.01);
    }

    #[test]
    fn too_few_levels_give_a_flat_surface() {
        let surface = Surface::fit(&[LevelSample { u: 0.0, v: 0.0, value: 9.0 }], 4, None);
        assert_eq!(surface.at(0.7, 0.7), 9.0);
    }
}
