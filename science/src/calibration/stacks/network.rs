//! One least-squares fit of all transforms to the windows of all pairs of slices of all views.
//!
//! Unknown are the parameters of the transforms reference slice -> slice, under one transform model, and one number for
//! the whole stack: the *parallax*, by which the growth from slice to slice depends on how far a window is from the
//! slice in focus (`perspective`). A window that lies at `q1` in the first slice of a pair and at `q2` in the second
//! gives `q2 = T2(T1^-1(q1))`, with its own covariance. Windows that do not agree lose their weight.

use std::collections::BTreeMap;

use nalgebra::Vector2;

use super::matched::{Pair, WindowMatch};
use super::model::NetworkModel;
use super::normal::{Equation, Normal, Unknowns};
use super::transform::{matrix, projected, through};
use crate::calibration::statistics::median;
use crate::calibration::transform_models::{Frame, Parameters, jacobian, map_point};
use crate::types::Homography;

/// Rounds of the fit.
const ROUNDS: usize = 14;
/// Rounds in which no window loses its weight completely.
const CAUTIOUS: usize = 4;
/// Residual at which a window has half its weight, in standard deviations.
const HALF_WEIGHT: f64 = 2.5;
/// Smallest scatter that is accepted, relative to the covariances of the windows.
const MIN_SCATTER: f64 = 0.05;
/// Most groups of windows of which each is left out in turn.
pub(super) const GROUPS: usize = 16;

/// Blurred outlines shift all windows of a stack alike: a bend of the growth that its windows show is wrong by up to so
/// many times what their scatter lets expect.
const OUTLINES: f64 = 12.0;

/// Standard deviations that leaving out groups finds are multiplied by this: all windows of a stack share errors, such
/// as blur that spreads over outlines. `cargo bench --bench calibration_stacks` compares with the truth.
pub(super) const SHARED_ERRORS: f64 = 4.0;
/// Least standard deviation of an image corner, px: of what no window shows, such as a sensor that is not square to the
/// rail.
pub(super) const LEAST_SIGMA: f64 = 0.1;

/// The windows and what is known of the stack.
pub(super) struct Network<'a> {
    /// All pairs.
    pub pairs: &'a [Pair],
    /// Per pair and window its group, below [`GROUPS`].
    pub groups: &'a [Vec<u8>],
    /// Per pair and window how far, on the rail, its focus is beyond the middle of the two slices, or beyond the
    /// reference slice (`perspective::weigh`).
    pub beyond: &'a [Vec<f64>],
    /// Rail position of each slice relative to the reference slice.
    pub offsets: &'a [f64],
    /// Index of the reference slice.
    pub reference: usize,
    /// Per slice the transform reference slice -> slice to begin with; the unknowns are added to it.
    pub start: &'a [Parameters],
    /// Growth of these per unit of the rail.
    pub start_growth: f64,
    /// Expected bend of the growth and its standard deviation, in squares of the growth (`perspective::bend`).
    pub bend: [f64; 2],
    /// The point about which the image grows, units.
    pub centre: [f64; 2],
    /// Units.
    pub frame: &'a Frame,
    /// Size of the slices, px.
    pub size: [u32; 2],
}

/// The fit of one model.
#[derive(Debug, Clone)]
pub(super) struct NetworkFit {
    /// Per slice the transform reference slice -> slice.
    pub parameters: Vec<Parameters>,
    /// Per slice the standard deviation of the worst image corner, px.
    pub corner_sigma: Vec<f64>,
    /// Growth per unit of the rail and unit of depth, and its standard deviation; `None` where it was not asked for.
    pub parallax: Option<[f64; 2]>,
    /// Residuals over what the covariances of the windows let expect.
    pub scatter: f64,
    /// Largest mean residual of two slices over all views, px.
    pub misfit: f64,
    /// Per slice the number of windows that agree, and their RMS residual, px.
    pub agreeing: Vec<(u32, f64)>,
    /// Number of free parameters.
    pub free: usize,
}

impl NetworkFit {
    /// The standard deviation of the worst image corner of a slice as it is stated, px.
    pub(super) fn stated_sigma(&self, slice: usize) -> f64 {
        (SHARED_ERRORS * self.corner_sigma[slice]).hypot(LEAST_SIGMA)
    }
}

impl Network<'_> {
    /// Fits `model`, with the parallax if asked for. `None` when the windows do not determine it.
    pub(super) fn fit(&self, model: NetworkModel, with_parallax: bool) -> Option<NetworkFit> {
        let layout = Layout::of(model, self, with_parallax);
        let mut found = layout.zeros();
        let mut scatter = f64::INFINITY;
        for round in 0..ROUNDS {
            let mut normal = layout.normal();
            let mut distances = Vec::new();
            self.for_each(&layout, &found, |_, window, equation| {
                let distance = distance(window, &equation.residual);
                distances.push(distance);
                normal.add(&equation, window, weight(distance, scatter, round < CAUTIOUS));
            });
            self.expect(&layout, &found, scatter, &mut normal);
            found.add(&normal.solve()?);
            if !found.of_slices.iter().chain(&found.shared).all(|v| v.is_finite()) {
                return None;
            }
            // the median length of a two-dimensional normal deviate is 1.18 sigma
            scatter = (median(&mut distances) / 1.18).max(MIN_SCATTER);
        }
        self.finished(&layout, &found, scatter)
    }

    /// The result, with what leaving out each group of windows in turn changes.
    fn finished(&self, layout: &Layout, found: &Unknowns, scatter: f64) -> Option<NetworkFit> {
        let mut groups = vec![layout.normal(); GROUPS];
        // of the same two slices in all views: what outlines do in one view is undone in another
        let mut sums: BTreeMap<[usize; 2], (Vector2<f64>, f64)> = BTreeMap::new();
        let mut agreeing = vec![(0_u32, 0.0); self.offsets.len()];
        let half = self.frame.half;
        self.for_each(layout, found, |[pair, index], window, equation| {
            let distance = distance(window, &equation.residual);
            let weight = weight(distance, scatter, false);
            groups[usize::from(self.groups[pair][index])].add(&equation, window, weight);
            let precision = weight * window.information.trace() / 2.0;
            let sum = sums.entry(self.pairs[pair].slices).or_default();
            sum.0 += precision * equation.residual * half;
            sum.1 += precision;
            if distance < 3.0 * scatter {
                for slice in self.pairs[pair].slices {
                    agreeing[slice].0 += 1;
                    agreeing[slice].1 += equation.residual.norm_squared() * half * half;
                }
            }
        });
        let mut expected = layout.normal();
        self.expect(layout, found, scatter, &mut expected);
        groups.push(expected);
        let whole = groups.iter().skip(1).fold(groups[0].clone(), |sum, group| sum.plus(group, 1.0));
        let filled: Vec<&Normal> = groups.iter().filter(|group| group.weight > 0.0).collect();
        let parameters = layout.all_parameters(self, found);
        let (mut corners, mut parallax_square, mut used) = (vec![[0.0; 4]; parameters.len()], 0.0, 0.0);
        for group in &filled {
            // without this group the unknowns are undetermined, so it tells nothing about the others
            let Some(step) = whole.plus(group, -1.0).solve() else { continue };
            used += 1.0;
            parallax_square += step.shared.last().copied().unwrap_or(0.0).powi(2);
            for (slice, squares) in corners.iter_mut().enumerate() {
                let moved = layout.parameters(self, &step, slice);
                for (square, corner) in squares.iter_mut().zip(Homography::corners(self.size[0], self.size[1])) {
                    let rows = jacobian(&parameters[slice], self.frame.unit(corner));
                    let by = rows.map(|row| row.iter().zip(&moved).map(|(a, b)| a * b).sum::<f64>());
                    *square += (half * by[0]).powi(2) + (half * by[1]).powi(2);
                }
            }
        }
        if used < 3.0 {
            return None;
        }
        // as many as are missing could matter as much as those that were left out
        let factor = (used - 1.0) / used * (filled.len() as f64 / used) * caution(used);
        let sigma = |squares: &[f64; 4]| (factor * squares.iter().fold(0.0, |a: f64, b| a.max(*b))).sqrt();
        let misfit = sums.values().map(|(sum, of)| sum.norm() / f64::max(*of, 1e-300)).fold(0.0, f64::max);
        Some(NetworkFit {
            corner_sigma: corners.iter().map(sigma).collect(),
            parallax: layout
                .with_parallax
                .then(|| [found.shared.last().copied().unwrap_or(0.0), (factor * parallax_square).sqrt()]),
            scatter,
            misfit,
            agreeing: agreeing.iter().map(|&(n, square)| (n, (square / f64::from(n.max(1))).sqrt())).collect(),
            free: layout.size + layout.model.shared(),
            parameters,
        })
    }

    /// Adds the bend that the growth is expected to have. As it is left out in turn too, the stated uncertainty tells
    /// how much of the result rests on it.
    fn expect(&self, layout: &Layout, found: &Unknowns, scatter: f64, normal: &mut Normal) {
        let Some(bend) = layout.model.bend().filter(|_| scatter.is_finite()) else { return };
        let square = (self.start_growth + found.shared[0]).powi(2).max(1e-12);
        let (expected, sigma) = (self.bend[0] * square, self.bend[1] * square);
        normal.expect(bend, expected - found.shared[bend], (OUTLINES * scatter / sigma).powi(2));
    }

    /// Calls `with` for every window: its pair and index, itself, and its equation.
    fn for_each(&self, layout: &Layout, found: &Unknowns, mut with: impl FnMut([usize; 2], &WindowMatch, Equation)) {
        let parameters = layout.all_parameters(self, found);
        let parallax = if layout.with_parallax { found.shared.last().copied().unwrap_or(0.0) } else { 0.0 };
        for (number, pair) in self.pairs.iter().enumerate() {
            let [a, b] = pair.slices;
            let (from, to) = (&parameters[a], &parameters[b]);
            let Some(back) = matrix(from).try_inverse() else { continue };
            for (index, window) in pair.windows.iter().enumerate() {
                let base = projected(&back, window.first);
                let sent = map_point(to, base);
                let depth = self.beyond[number][index] * (self.offsets[b] - self.offsets[a]);
                let away = Vector2::new(base[0] - self.centre[0], base[1] - self.centre[1]) * depth;
                let residual = Vector2::new(window.second[0] - sent[0], window.second[1] - sent[1]) - parallax * away;
                let mut equation = Equation {
                    residual,
                    columns: Vec::with_capacity(2 * layout.model.own()),
                    shared: vec![Vector2::zeros(); layout.model.shared()],
                };
                layout.differentiate(self, b, &jacobian(to, base), &mut equation);
                layout.differentiate(self, a, &through(to, from, base).map(|row| row.map(|v| -v)), &mut equation);
                if layout.with_parallax {
                    equation.shared.push(away);
                }
                with([number, index], window, equation);
            }
        }
    }
}

/// Length of a residual in standard deviations.
fn distance(window: &WindowMatch, residual: &Vector2<f64>) -> f64 {
    (residual.transpose() * window.information * residual)[(0, 0)].max(0.0).sqrt()
}

fn weight(distance: f64, scatter: f64, is_cautious: bool) -> f64 {
    let far = distance / (HALF_WEIGHT * scatter);
    if is_cautious { 1.0 / far.max(1.0) } else { (1.0 + far * far).powi(-2) }
}

/// Few groups determine their scatter poorly: it is widened as the tails of a t distribution require.
fn caution(groups: f64) -> f64 {
    (1.0 + 2.5 / (groups - 1.0).max(2.0)).powi(2)
}

/// Which unknowns belong to which slice.
struct Layout {
    model: NetworkModel,
    with_parallax: bool,
    /// Unknowns of slices.
    size: usize,
    band: usize,
}

impl Layout {
    fn of(model: NetworkModel, network: &Network<'_>, with_parallax: bool) -> Self {
        let farthest = network.pairs.iter().map(|p| p.slices[1] - p.slices[0]).max().unwrap_or(1);
        let size = network.offsets.len().saturating_sub(1) * model.own();
        Self { model, with_parallax, size, band: ((farthest + 1) * model.own()).saturating_sub(1) }
    }

    fn zeros(&self) -> Unknowns {
        let shared = self.model.shared() + usize::from(self.with_parallax);
        Unknowns { of_slices: vec![0.0; self.size], shared: vec![0.0; shared] }
    }

    fn normal(&self) -> Normal {
        Normal::zeros(self.size, self.band, self.zeros().shared.len())
    }

    /// First unknown of a slice; `None` for the reference slice, which has none.
    fn first(&self, network: &Network<'_>, slice: usize) -> Option<usize> {
        let place = slice - usize::from(slice > network.reference);
        (slice != network.reference).then_some(place * self.model.own())
    }

    /// Adds the derivatives by all unknowns, from those by the eight parameters of a slice.
    fn differentiate(&self, network: &Network<'_>, slice: usize, by: &[Parameters; 2], equation: &mut Equation) {
        let Some(first) = self.first(network, slice) else { return };
        let dot = |a: &Parameters, b: &Parameters| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        for (k, row) in self.model.rows(network.offsets[slice]).iter().enumerate() {
            let derivative = Vector2::new(dot(&by[0], row), dot(&by[1], row));
            match k.checked_sub(self.model.shared()) {
                None => equation.shared[k] += derivative,
                Some(own) => equation.columns.push((first + own, derivative)),
            }
        }
    }

    /// What the unknowns add to the eight parameters of a slice.
    fn parameters(&self, network: &Network<'_>, found: &Unknowns, slice: usize) -> Parameters {
        let Some(first) = self.first(network, slice) else { return [0.0; 8] };
        let own = &found.of_slices[first..first + self.model.own()];
        let values = found.shared[..self.model.shared()].iter().chain(own);
        let mut sum = [0.0; 8];
        for (row, value) in self.model.rows(network.offsets[slice]).iter().zip(values) {
            sum.iter_mut().zip(row).for_each(|(sum, v)| *sum += v * value);
        }
        sum
    }

    fn all_parameters(&self, network: &Network<'_>, found: &Unknowns) -> Vec<Parameters> {
        let of_slice = |(slice, start): (usize, &Parameters)| {
            let by = self.parameters(network, found, slice);
            std::array::from_fn(|k| start[k] + by[k])
        };
        network.start.iter().enumerate().map(of_slice).collect()
    }
}
