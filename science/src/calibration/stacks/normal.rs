//! The normal equations of the network.

use nalgebra::{DMatrix, DVector, Vector2};

use super::banded::Banded;
use super::matched::WindowMatch;

/// Normal equations. Unknowns of slices are coupled with neighbours only; those of the whole stack, and the parallax,
/// with all.
#[derive(Clone)]
pub(super) struct Normal {
    /// Of the unknowns of slices.
    matrix: Banded,
    right: Vec<f64>,
    /// Per unknown of the whole stack its products with the unknowns of slices.
    border: Vec<Vec<f64>>,
    /// Their products with each other.
    shared: DMatrix<f64>,
    shared_right: DVector<f64>,
    /// Weight of all windows, and 1 for each expected value.
    pub weight: f64,
}

/// Residual and derivatives of one window.
pub(super) struct Equation {
    pub residual: Vector2<f64>,
    /// Unknowns of slices and the derivatives by them.
    pub columns: Vec<(usize, Vector2<f64>)>,
    /// Derivatives by the unknowns of the whole stack; the last is the parallax, if it is asked for.
    pub shared: Vec<Vector2<f64>>,
}

/// Values of all unknowns.
#[derive(Clone)]
pub(super) struct Unknowns {
    pub of_slices: Vec<f64>,
    pub shared: Vec<f64>,
}

impl Unknowns {
    /// Adds a step.
    pub(super) fn add(&mut self, step: &Self) {
        self.of_slices.iter_mut().zip(&step.of_slices).for_each(|(v, step)| *v += step);
        self.shared.iter_mut().zip(&step.shared).for_each(|(v, step)| *v += step);
    }
}

impl Normal {
    /// Of `size` unknowns of slices, coupled over `band` neighbours, and of `shared` unknowns of the whole stack.
    pub(super) fn zeros(size: usize, band: usize, shared: usize) -> Self {
        Self {
            matrix: Banded::zeros(size, band),
            right: vec![0.0; size],
            border: vec![vec![0.0; size]; shared],
            shared: DMatrix::zeros(shared, shared),
            shared_right: DVector::zeros(shared),
            weight: 0.0,
        }
    }

    /// Adds a window.
    pub(super) fn add(&mut self, equation: &Equation, window: &WindowMatch, weight: f64) {
        let information = window.information * weight;
        self.weight += weight;
        for (i, by_i) in &equation.columns {
            let weighted = information * by_i;
            self.right[*i] += weighted.dot(&equation.residual);
            for (j, by_j) in &equation.columns {
                self.matrix.add(*i, *j, weighted.dot(by_j));
            }
        }
        for (k, by_k) in equation.shared.iter().enumerate() {
            let weighted = information * by_k;
            self.shared_right[k] += weighted.dot(&equation.residual);
            for (i, by_i) in &equation.columns {
                self.border[k][*i] += weighted.dot(by_i);
            }
            for (j, by_j) in equation.shared.iter().enumerate() {
                self.shared[(k, j)] += weighted.dot(by_j);
            }
        }
    }

    /// Adds that unknown `k` of the whole stack is expected to differ by `off` from its value.
    pub(super) fn expect(&mut self, k: usize, off: f64, information: f64) {
        self.shared[(k, k)] += information;
        self.shared_right[k] += information * off;
        self.weight += 1.0;
    }

    /// The sum with `factor` times others.
    pub(super) fn plus(&self, other: &Self, factor: f64) -> Self {
        let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + factor * b).collect::<Vec<f64>>();
        Self {
            matrix: self.matrix.plus(&other.matrix, factor),
            right: sum(&self.right, &other.right),
            border: self.border.iter().zip(&other.border).map(|(a, b)| sum(a, b)).collect(),
            shared: &self.shared + factor * &other.shared,
            shared_right: &self.shared_right + factor * &other.shared_right,
            weight: self.weight + factor * other.weight,
        }
    }

    /// Steps of the unknowns; `None` when they are not determined.
    pub(super) fn solve(&self) -> Option<Unknowns> {
        let factor = self.matrix.clone().factor()?;
        let plain = factor.solve(&self.right);
        let by_border: Vec<Vec<f64>> = self.border.iter().map(|column| factor.solve(column)).collect();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let count = self.border.len();
        let rest = DMatrix::from_fn(count, count, |i, j| self.shared[(i, j)] - dot(&self.border[i], &by_border[j]));
        let right = DVector::from_fn(count, |i, _| self.shared_right[i] - dot(&self.border[i], &plain));
        // equal diagonals: the unknowns have different units
        let scale = DVector::from_fn(count, |i, _| rest[(i, i)].max(0.0).sqrt());
        let determined = scale.iter().zip(self.shared.diagonal().iter()).all(|(s, d)| s * s > 1e-9 * d);
        if !determined {
            return None;
        }
        let even = DMatrix::from_fn(count, count, |i, j| rest[(i, j)] / (scale[i] * scale[j]));
        let solved = even.cholesky()?.solve(&right.component_div(&scale));
        let shared: Vec<f64> = solved.component_div(&scale).iter().copied().collect();
        let mut of_slices = plain;
        for (column, value) in by_border.iter().zip(&shared) {
            of_slices.iter_mut().zip(column).for_each(|(v, by)| *v -= value * by);
        }
        Some(Unknowns { of_slices, shared })
    }
}
