//! The transform models between the reference slice and a slice, and the least-squares fit of one to the shared dots.
//!
//! All coordinates are in *units*: origin at the image centre, one unit = half the image diagonal, for all slices. The
//! equations are then well conditioned (Hartley and Zisserman, section 4.4), and parameters of different slices can be
//! compared, which the rail law does. Transforms map the reference slice **to** the slice: the reference is sharp, so
//! the measurement error is in the slice; and with a fixed lens these transforms are linear in the rail position.

use nalgebra::{DMatrix, DVector, Matrix3};

use crate::types::{Homography, profile::HomographyModel};

/// A transform model with parameters of its own per slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TransformModel {
    /// Scale, rotation and shift: 4 parameters.
    Similarity,
    /// 6 parameters.
    Affine,
    /// 8 parameters, as in Li and Nguyen (2019).
    Homography,
}

/// The eight parameters of a transform, row by row, as differences from the identity: `[1 + p0, p1, p2; p3, 1 + p4, p5;
/// p6, p7, 1]`.
pub(super) type Parameters = [f64; 8];

impl TransformModel {
    /// Number of free parameters per slice.
    pub(super) fn size(self) -> usize {
        match self {
            Self::Similarity => 4,
            Self::Affine => 6,
            Self::Homography => 8,
        }
    }

    /// The model as named in a profile.
    pub(super) fn homography_model(self) -> HomographyModel {
        match self {
            Self::Similarity => HomographyModel::Similarity,
            Self::Affine => HomographyModel::Affine,
            Self::Homography => HomographyModel::Homography,
        }
    }

    /// The eight parameters that follow from the free ones.
    pub(super) fn parameters(self, free: &DVector<f64>) -> Parameters {
        match self {
            Self::Similarity => [free[0], -free[1], free[2], free[1], free[0], free[3], 0.0, 0.0],
            _ => std::array::from_fn(|k| if k < self.size() { free[k] } else { 0.0 }),
        }
    }

    /// Derivatives with respect to the eight parameters, converted to the free ones.
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

/// Conversion between units and pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    /// Image centre, px.
    pub centre: [f64; 2],
    /// Half the image diagonal, px.
    pub half: f64,
}

impl Frame {
    /// For images of this size.
    pub(super) fn new(width: usize, height: usize) -> Self {
        let centre = [(width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0];
        Self { centre, half: centre[0].hypot(centre[1]).max(1.0) }
    }

    /// Pixels to units.
    pub(super) fn unit(&self, p: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|a| (p[a] - self.centre[a]) / self.half)
    }

    /// Units to pixels.
    pub(super) fn pixel(&self, p: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|a| p[a] * self.half + self.centre[a])
    }

    /// The homography slice px -> reference px: the inverse of the transform with these parameters.
    pub(super) fn homography(&self, p: &Parameters) -> Option<Homography> {
        let map = Matrix3::new(1.0 + p[0], p[1], p[2], p[3], 1.0 + p[4], p[5], p[6], p[7], 1.0);
        let (scale, [x, y]) = (1.0 / self.half, self.centre.map(|c| -c / self.half));
        let to_unit = Matrix3::new(scale, 0.0, x, 0.0, scale, y, 0.0, 0.0, 1.0);
        Homography::from_matrix(&(to_unit.try_inverse()? * map.try_inverse()? * to_unit))
    }
}

/// A dot in the reference slice and in a slice, units.
#[derive(Debug, Clone, Copy)]
pub(super) struct Match {
    /// In the reference slice.
    pub base: [f64; 2],
    /// In the slice.
    pub here: [f64; 2],
    /// Standard deviation of their distance.
    pub sigma: f64,
}

/// The best fit of a model.
#[derive(Debug, Clone)]
pub(super) struct Fit {
    /// Its free parameters.
    pub free: DVector<f64>,
    /// Their covariance from the scatter of the dots, as if dots had independent errors.
    pub covariance: DMatrix<f64>,
    /// Their covariance from whole blocks of neighbouring dots, which may share errors.
    pub block_covariance: DMatrix<f64>,
}

/// Huber limit, in standard deviations: larger residuals get less weight.
const HUBER: f64 = 1.5;
/// Smallest scatter that is accepted, relative to the expected noise.
const MIN_SCATTER: f64 = 0.3;

/// Iteratively reweighted Gauss-Newton with Huber weights. `None` when the dots do not determine the parameters.
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
            // the first rounds weigh all dots equally, because the start may be far off
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
        scatter = (super::statistics::median(&mut sizes) / 1.18).max(MIN_SCATTER);
        if !free.iter().all(|v| v.is_finite()) {
            return None;
        }
        if (round >= 4 && step.amax() < 1e-9) || round == 24 {
            let freedom = (2.0 * matches.len() as f64 - size as f64).max(1.0);
            let covariance = &inverse * (square / freedom).max(MIN_SCATTER * MIN_SCATTER);
            let block_covariance = block_jackknife(model, matches, &free, HUBER * scatter);
            return Some(Fit { free, covariance, block_covariance });
        }
    }
    None
}

/// Change of the free parameters when the dots are moved by `moves` in the slice, units.
pub(super) fn response(
    model: TransformModel,
    matches: &[Match],
    free: &DVector<f64>,
    moves: &[[f64; 2]],
) -> Option<DVector<f64>> {
    let p = model.parameters(free);
    let (mut normal, mut right) = (DMatrix::zeros(model.size(), model.size()), DVector::zeros(model.size()));
    for (m, moved) in matches.iter().zip(moves) {
        for (row, moved) in jacobian(&p, m.base).iter().zip(moved) {
            let row = model.gather(row) / m.sigma;
            normal += &row * row.transpose();
            right += row * (moved / m.sigma);
        }
    }
    Some(normal.try_inverse()? * right)
}

/// Fewest and most blocks along each side of the dots' bounding box.
const BLOCKS: (usize, usize) = (3, 5);

/// Covariance by a delete-a-group jackknife: each block of neighbouring dots is left out in turn, with one Gauss-Newton
/// step. Glare, dust and light beyond the target move neighbouring dots together; a covariance from the scatter of
/// single dots would count them as independent.
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
        // without this block the parameters are undetermined, so it tells nothing about the others
        let Some(rest) = (&whole - normal).try_inverse() else { continue };
        let step = rest * right;
        out += &step * step.transpose();
        used += 1.0;
    }
    if used < 2.0 {
        return out;
    }
    // few blocks determine their scatter poorly: widen it as the tails of a t distribution require
    let caution = 1.0 + 2.5 / (2.0 * count - size as f64).max(2.0);
    out * ((count - 1.0) / used * caution * caution)
}

/// Maps a point, units.
pub(super) fn map_point(p: &Parameters, [x, y]: [f64; 2]) -> [f64; 2] {
    let w = p[6] * x + p[7] * y + 1.0;
    [((1.0 + p[0]) * x + p[1] * y + p[2]) / w, (p[3] * x + (1.0 + p[4]) * y + p[5]) / w]
}

/// Jacobian of [`map_point`] with respect to the eight parameters, one row per coordinate.
pub(super) fn jacobian(p: &Parameters, at: [f64; 2]) -> [Parameters; 2] {
    let [x, y] = at;
    let w = p[6] * x + p[7] * y + 1.0;
    let [u, v] = map_point(p, at);
    [
        [x / w, y / w, 1.0 / w, 0.0, 0.0, 0.0, -u * x / w, -u * y / w],
        [0.0, 0.0, 0.0, x / w, y / w, 1.0 / w, -v * x / w, -v * y / w],
    ]
}

/// Standard deviation of the worst image corner, px.
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
    fn exact_dots_recover_the_transform() {
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
    fn the_corner_error_matches_its_sigma() {
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
        // the largest of four corners, so slightly more than one corner's sigma
        assert!((0.8..1.7).contains(&ratio), "{ratio}");
    }

    #[test]
    fn a_few_outliers_do_little_harm_and_too_few_dots_give_none() {
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
