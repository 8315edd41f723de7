//! Coarse registration: how the grid moved from one slice to the next, found by search before any dot is measured.

use rayon::prelude::*;

use super::working_image::sample;
use crate::imaging::Plane;

/// A scale about the image centre and a shift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SimilarityMotion {
    /// Scale factor.
    pub scale: f64,
    /// Shift of the image centre, px.
    pub shift: [f64; 2],
}

impl SimilarityMotion {
    /// The identity.
    pub(super) const NONE: Self = Self { scale: 1.0, shift: [0.0, 0.0] };

    /// The image of `p`; `middle` is the image centre.
    pub(super) fn apply(&self, middle: [f64; 2], p: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|a| middle[a] + self.scale * (p[a] - middle[a]) + self.shift[a])
    }
}

/// The best motion that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RegisteredMotion {
    /// The motion.
    pub motion: SimilarityMotion,
    /// 1, or -1 where blur has inverted the dots.
    pub sign: f64,
    /// Mean difference between dots and the gaps between them, in units of contrast.
    pub depth: f64,
    /// `depth` in standard errors.
    pub significance: f64,
}

/// Input of the search.
pub(super) struct CoarseRegistration<'a> {
    /// Contrast image (positive on dots).
    pub contrast: &'a Plane<f32>,
    /// Dots in the neighbouring slice, in px of `contrast`.
    pub dots: &'a [[f64; 2]],
    /// The two grid steps, px.
    pub steps: [[f64; 2]; 2],
    /// Dot pitch, px.
    pub pitch: f64,
}

/// Most dots that are sampled; more only cost time.
const MAX_DOTS: usize = 400;

impl CoarseRegistration<'_> {
    /// The motion with the largest difference between the predicted dots and the gaps between them (with `sign` -1,
    /// where blur inverts the dots: the most negative). Searches scales `around.scale` +- `scale_reach` and shifts up
    /// to `shift_reach` of the pitch along each axis, in two passes, coarse to fine.
    pub(super) fn best(
        &self,
        around: SimilarityMotion,
        scale_reach: f64,
        shift_reach: f64,
        sign: f64,
    ) -> RegisteredMotion {
        let middle = self.middle();
        let far = self.dots.iter().map(|p| (p[0] - middle[0]).hypot(p[1] - middle[1])).fold(self.pitch, f64::max);
        let mut best = around;
        // each pass searches a finer grid around the best result of the pass before
        let passes = [(scale_reach, shift_reach, 0.2), (0.25 * self.pitch / far, 0.2, 0.07)];
        for (reach, shifts, fine) in passes {
            let scale_step = fine * self.pitch / far;
            let scales = (reach / scale_step).ceil() as i32;
            let moves = (shifts / fine).round() as i32;
            let from = best;
            let candidates: Vec<SimilarityMotion> = (-scales..=scales)
                .flat_map(|s| (-moves..=moves).flat_map(move |y| (-moves..=moves).map(move |x| (s, x, y))))
                .map(|(s, x, y)| {
                    let step = fine * self.pitch;
                    let shift = [from.shift[0] + f64::from(x) * step, from.shift[1] + f64::from(y) * step];
                    SimilarityMotion { scale: from.scale + f64::from(s) * scale_step, shift }
                })
                .collect();
            let scores: Vec<f64> = candidates.par_iter().map(|m| self.score(middle, m, &around, sign)).collect();
            let top = scores.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1).then(b.0.cmp(&a.0)));
            if let Some((k, _)) = top {
                best = candidates[k];
            }
        }
        if sign > 0.0 {
            best = self.nearest_equal(middle, best, around);
        }
        let depth = self.depth(middle, &best);
        let (depth, error) = depth.map_or((0.0, 1.0), |d| (sign * d.mean, d.error));
        RegisteredMotion { motion: best, sign, depth, significance: depth / error }
    }

    /// Resolves the ambiguity of whole grid steps. A grid that fills the image looks the same when shifted by a whole
    /// step: the smallest shift is taken. A grid that ends inside the image shows missing dots on one side.
    fn nearest_equal(&self, middle: [f64; 2], best: SimilarityMotion, around: SimilarityMotion) -> SimilarityMotion {
        let [u, v] = self.steps;
        let shifted = (-1..=1).flat_map(|i| (-1..=1).map(move |j| (f64::from(i), f64::from(j)))).map(|(i, j)| {
            let shift = [0, 1].map(|a| best.shift[a] + best.scale * (i * u[a] + j * v[a]));
            SimilarityMotion { shift, ..best }
        });
        // a row more or less at the border changes the depth by a few percent; a whole step must win by more than that
        let judged = |m: &SimilarityMotion| {
            self.depth(middle, m).map_or(0.0, |d| d.mean) * (1.0 - 0.15 * self.shift_distance(m, &around).powi(2))
        };
        shifted.max_by(|a, b| judged(a).total_cmp(&judged(b))).unwrap_or(best)
    }

    /// Distance of the shift from the expected one, grid steps.
    fn shift_distance(&self, motion: &SimilarityMotion, around: &SimilarityMotion) -> f64 {
        (motion.shift[0] - around.shift[0]).hypot(motion.shift[1] - around.shift[1]) / self.pitch
    }

    /// The image centre.
    pub(super) fn middle(&self) -> [f64; 2] {
        [(self.contrast.width as f64 - 1.0) / 2.0, (self.contrast.height as f64 - 1.0) / 2.0]
    }

    /// The objective: depth, weighted by the visible share of the dots, with a small penalty on the shift.
    fn score(&self, middle: [f64; 2], motion: &SimilarityMotion, around: &SimilarityMotion, sign: f64) -> f64 {
        let Some(depth) = self.depth(middle, motion) else { return f64::NEG_INFINITY };
        let away = self.shift_distance(motion, around);
        sign * depth.mean * depth.visible.sqrt() * (1.0 - 0.1 * away * away)
    }

    /// Mean and standard error of (dot - gap). `None` when too few predicted dots lie in the image.
    fn depth(&self, middle: [f64; 2], motion: &SimilarityMotion) -> Option<Depth> {
        let stride = self.dots.len().div_ceil(MAX_DOTS).max(1);
        let [u, v] = self.steps.map(|s| s.map(|c| 0.5 * motion.scale * c));
        let (mut n, mut sum, mut squares, mut sampled) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
        for dot in self.dots.iter().step_by(stride) {
            sampled += 1.0;
            let p = motion.apply(middle, *dot);
            let Some(on) = sample(self.contrast, p) else { continue };
            let corners = [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]];
            let (mut off, mut corners_in) = (0.0, 0.0);
            for [a, b] in corners {
                if let Some(value) = sample(self.contrast, [p[0] + a * u[0] + b * v[0], p[1] + a * u[1] + b * v[1]]) {
                    off += value;
                    corners_in += 1.0;
                }
            }
            if corners_in == 0.0 {
                continue;
            }
            let depth = f64::from(on - off / corners_in);
            n += 1.0;
            sum += depth;
            squares += depth * depth;
        }
        if n < 8.0 || n < 0.3 * sampled {
            return None;
        }
        let mean = sum / n;
        Some(Depth { mean, error: ((squares / n - mean * mean).max(1e-12) / n).sqrt(), visible: n / sampled })
    }
}

/// Depth of the predicted dots.
struct Depth {
    mean: f64,
    error: f64,
    /// Share of the predicted dots that lie in the image.
    visible: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scale_of_several_percent_and_a_drift_of_a_third_of_the_pitch_are_found() {
        let (width, height, pitch) = (640, 480, 24.0);
        let grid: Vec<[f64; 2]> =
            (0..16 * 12).map(|k| [140.0 + f64::from(k % 16) * pitch, 100.0 + f64::from(k / 16) * pitch]).collect();
        let truth = SimilarityMotion { scale: 1.045, shift: [7.5, -5.0] };
        let middle = [(width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0];
        let mut contrast = Plane::filled(width, height, 0.0_f32);
        for dot in &grid {
            let c = truth.apply(middle, *dot);
            for y in 0..height {
                for x in 0..width {
                    let d = (x as f64 - c[0]).powi(2) + (y as f64 - c[1]).powi(2);
                    if d < 400.0 {
                        contrast.data[y * width + x] += (-d / 50.0).exp() as f32;
                    }
                }
            }
        }
        let registration =
            CoarseRegistration { contrast: &contrast, dots: &grid, steps: [[pitch, 0.0], [0.0, pitch]], pitch };
        let RegisteredMotion { motion: found, significance, .. } =
            registration.best(SimilarityMotion::NONE, 0.08, 0.6, 1.0);
        for dot in &grid {
            let (a, b) = (truth.apply(middle, *dot), found.apply(middle, *dot));
            assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 0.12 * pitch, "{found:?}");
        }
        assert!(significance > 20.0);
    }
}
