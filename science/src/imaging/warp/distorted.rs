//! Source positions of a block of pixels under lens distortion.
//!
//! Undoing and applying the distortion for each pixel would cost more than the resampling. Within a block the positions
//! follow quartics through five exact positions ([`super::super::mapping`]).

use super::parts::{BLOCK, PHASES};

/// The source positions of the first `count` pixels of a block, in 1/1024 px, from the quartics of
/// [`super::SliceMapping`]. The rest of `us` and `vs` is arbitrary.
#[inline(always)]
pub(super) fn positions(curves: &[[f64; 5]; 2], count: usize, us: &mut [i32; BLOCK], vs: &mut [i32; BLOCK]) {
    /// 2^52: see `positions` in the parent module.
    const ROUNDER: f64 = 4_503_599_627_370_496.0;
    /// Limit far beyond any slice.
    const FAR: f64 = 2_147_483_000.0;
    let rounded = |c: &[f64; 5], t: f64| {
        let v = ((((c[4] * t + c[3]) * t + c[2]) * t + c[1]) * t + c[0]) * PHASES as f64;
        let v = if v > 0.0 { v } else { 0.0 };
        ((if v < FAR { v } else { FAR }) + ROUNDER).to_bits() as i32
    };
    let step = 1.0 / (count.max(2) - 1) as f64;
    for (i, (u, v)) in us.iter_mut().zip(vs.iter_mut()).enumerate() {
        let t = f64::from(i as u32) * step;
        *u = rounded(&curves[0], t);
        *v = rounded(&curves[1], t);
    }
}

#[cfg(test)]
mod tests {
    use super::super::Warp;
    use crate::types::{Homography, distortion::Distortion};

    const SIZE: (usize, usize) = (160, 110);

    fn lens(k1: f64) -> Distortion {
        Distortion { centre_px: [84.0, 51.0], k1, k2: 0.0, radius_px: 96.0 }
    }

    /// A smooth pattern, which cubic convolution resamples with an error below one grey level.
    fn scene([x, y]: [f64; 2]) -> f64 {
        32_000.0 + 14_000.0 * (0.11 * x).sin() * (0.09 * y + 0.4).cos() + 9_000.0 * (0.05 * (x + y)).sin()
    }

    fn slice(of: impl Fn([f64; 2]) -> [f64; 2]) -> Vec<u16> {
        (0..SIZE.0 * SIZE.1).map(|k| scene(of([(k % SIZE.0) as f64, (k / SIZE.0) as f64])).round() as u16).collect()
    }

    #[test]
    fn slices_with_distortion_are_aligned_to_the_distorted_reference() {
        for k1 in [0.04, -0.05] {
            let (lens, turn) = (lens(k1), Homography([1.03, 0.01, -4.0, -0.012, 1.05, -1.5, 2e-5, -1e-5, 1.0]));
            // the scene is defined in ideal px of the reference slice
            let reference = slice(|x| lens.undistort(x));
            let other = slice(|x| turn.apply(lens.undistort(x)));
            let warp = Warp::with_distortion(&turn, 1.0, SIZE, Some(&lens)).expect("valid");
            let warped = warp.apply(other.clone(), 1);
            assert_eq!(warped, warp.clone().portable().apply(other, 1));
            assert!(warp.coverage().pixels() > 14_000, "{}", warp.coverage().pixels());
            let back = turn.inverse().expect("regular");
            let mut compared = 0;
            for y in 0..SIZE.1 {
                for x in warp.coverage().span(y) {
                    let [u, v] = lens.distort(back.apply(lens.undistort([x as f64, y as f64])));
                    // nearer to the border of the slice the kernel repeats border pixels
                    if u < 1.0 || v < 1.0 || u >= SIZE.0 as f64 - 2.0 || v >= SIZE.1 as f64 - 2.0 {
                        continue;
                    }
                    let (found, truth) = (warped[y * SIZE.0 + x], reference[y * SIZE.0 + x]);
                    // 0.003 px at the steepest slope
                    assert!(found.abs_diff(truth) < 6, "{found} for {truth} at {x}, {y}");
                    compared += 1;
                }
            }
            assert!(compared > 13_000, "{compared}");
        }
    }

    #[test]
    fn no_distortion_and_the_reference_slice_change_nothing() {
        let turn = Homography::similarity(1.02, [1.0, -2.0]);
        let samples = slice(|x| x);
        let plain = Warp::new(&turn, 1.1, SIZE, SIZE).expect("regular").apply(samples.clone(), 1);
        let none = Warp::with_distortion(&turn, 1.1, SIZE, None).expect("regular").apply(samples.clone(), 1);
        assert_eq!(plain, none);
        let stays = Warp::with_distortion(&Homography::IDENTITY, 1.0, SIZE, Some(&lens(0.04))).expect("regular");
        assert_eq!(stays.apply(samples.clone(), 1), samples);
        assert!(Warp::with_distortion(&turn, 1.0, SIZE, Some(&lens(-2.0))).is_none());
    }

    #[test]
    fn covered_pixels_lie_in_the_slice_also_at_bent_borders() {
        for k1 in [0.15, -0.12] {
            let (lens, turn) = (lens(k1), Homography::similarity(0.9, [6.0, 4.0]));
            let warp = Warp::with_distortion(&turn, 1.0, SIZE, Some(&lens)).expect("valid");
            let back = turn.inverse().expect("regular");
            let mut covered = 0;
            for y in 0..SIZE.1 {
                for x in 0..SIZE.0 {
                    let [u, v] = lens.distort(back.apply(lens.undistort([x as f64, y as f64])));
                    let limit = [SIZE.0 as f64 - 1.0, SIZE.1 as f64 - 1.0];
                    let is_inside = u >= -1e-6 && v >= -1e-6 && u <= limit[0] + 1e-6 && v <= limit[1] + 1e-6;
                    if warp.coverage().span(y).contains(&x) {
                        assert!(is_inside, "{k1}: {x}, {y} is at {u}, {v}");
                        covered += 1;
                    }
                }
            }
            assert!(covered > SIZE.0 * SIZE.1 / 2, "{covered}");
        }
    }
}
