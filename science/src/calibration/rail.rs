//! The rail law: how rail positions bind the transforms of the slices together.
//!
//! With the sensor moved along the rail, a point x of the reference slice appears in slice i at `x + dz_i (a x + e)`:
//! every parameter of the transform from the reference slice **to** slice i is linear in the position. Real rails add
//! some scatter. So each parameter is modelled as `p_i = b0 + b1 z_i + N(0, s^2)`, with b0, b1 and s estimated from the
//! measured slices (empirical Bayes). A slice's estimate combines its own dots and this prediction, weighted by their
//! covariances: sharp slices keep what was measured, slices too blurred to be measured follow the line, and there is no
//! switch in between.

use nalgebra::{DMatrix, DVector};

use super::statistics::{median, median_of, range};

/// The estimate of one slice from its own dots.
#[derive(Debug, Clone)]
pub(super) struct OwnEstimate {
    /// Free parameters of its transform.
    pub free: DVector<f64>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
}

/// Line and scatter of one parameter over the rail.
#[derive(Debug, Clone, Copy, Default)]
struct Line {
    intercept: f64,
    slope: f64,
    /// Step added from slice `Law::jump` on.
    step: f64,
    /// Variance of the slices about the line, without their measurement errors.
    scatter: f64,
}

/// The rail law of a stack.
#[derive(Debug, Clone)]
pub(super) struct Law {
    lines: Vec<Line>,
    positions: Vec<f64>,
    /// The first slice after a jump of the image, if there is one.
    pub jump: Option<usize>,
}

/// Least number of measured slices for a rail law.
const MIN_SLICES: usize = 4;
/// Smallest scatter that is assumed for any rail, in half diagonals of the image.
const MIN_SCATTER: f64 = 2e-6;

impl Law {
    /// Fits the law to the measured slices (`None`: not measured) at the rail `positions`. `None` with fewer than four
    /// of them.
    pub(super) fn fit(own: &[Option<OwnEstimate>], positions: &[f64], jump: Option<usize>) -> Option<Self> {
        let known: Vec<usize> = (0..own.len()).filter(|&i| own[i].is_some()).collect();
        if known.len() < MIN_SLICES + usize::from(jump.is_some()) {
            return None;
        }
        let size = own[known[0]].as_ref()?.free.len();
        let lines = (0..size).map(|n| line(own, &known, positions, n, jump)).collect::<Option<_>>()?;
        Some(Self { lines, positions: positions.to_vec(), jump })
    }

    /// Parameters that the law predicts for slice `index`.
    pub(super) fn predict(&self, index: usize) -> DVector<f64> {
        let at = self.positions[index];
        let behind = f64::from(u8::from(self.jump.is_some_and(|k| index >= k)));
        DVector::from_iterator(
            self.lines.len(),
            self.lines.iter().map(|l| l.intercept + l.slope * at + l.step * behind),
        )
    }

    /// Slopes of all parameters over the position.
    pub(super) fn slopes(&self) -> DVector<f64> {
        DVector::from_iterator(self.lines.len(), self.lines.iter().map(|l| l.slope))
    }
}

/// What the other slices lead to expect of slice `index`: the prediction of their law. `None` without a law.
pub(super) fn predicted(
    own: &[Option<OwnEstimate>],
    positions: &[f64],
    jump: Option<usize>,
    index: usize,
) -> Option<OwnEstimate> {
    // the slice must not count twice
    let mut others = own.to_vec();
    others[index] = None;
    let law = Law::fit(&others, positions, jump)?;
    let free = law.predict(index);
    let known: Vec<usize> = (0..others.len()).filter(|&i| others[i].is_some()).collect();
    let variance = |n: usize| law.lines[n].scatter + leverage(&others, &known, positions, n, index, &law);
    let spread = DVector::from_iterator(free.len(), (0..free.len()).map(variance));
    Some(OwnEstimate { free, covariance: DMatrix::from_diagonal(&spread) })
}

/// Combines the slice's own estimate with what the other slices lead to expect; returns it with its covariance. `None`
/// when there is neither.
pub(super) fn combine(
    mine: Option<&OwnEstimate>,
    expected: Option<&OwnEstimate>,
) -> Option<(OwnEstimate, EstimateSource)> {
    let (mine, expected) = match (mine, expected) {
        (Some(mine), Some(expected)) => (mine, expected),
        (Some(mine), None) => return Some((mine.clone(), EstimateSource::Dots)),
        (None, expected) => return expected.map(|expected| (expected.clone(), EstimateSource::Law)),
    };
    let from_law = DMatrix::from_diagonal(&expected.covariance.diagonal().map(|v| 1.0 / v.max(1e-30)));
    let from_dots = mine.covariance.clone().try_inverse()?;
    // where the two contradict each other more than both covariances allow, neither is as certain as it claims
    let apart = &mine.free - &expected.free;
    let together = (&mine.covariance + &expected.covariance).try_inverse()?;
    let contradiction = ((apart.transpose() * together * &apart)[(0, 0)] / apart.len() as f64).max(1.0);
    let covariance = (&from_dots + &from_law).try_inverse()?;
    let free = &covariance * (from_dots * &mine.free + from_law * &expected.free);
    let covariance = covariance * contradiction;
    Some((OwnEstimate { free, covariance }, EstimateSource::Dots))
}

/// What an estimate is based on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum EstimateSource {
    /// The slice's own dots (and the law).
    Dots,
    /// The rail law alone.
    Law,
}

/// Weighted least-squares line (with a step at `jump`) through parameter `n` of the slices `known`.
fn line(
    own: &[Option<OwnEstimate>],
    known: &[usize],
    positions: &[f64],
    n: usize,
    jump: Option<usize>,
) -> Option<Line> {
    let points: Vec<[f64; 4]> = known
        .iter()
        .filter_map(|&i| own[i].as_ref().map(|o| (i, o)))
        .map(|(i, o)| {
            let behind = f64::from(u8::from(jump.is_some_and(|k| i >= k)));
            [positions[i], behind, o.free[n], o.covariance[(n, n)].max(0.0)]
        })
        .collect();
    let unknowns = 2 + usize::from(jump.is_some());
    let (mut scatter, mut out) = (MIN_SCATTER * MIN_SCATTER, Line::default());
    for _ in 0..6 {
        let (mut normal, mut right) = (DMatrix::zeros(unknowns, unknowns), DVector::zeros(unknowns));
        for [z, behind, value, variance] in &points {
            let row = DVector::from_column_slice(&[1.0, *z, *behind][..unknowns]);
            let weight = 1.0 / (variance + scatter);
            normal += weight * &row * row.transpose();
            right += weight * *value * row;
        }
        let solved = normal.try_inverse()? * right;
        out =
            Line { intercept: solved[0], slope: solved[1], step: if unknowns > 2 { solved[2] } else { 0.0 }, scatter };
        // excess variance beyond the slices' own errors; well measured slices weigh most
        let (mut excess, mut weights) = (0.0, 0.0);
        for [z, behind, value, variance] in &points {
            let weight = 1.0 / (variance + scatter);
            let miss = value - out.intercept - out.slope * z - out.step * behind;
            excess += weight * (miss * miss - variance);
            weights += weight;
        }
        let count = points.len() as f64;
        let freedom = count / (count - unknowns as f64);
        // few slices determine their scatter poorly: widen it as the tails of a t distribution require
        let caution = (1.0 + 2.5 / (count - unknowns as f64)).powi(2);
        scatter = (excess / weights * freedom * caution).max(MIN_SCATTER * MIN_SCATTER);
    }
    out.scatter = scatter;
    out.intercept.is_finite().then_some(out)
}

/// Variance of the prediction at slice `index` that comes from the errors of the line itself.
fn leverage(own: &[Option<OwnEstimate>], known: &[usize], positions: &[f64], n: usize, index: usize, law: &Law) -> f64 {
    let (mut sum, mut first, mut second) = (0.0, 0.0, 0.0);
    for &i in known {
        let Some(o) = &own[i] else { continue };
        let weight = 1.0 / (o.covariance[(n, n)].max(0.0) + law.lines[n].scatter);
        sum += weight;
        first += weight * positions[i];
        second += weight * positions[i] * positions[i];
    }
    let middle = first / sum;
    let spread = (second - sum * middle * middle).max(1e-30);
    1.0 / sum + (positions[index] - middle).powi(2) / spread
}

/// Rail positions of the measured slices derived from their scales, with standard deviations, in the unit of
/// `positions` and relative to slice `reference`. `scale` is the scale parameter (0 at the reference) with its standard
/// deviation. `None` when the scale hardly changes over the stack.
pub(super) fn positions_by_scale(
    scale: &[Option<(f64, f64)>],
    positions: &[f64],
    reference: usize,
) -> Option<Vec<Option<(f64, f64)>>> {
    let known: Vec<usize> = (0..scale.len()).filter(|&i| scale[i].is_some()).collect();
    let mut slopes = Vec::new();
    for (k, &i) in known.iter().enumerate() {
        for &j in &known[k + 1..] {
            let (Some(a), Some(b)) = (scale[i], scale[j]) else { continue };
            slopes.push((b.0 - a.0) / (positions[j] - positions[i]));
        }
    }
    let growth = median(&mut slopes);
    let (low, high) = range(positions.iter().copied());
    let sigma = median_of(scale.iter().flatten().map(|s| s.1)).max(1e-7);
    let sure = known.len() >= MIN_SLICES && (growth * (high - low)).abs() > 20.0 * sigma;
    sure.then(|| {
        let at = |s: (f64, f64)| (positions[reference] + s.0 / growth, (s.1 / growth).abs());
        scale.iter().map(|s| s.map(at)).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::super::testkit::Noise;
    use super::*;

    /// One parameter per slice: a line, a scatter, and errors that grow towards the ends.
    fn stack(
        count: usize,
        scatter: f64,
        error: impl Fn(usize) -> f64,
        seed: u64,
    ) -> (Vec<Option<OwnEstimate>>, Vec<f64>, Vec<f64>) {
        let mut noise = Noise(seed);
        let positions: Vec<f64> = (0..count).map(|i| i as f64).collect();
        let truth: Vec<f64> = (0..count).map(|i| 0.01 * i as f64 - 0.05 + scatter * noise.normal()).collect();
        let own = truth
            .iter()
            .enumerate()
            .map(|(i, t)| {
                let sigma = error(i);
                Some(OwnEstimate {
                    free: DVector::from_element(1, t + sigma * noise.normal()),
                    covariance: DMatrix::from_element(1, 1, sigma * sigma),
                })
            })
            .collect();
        (own, positions, truth)
    }

    fn combined(own: &[Option<OwnEstimate>], positions: &[f64], index: usize) -> Option<(OwnEstimate, EstimateSource)> {
        combine(own[index].as_ref(), predicted(own, positions, None, index).as_ref())
    }

    #[test]
    fn an_unmeasured_slice_is_predicted_with_a_realistic_sigma() {
        let (mut inside, mut trials) = (0, 0);
        for seed in 0..60 {
            let (mut own, positions, truth) = stack(13, 3e-4, |_| 1e-5, seed);
            own[0] = None;
            own[7] = None;
            for index in [0, 7] {
                let (settled, source) = combined(&own, &positions, index).expect("predicted");
                assert_eq!(source, EstimateSource::Law);
                trials += 1;
                let sigma = settled.covariance[(0, 0)].sqrt();
                inside += i32::from((settled.free[0] - truth[index]).abs() < 3.0 * sigma);
                assert!(sigma < 2e-3, "{sigma}");
            }
        }
        assert!(inside >= trials - 2, "{inside} of {trials}");
    }

    #[test]
    fn a_well_measured_slice_keeps_its_estimate_and_a_poor_one_improves() {
        let (mut alone, mut together) = (0.0, 0.0);
        for seed in 0..40 {
            let (own, positions, truth) = stack(13, 1e-4, |i| if i == 0 { 2e-3 } else { 1e-5 }, seed);
            let (poor, _) = combined(&own, &positions, 0).expect("settled");
            alone += (own[0].as_ref().expect("measured").free[0] - truth[0]).powi(2);
            together += (poor.free[0] - truth[0]).powi(2);
            let (good, source) = combined(&own, &positions, 6).expect("settled");
            assert_eq!(source, EstimateSource::Dots);
            assert!((good.free[0] - truth[6]).abs() < 5e-5);
        }
        assert!(together < 0.05 * alone, "{together} against {alone}");
    }

    #[test]
    fn too_few_slices_make_no_law() {
        let (own, positions, _) = stack(3, 0.0, |_| 1e-5, 1);
        assert!(Law::fit(&own, &positions, None).is_none());
        assert_eq!(combined(&own, &positions, 1).map(|s| s.1), Some(EstimateSource::Dots));
    }

    #[test]
    fn rail_positions_follow_from_the_scales() {
        let positions: Vec<f64> = (0..9).map(f64::from).collect();
        let mut scale: Vec<Option<(f64, f64)>> = (0..9).map(|i| Some((0.005 * (f64::from(i) - 4.0), 1e-6))).collect();
        scale[6] = Some((0.005 * 2.5, 1e-6));
        let found = positions_by_scale(&scale, &positions, 4).expect("the picture scales");
        assert!(
            (found[6].expect("measured").0 - 6.5).abs() < 0.01 && (found[1].expect("measured").0 - 1.0).abs() < 0.01
        );
        let still: Vec<_> = (0..9).map(|_| Some((0.0, 1e-6))).collect();
        assert!(positions_by_scale(&still, &positions, 4).is_none());
    }
}
