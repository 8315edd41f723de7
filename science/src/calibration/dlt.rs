//! Direct linear transform: a homography from four or more point pairs.
//!
//! Equations 7 to 10 of Li and Nguyen (2019), with the normalisation of Hartley (1997). Without it, coordinates of
//! thousands of pixels make the equations too ill-conditioned for an accuracy of a hundredth of a pixel.

use nalgebra::{DMatrix, Matrix3};

use crate::types::Homography;

/// A point in a slice and the same point in the reference slice, px.
pub(super) type Pair = ([f64; 2], [f64; 2]);

/// The similarity that moves the centroid of `points` to the origin and their mean distance from it to sqrt(2). `None`
/// when all points coincide.
pub(super) fn normalisation(points: impl Iterator<Item = [f64; 2]> + Clone) -> Option<Matrix3<f64>> {
    let n = points.clone().count() as f64;
    let (sx, sy) = points.clone().fold((0.0, 0.0), |s, p| (s.0 + p[0], s.1 + p[1]));
    let (cx, cy) = (sx / n, sy / n);
    let mean = points.map(|p| (p[0] - cx).hypot(p[1] - cy)).sum::<f64>() / n;
    if !mean.is_finite() || mean < 1e-9 {
        return None;
    }
    let s = std::f64::consts::SQRT_2 / mean;
    Some(Matrix3::new(s, 0.0, -s * cx, 0.0, s, -s * cy, 0.0, 0.0, 1.0))
}

/// The homography that maps each first point to its second, minimising the algebraic error by SVD. `None` for fewer
/// than four pairs, collinear points, or a result that cannot be normalised.
pub(super) fn fit(pairs: &[Pair]) -> Option<Homography> {
    if pairs.len() < 4 {
        return None;
    }
    let from = normalisation(pairs.iter().map(|p| p.0))?;
    let to = normalisation(pairs.iter().map(|p| p.1))?;
    // two rows per pair (the third of equation 10 depends on them); at least nine rows, so that the SVD returns the
    // whole right basis
    let mut a = DMatrix::zeros((2 * pairs.len()).max(9), 9);
    for (k, (p, q)) in pairs.iter().enumerate() {
        let place = |t: &Matrix3<f64>, p: &[f64; 2]| [t[(0, 0)] * p[0] + t[(0, 2)], t[(1, 1)] * p[1] + t[(1, 2)]];
        let ([x, y], [u, v]) = (place(&from, p), place(&to, q));
        let first = [-x, -y, -1.0, 0.0, 0.0, 0.0, u * x, u * y, u];
        let second = [0.0, 0.0, 0.0, -x, -y, -1.0, v * x, v * y, v];
        for c in 0..9 {
            a[(2 * k, c)] = first[c];
            a[(2 * k + 1, c)] = second[c];
        }
    }
    let svd = a.try_svd(false, true, 1e-14, 200)?;
    let singular = &svd.singular_values;
    // a second vanishing singular value: the points do not determine a homography
    if singular[7] < 1e-9 * singular[0] {
        return None;
    }
    let vector = svd.v_t?.row(8).clone_owned();
    let normalised = Matrix3::from_row_slice(vector.iter().copied().collect::<Vec<_>>().as_slice());
    Homography::from_matrix(&(to.try_inverse()? * normalised * from))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    prop_compose! {
        /// Homographies like those between slices, and stronger ones.
        fn homography()(
            a in 0.8..1.25, b in -0.1..0.1, tx in -90.0..90.0, c in -0.1..0.1, d in 0.8..1.25, ty in -90.0..90.0,
            g in -3e-5..3e-5, h in -3e-5..3e-5
        ) -> Homography {
            Homography([a, b, tx, c, d, ty, g, h, 1.0])
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn exact_points_recover_the_homography(truth in homography(), columns in 2_usize..9) {
            let pairs: Vec<Pair> = (0..columns * 3)
                .map(|k| {
                    let p = [120.0 + 700.0 * (k % columns) as f64, 90.0 + 1500.0 * (k / columns) as f64];
                    (p, truth.apply(p))
                })
                .collect();
            let found = fit(&pairs).expect("a homography");
            prop_assert!(found.corner_distance(&truth, 6000, 4000) < 1e-6);
        }
    }

    #[test]
    fn collinear_or_coincident_points_give_none() {
        let line: Vec<Pair> = (0..10).map(|k| ([f64::from(k), 2.0 * f64::from(k)], [f64::from(k), 5.0])).collect();
        assert!(fit(&line).is_none());
        assert!(fit(&[([1.0, 1.0], [1.0, 1.0]); 6]).is_none());
        assert!(fit(&line[..3]).is_none());
    }
}
