//! Symmetric positive definite systems in which only neighbouring unknowns are coupled.

/// The lower triangle of a symmetric band matrix: element (i, j) with `i - band <= j <= i`.
#[derive(Debug, Clone)]
pub(super) struct Banded {
    size: usize,
    band: usize,
    /// Row by row, `band + 1` elements, the last on the diagonal.
    data: Vec<f64>,
}

impl Banded {
    /// Zeros.
    pub(super) fn zeros(size: usize, band: usize) -> Self {
        let band = band.min(size.saturating_sub(1));
        Self { size, band, data: vec![0.0; size * (band + 1)] }
    }

    /// Adds to element (i, j) of the lower triangle; elements of the upper triangle are passed over.
    pub(super) fn add(&mut self, i: usize, j: usize, value: f64) {
        if j <= i {
            let at = self.place(i, j);
            self.data[at] += value;
        }
    }

    /// The sum with `factor` times a matrix of the same shape.
    pub(super) fn plus(&self, other: &Self, factor: f64) -> Self {
        let data = self.data.iter().zip(&other.data).map(|(a, b)| a + factor * b).collect();
        Self { data, ..*self }
    }

    fn place(&self, i: usize, j: usize) -> usize {
        i * (self.band + 1) + self.band + j - i
    }

    /// The Cholesky factor; `None` when the matrix is not positive definite to within rounding.
    pub(super) fn factor(mut self) -> Option<Factor> {
        for i in 0..self.size {
            let first = i.saturating_sub(self.band);
            let diagonal = self.data[self.place(i, i)];
            for j in first..=i {
                let from = first.max(j.saturating_sub(self.band));
                let (a, b) = (self.place(i, from), self.place(j, from));
                let product: f64 =
                    self.data[a..a + (j - from)].iter().zip(&self.data[b..b + (j - from)]).map(|(a, b)| a * b).sum();
                let at = self.place(i, j);
                let rest = self.data[at] - product;
                if j < i {
                    let divisor = self.data[self.place(j, j)];
                    self.data[at] = rest / divisor;
                } else if rest > 1e-12 * diagonal {
                    self.data[at] = rest.sqrt();
                } else {
                    return None;
                }
            }
        }
        Some(Factor(self))
    }
}

/// The Cholesky factor of a band matrix.
pub(super) struct Factor(Banded);

impl Factor {
    /// The solution of the system with this right side.
    pub(super) fn solve(&self, right: &[f64]) -> Vec<f64> {
        let Banded { size, band, data } = &self.0;
        let mut x = right.to_vec();
        for i in 0..*size {
            let first = i.saturating_sub(*band);
            let at = self.0.place(i, first);
            let sum: f64 = data[at..at + (i - first)].iter().zip(&x[first..i]).map(|(a, b)| a * b).sum();
            x[i] = (x[i] - sum) / data[self.0.place(i, i)];
        }
        for i in (0..*size).rev() {
            x[i] /= data[self.0.place(i, i)];
            let first = i.saturating_sub(*band);
            for j in first..i {
                x[j] -= data[self.0.place(i, j)] * x[i];
            }
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_band_system_is_solved_and_a_singular_one_refused() {
        let (size, band) = (9, 2);
        let mut matrix = Banded::zeros(size, band);
        let element = |i: usize, j: usize| if i == j { 5.0 + i as f64 } else { 1.0 / (i + j) as f64 };
        for i in 0..size {
            for j in i.saturating_sub(band)..=i {
                matrix.add(i, j, element(i, j));
            }
        }
        let truth: Vec<f64> = (0..size).map(|i| (i as f64 - 4.0) * 0.7).collect();
        let row = |i: usize| -> f64 {
            let near = (0..size).filter(|j| j.abs_diff(i) <= band);
            near.map(|j| element(i.max(j), i.min(j)) * truth[j]).sum()
        };
        let right: Vec<f64> = (0..size).map(row).collect();
        let twice = matrix.plus(&matrix, 1.0).plus(&matrix, -1.0);
        let found = twice.factor().expect("positive definite").solve(&right);
        assert!(found.iter().zip(&truth).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
        let mut singular = Banded::zeros(2, 1);
        for (i, j) in [(0, 0), (1, 0), (1, 1)] {
            singular.add(i, j, 1.0);
        }
        assert!(singular.factor().is_none());
    }
}
