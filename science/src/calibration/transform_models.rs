//! The families of maps from the reference slice to a slice, and the best member of one for the dots that both show.
//!
//! Coordinates are *units*: origin in the middle of the picture, half its diagonal long, for all slices alike. So the
//! equations are well conditioned (Hartley & Zisserman, section 4.4), and the numbers of different slices can be
//! compared, which the law of the rail does. Maps lead from the reference slice **to** the slice: the reference is
//! sharp, so the error is the slice's, and by the fixed-lens law these maps are linear in the position on the rail.

use nalgebra::{DMatrix, DVector, Matrix3};

use crate::types::Homography;
use crate::types::profile::HomographyModel;

/// A model whose members are chosen for each slice by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TransformModel {
    /// Scale, rotation, shift.
    Similarity,
    /// Six numbers.
    Affine,
    /// Eight numbers (the paper).
    Homography,
}

/// All of them, simplest first.
pub(super) const ALL: [TransformModel; 3] =
    [TransformModel::Similarity, TransformModel::Affine, TransformModel::Homography];

/// Departures from the identity, row by row: `[1 + p0, p1, p2; p3, 1 + p4, p5; p6, p7, 1]`.
pub(super) type Parameters = [f64; 8];

impl TransformModel {
    /// Free numbers per slice.
    pub(super) fn size(self) -> usize {
        match self {
            Self::Similarity => 4,
            Self::Affine => 6,
            Self::Homography => 8,
        }
    }

    /// The name in a profile.
    pub(super) fn homography_model(self) -> HomographyModel {
        match self {
            Self::Similarity => HomographyModel::Similarity,
            Self::Affine => HomographyModel::Affine,
            Self::Homography => HomographyModel::Homography,
        }
    }

    /// The departure that belongs to the free numbers.
    pub(super) fn parameters(self, free: &DVector<f64>) -> Parameters {
        match self {
            Self::Similarity => [free[0], -free[1], free[2], free[1], free[0], free[3], 0.0, 0.0],
            _ => std::array::from_fn(|k| if k < self.size() { free[k] } else { 0.0 }),
        }
    }

    /// Slopes of a departure's numbers gather into jacobian of the free numbers.
    fn gather(self, jacobian: &Parameters) -> DVector<f64> {
        match self {
            Self::Similarity => DVector::from_column_slice(&[
                jacobian[0] + jacobian[4],
                jacobian[3] - jacobian[1],
                jacobian[2],
                jacobian[5],
            ]),
            _ => DVector::from_column_slice(&jacobian[..self.size()]),
        }
    }
}

/// Units and pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    /// Middle of the picture, px.
    pub centre: [f64; 2],
    /// Half its diagonal, px.
    pub half: f64,
}

impl Frame {
    /// Of a picture of this size.
    pub(super) fn new(width: usize, height: usize) -> Self {
        let centre = [(width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0];
        Self { centre, half: centre[0].hypot(centre[1]).max(1.0) }
    }

    /// Pixels to units.
    pub(super) fn unit(&self, p: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|a| (p[a] - self.centre[a]) / self.half)
    }

    /// The homography slice px -> reference px that is the inverse of the map with this departure.
    pub(super) fn homography(&self, p: &Parameters) -> Option<Homography> {
        let map = Matrix3::new(1.0 + p[0], p[1], p[2], p[3], 1.0 + p[4], p[5], p[6], p[7], 1.0);
        let to_unit = Matrix3::new(
            1.0 / self.half,
            0.0,
            -self.centre[0] / self.half,
            0.0,
            1.0 / self.half,
            -self.centre[1] / self.half,
            0.0,
            0.0,
            1.0,
        );
        Homography::from_matrix(&(to_unit.try_inverse()? * map.try_inverse()? * to_unit))
    }
}

/// A dot in the reference slice and in a slice, units, with the standard deviation of their distance.
#[derive(Debug, Clone, Copy)]
pub(super) struct Match {
    /// In the reference slice.
    pub base: [f64; 2],
    /// In the slice.
    pub here: [f64; 2],
    /// Units.
    pub sigma: f64,
}

/// The best member of a model.
#[derive(Debug, Clone)]
pub(super) struct Fit {
    /// Its free numbers.
    pub free: DVector<f64>,
    /// Their covariance, scatter of the dots included, as if every dot erred by itself.
    pub covariance: DMatrix<f64>,
    /// Their covariance as whole blocks of neighbouring dots show it, which may err together.
    pub block_covariance: DMatrix<f64>,
}

/// Residuals beyond this many standard deviations count less and less.
const HUBER: f64 = 1.5;
/// Scatter, in units of what noise explains, below which nobody is to believe that it is so small.
const LEAST_SCATTER: f64 = 0.3;

/// Weighted least squares with Huber weights by Gauss-Newton. `None` when the dots do not fix the numbers.
pub(super) fn fit(model: TransformModel, matches: &[Match]) -> Option<Fit> {
    let size = model.size();
    if 2 * matches.len() < size + 2 {
        return None;
    }
    let mut free = DVector::zeros(size);
    let mut scatter = 1.0_f64;
    for round in 0..25 {
        let p = model.parameters(&free);
        let (mut normal, mut right) = (DMatrix::zeros(size, size), DVector::zeros(size));
        let (mut square, mut sizes) = (0.0, Vec::with_capacity(matches.len()));
        for m in matches {
            let sent = map_point(&p, m.base);
            let r = [0, 1].map(|a| (m.here[a] - sent[a]) / m.sigma);
            let far = r[0].hypot(r[1]);
            // the first rounds let everything count: the start is far from right
            let limit = HUBER * scatter;
            let weight = if round < 2 || far <= limit { 1.0 } else { limit / far };
            let [jx, jy] = jacobian(&p, m.base).map(|s| model.gather(&s) / m.sigma);
            normal += weight * (&jx * jx.transpose() + &jy * jy.transpose());
            right += weight * (r[0] * jx + r[1] * jy);
            square += weight * far * far;
            sizes.push(far);
        }
        let inverse = normal.try_inverse()?;
        let step = &inverse * right;
        free += &step;
        // the median length of a two-dimensional normal deviate is 1.18 sigma
        scatter = (super::working_image::median(&mut sizes) / 1.18).max(LEAST_SCATTER);
        if !free.iter().all(|v| v.is_finite()) {
            return None;
        }
        if (round >= 4 && step.amax() < 1e-9) || round == 24 {
            let freedom = (2.0 * matches.len() as f64 - size as f64).max(1.0);
            let covariance = &inverse * (square / freedom).max(LEAST_SCATTER * LEAST_SCATTER);
            let block_covariance = block_jackknife(model, matches, &free, HUBER * scatter);
            return Some(Fit { free, covariance, block_covariance });
        }
    }
    None
}

/// Fewest and most blocks along a side of the dots' bounding box.
const BLOCKS: (usize, usize) = (3, 5);

/// Covariance by leaving out each block of neighbouring dots in turn (delete-a-group jackknife, one step of
/// Gauss-Newton). Glare, dust and light beyond the target move dots that are near to one another alike; a covariance from
/// the scatter of single dots takes that for many independent witnesses.
fn block_jackknife(model: TransformModel, matches: &[Match], free: &DVector<f64>, limit: f64) -> DMatrix<f64> {
    let size = model.size();
    let p = model.parameters(free);
    let side = ((matches.len() as f64 / 9.0).sqrt().round() as usize).clamp(BLOCKS.0, BLOCKS.1);
    let [low, high] = [f64::min, f64::max]
        .map(|pick: fn(f64, f64) -> f64| [0, 1].map(|a| matches.iter().map(|m| m.base[a]).reduce(pick).unwrap_or(0.0)));
    let cell = |m: &Match| {
        let [x, y] = [0, 1].map(|a| {
            let share = (m.base[a] - low[a]) / (high[a] - low[a]).max(1e-12);
            ((share * side as f64) as usize).min(side - 1)
        });
        y * side + x
    };
    let mut sums = vec![(DMatrix::zeros(size, size), DVector::zeros(size)); side * side];
    for m in matches {
        let sent = map_point(&p, m.base);
        let r = [0, 1].map(|a| (m.here[a] - sent[a]) / m.sigma);
        let weight = (limit / r[0].hypot(r[1]).max(1e-12)).min(1.0);
        let [jx, jy] = jacobian(&p, m.base).map(|s| model.gather(&s) / m.sigma);
        let (normal, right) = &mut sums[cell(m)];
        *normal += weight * (&jx * jx.transpose() + &jy * jy.transpose());
        *right += weight * (r[0] * jx + r[1] * jy);
    }
    let whole: DMatrix<f64> = sums.iter().map(|s| &s.0).sum();
    let mut out = DMatrix::zeros(size, size);
    let (mut used, mut count) = (0.0, 0.0);
    for (normal, right) in sums.iter().filter(|s| s.0.trace() > 0.0) {
        count += 1.0;
        // a block without which nothing is known says nothing about how sure the rest is
        let Some(rest) = (&whole - normal).try_inverse() else { continue };
        let step = rest * right;
        out += &step * step.transpose();
        used += 1.0;
    }
    if used < 2.0 {
        return out;
    }
    // so few blocks tell little about their own scatter: as much more as the tails of a t distribution ask for
    let caution = 1.0 + 2.5 / (2.0 * count - size as f64).max(2.0);
    out * ((count - 1.0) / used * caution * caution)
}

/// Where a map sends a point, units.
pub(super) fn map_point(p: &Parameters, [x, y]: [f64; 2]) -> [f64; 2] {
    let w = p[6] * x + p[7] * y + 1.0;
    [((1.0 + p[0]) * x + p[1] * y + p[2]) / w, (p[3] * x + (1.0 + p[4]) * y + p[5]) / w]
}

/// Slopes of the two coordinates of [`map_point`] against the eight numbers.
fn jacobian(p: &Parameters, at: [f64; 2]) -> [Parameters; 2] {
    let [x, y] = at;
    let w = p[6] * x + p[7] * y + 1.0;
    let [u, v] = map_point(p, at);
    [
        [x / w, y / w, 1.0 / w, 0.0, 0.0, 0.0, -u * x / w, -u * y / w],
        [0.0, 0.0, 0.0, x / w, y / w, 1.0 / w, -v * x / w, -v * y / w],
    ]
}

/// Standard deviation of the worst corner of a picture, px.
pub(super) fn corner_sigma(
    model: TransformModel,
    free: &DVector<f64>,
    covariance: &DMatrix<f64>,
    frame: &Frame,
    width: u32,
    height: u32,
) -> f64 {
    let p = model.parameters(free);
    Homography::corners(width, height)
        .into_iter()
        .map(|corner| {
            let rows = jacobian(&p, frame.unit(corner)).map(|s| model.gather(&s));
            let spread = |j: &DVector<f64>| (j.transpose() * covariance * j)[(0, 0)];
            frame.half * rows.iter().map(spread).sum::<f64>().max(0.0).sqrt()
        })
        .fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::super::testkit::Noise;
    use super::*;

    fn grid(truth: &Parameters, scatter: f64, seed: u64, wrong: usize) -> Vec<Match> {
        let mut noise = Noise(seed);
        (0..117)
            .map(|k| {
                let base = [f64::from(k % 13) / 8.0 - 0.75, f64::from(k / 13) / 10.0 - 0.4];
                let sent = map_point(truth, base);
                let off = if (k as usize) < wrong { 0.03 } else { 0.0 };
                Match { base, here: sent.map(|v| v + off + scatter * noise.normal()), sigma: 1e-4 }
            })
            .collect()
    }

    const TRUTH: Parameters = [-0.03, 0.002, 0.01, -0.003, -0.031, 0.004, 2e-3, -1e-3];

    #[test]
    fn exact_dots_give_the_map_back() {
        let fit = fit(TransformModel::Homography, &grid(&TRUTH, 0.0, 1, 0)).expect("a map");
        for (found, truth) in TransformModel::Homography.parameters(&fit.free).iter().zip(TRUTH) {
            assert!((found - truth).abs() < 1e-9, "{found} for {truth}");
        }
        let turned: Parameters = [-0.02, -0.004, 0.01, 0.004, -0.02, -0.02, 0.0, 0.0];
        let similar = super::fit(TransformModel::Similarity, &grid(&turned, 0.0, 1, 0)).expect("a map");
        assert!(
            TransformModel::Similarity.parameters(&similar.free).iter().zip(turned).all(|(a, b)| (a - b).abs() < 1e-9)
        );
    }

    #[test]
    fn the_error_of_the_corner_is_what_its_sigma_says() {
        let frame = Frame::new(1200, 800);
        let truth = frame.homography(&TRUTH).expect("regular");
        let (mut squares, mut claimed) = (0.0, 0.0);
        for seed in 0..60 {
            // twice the scatter that the dots claim
            let fit = fit(TransformModel::Homography, &grid(&TRUTH, 2e-4, seed, 0)).expect("a map");
            let found = frame.homography(&TransformModel::Homography.parameters(&fit.free)).expect("regular");
            squares += found.corner_distance(&truth, 1200, 800).powi(2);
            claimed += corner_sigma(TransformModel::Homography, &fit.free, &fit.covariance, &frame, 1200, 800);
        }
        let ratio = (squares / 60.0).sqrt() / (claimed / 60.0);
        // the largest of four corners, so a little more than one corner's sigma
        assert!((0.8..1.7).contains(&ratio), "{ratio}");
    }

    #[test]
    fn a_few_wrong_dots_do_little_harm_and_too_few_give_nothing() {
        let frame = Frame::new(1200, 800);
        let truth = frame.homography(&TRUTH).expect("regular");
        let found = fit(TransformModel::Homography, &grid(&TRUTH, 1e-4, 3, 5)).expect("a map");
        let found = frame.homography(&TransformModel::Homography.parameters(&found.free)).expect("regular");
        assert!(found.corner_distance(&truth, 1200, 800) < 0.3);
        assert!(fit(TransformModel::Homography, &grid(&TRUTH, 0.0, 1, 0)[..4]).is_none());
        let line: Vec<Match> = (0..20)
            .map(|k| Match { base: [f64::from(k) / 20.0, 0.1], here: [f64::from(k) / 20.0, 0.1], sigma: 1e-4 })
            .collect();
        assert!(fit(TransformModel::Homography, &line).is_none_or(|f| corner_sigma(
            TransformModel::Homography,
            &f.free,
            &f.covariance,
            &frame,
            1200,
            800
        ) > 1.0));
    }
}
