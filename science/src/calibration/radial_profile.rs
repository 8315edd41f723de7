//! The radial profile of a dot: contrast as a function of the distance from its centre.
//!
//! All dots of a slice are the same disc under the same blur, so one profile serves them all. It is estimated from the
//! image for any kind of blur: the contrast at a pixel is the sum of the profiles of the dots around it, which is
//! linear in the profile's values. With it, the blur of neighbours can be rendered or removed, so a dot at the border
//! of the grid is not biased towards its neighbours.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::working_image::pixels_within;
use crate::imaging::Plane;

/// Radius within which a dot contributes contrast, in grid steps.
pub(super) const REACH: f64 = 0.85;

/// Contrast over distance: linear between values `step` px apart; 0 beyond the last.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RadialProfile {
    /// Distance between two values, px.
    pub step: f64,
    /// Contrast at 0, step, 2 step, ...
    pub values: Vec<f64>,
}

/// A dot that the profile is estimated from or rendered at.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlacedDot {
    /// Centre, px.
    pub at: [f64; 2],
    /// Strength: 1 for an ordinary dot, 0 for none.
    pub strength: f64,
}

/// Spatial index of the dots.
pub(super) struct DotIndex {
    cell: f64,
    columns: usize,
    rows: usize,
    lists: Vec<Vec<u32>>,
}

impl DotIndex {
    /// Cells of `cell` px over a `width` x `height` plane and a margin of one cell.
    pub(super) fn new(dots: &[PlacedDot], cell: f64, width: usize, height: usize) -> Self {
        let columns = (width as f64 / cell).ceil() as usize + 2;
        let rows = (height as f64 / cell).ceil() as usize + 2;
        let mut lists = vec![Vec::new(); columns * rows];
        for (k, dot) in dots.iter().enumerate().filter(|(_, d)| d.strength != 0.0) {
            let (x, y) = ((dot.at[0] / cell).floor() + 1.0, (dot.at[1] / cell).floor() + 1.0);
            if x >= 0.0 && y >= 0.0 && (x as usize) < columns && (y as usize) < rows {
                lists[y as usize * columns + x as usize].push(k as u32);
            }
        }
        Self { cell, columns, rows, lists }
    }

    /// Indices of the dots in the 3 x 3 cells around (x, y), which include all within one cell size.
    pub(super) fn around(&self, x: f64, y: f64) -> impl Iterator<Item = usize> + '_ {
        let (cx, cy) = (((x / self.cell) as usize) + 1, ((y / self.cell) as usize) + 1);
        let (left, right) = (cx - 1, (cx + 1).min(self.columns - 1));
        (cy - 1..=(cy + 1).min(self.rows - 1))
            .flat_map(move |row| self.lists[row * self.columns + left..=row * self.columns + right].iter())
            .flatten()
            .map(|&k| k as usize)
    }
}

/// Rows per task: fixed, so that sums do not depend on the number of threads.
const BAND: usize = 32;
/// Coefficients of the ground polynomial.
const GROUND: usize = 6;
/// Approximate number of pixels that the profile is estimated from.
const PIXELS: f64 = 24_000.0;

/// Length of (dx, dy). `hypot` guards against overflow, which pixels cannot cause, and is slow.
fn distance(dx: f64, dy: f64) -> f64 {
    (dx * dx + dy * dy).sqrt()
}

/// Input of the normal equations of the profile.
struct Equations<'a> {
    valid: &'a Plane<u8>,
    contrast: &'a Plane<f32>,
    dots: &'a [PlacedDot],
    index: &'a DotIndex,
    step: f64,
    count: usize,
    stride: usize,
}

impl Equations<'_> {
    /// Normal matrix (row by row; the lower triangle is complete) and right-hand side over the rows of one band.
    fn of_band(&self, band: usize) -> (Vec<f64>, Vec<f64>) {
        let (count, stride, size) = (self.count, self.stride, self.count + GROUND);
        let (mut normal, mut right) = (vec![0.0; size * size], vec![0.0; size]);
        let mut row: Vec<(usize, f64)> = Vec::new();
        let (top, bottom) = (band * BAND * stride, ((band + 1) * BAND * stride).min(self.contrast.height));
        for (line, y) in (top..bottom).step_by(stride).enumerate() {
            // each row starts at another column, otherwise the samples could alias with the dots
            for x in (line * 5 % stride..self.contrast.width).step_by(stride) {
                if self.valid.at(x, y) == 0 {
                    continue;
                }
                row.clear();
                for k in self.index.around(x as f64, y as f64) {
                    let dot = &self.dots[k];
                    let t = distance(x as f64 - dot.at[0], y as f64 - dot.at[1]) / self.step;
                    let i = t as usize;
                    if i >= count {
                        continue;
                    }
                    let part = t - i as f64;
                    row.push((i, dot.strength * (1.0 - part)));
                    if i + 1 < count {
                        row.push((i + 1, dot.strength * part));
                    }
                }
                if row.is_empty() {
                    continue;
                }
                let u = 2.0 * x as f64 / self.contrast.width as f64 - 1.0;
                let v = 2.0 * y as f64 / self.contrast.height as f64 - 1.0;
                let ground: [f64; GROUND] = [1.0, u, v, u * u, u * v, v * v];
                let value = f64::from(self.contrast.at(x, y));
                for &(a, wa) in &row {
                    right[a] += wa * value;
                    let line = &mut normal[a * size..(a + 1) * size];
                    row.iter().for_each(|&(b, wb)| line[b] += wa * wb);
                }
                for (k, g) in ground.iter().enumerate() {
                    right[count + k] += g * value;
                    let line = &mut normal[(count + k) * size..(count + k + 1) * size];
                    row.iter().for_each(|&(b, wb)| line[b] += g * wb);
                    line[count..].iter_mut().zip(&ground[..=k]).for_each(|(sum, other)| *sum += g * other);
                }
            }
        }
        (normal, right)
    }
}

impl RadialProfile {
    /// Contrast at distance `rho` and its derivative there.
    pub(super) fn at(&self, rho: f64) -> (f64, f64) {
        let t = rho / self.step;
        let k = t as usize;
        if k >= self.values.len() {
            return (0.0, 0.0);
        }
        let (a, b) = (self.values[k], self.values.get(k + 1).copied().unwrap_or(0.0));
        (a + (b - a) * (t - k as f64), (b - a) / self.step)
    }

    /// Least squares over the pixels that are not 0 in `valid` within `reach` of a dot, slightly smoothed, together
    /// with an error of the ground (a polynomial of degree 2, discarded: otherwise the tail of the profile would absorb
    /// it). `None` when there are too few pixels.
    pub(super) fn measure(contrast: &Plane<f32>, valid: &Plane<u8>, dots: &[PlacedDot], reach: f64) -> Option<Self> {
        // one value per px: a coarser profile would blunt the edge of a sharp dot, and bias its centre
        let count = (reach as usize).clamp(6, 64);
        let step = reach / count as f64;
        let size = count + GROUND;
        let index = DotIndex::new(dots, reach, contrast.width, contrast.height);
        // in a large image a subset of the pixels is enough: all dots have the same profile
        let stride = ((contrast.data.len() as f64 / PIXELS).sqrt() as usize).max(1);
        let equations = Equations { valid, contrast, dots, index: &index, step, count, stride };
        let bands: Vec<(Vec<f64>, Vec<f64>)> =
            (0..contrast.height.div_ceil(BAND * stride)).into_par_iter().map(|band| equations.of_band(band)).collect();
        let mut sums = vec![0.0; size * size];
        let mut right = DVector::zeros(size);
        for (n, r) in bands {
            sums.iter_mut().zip(n).for_each(|(sum, part)| *sum += part);
            right.iter_mut().zip(r).for_each(|(sum, part)| *sum += part);
        }
        let mut normal = DMatrix::from_row_slice(size, size, &sums);
        let weight = (0..count).map(|k| normal[(k, k)]).sum::<f64>() / count as f64;
        if weight < 1.0 {
            return None;
        }
        for k in 0..size {
            // In a grid that fills the image, a wide tail and a darker ground cannot be separated: this prior prefers
            // the smaller tail.
            let tail = (2.5 * (k as f64 / count as f64 - 0.6)).clamp(0.0, 1.0);
            let prior = if k < count { 1e-6 + 1e-2 * tail * tail } else { 1e-6 };
            normal[(k, k)] += prior * weight;
        }
        for k in 1..count - 1 {
            // a small penalty on curvature, for values that few pixels determine
            let bend = [(k - 1, 1.0), (k, -2.0), (k + 1, 1.0)];
            for (a, wa) in bend {
                for (b, wb) in bend {
                    normal[(a, b)] += 1e-5 * weight * wa * wb;
                }
            }
        }
        // uses the lower triangle only
        let solved = normal.cholesky()?.solve(&right);
        let values: Vec<f64> = solved.iter().take(count).copied().collect();
        values.iter().all(|v| v.is_finite()).then_some(Self { step, values })
    }

    /// Renders the contrast of these dots.
    pub(super) fn render(&self, dots: &[PlacedDot], width: usize, height: usize) -> Plane<f32> {
        let reach = self.step * self.values.len() as f64;
        let mut plane = Plane::filled(width, height, 0.0_f32);
        let drawn: Vec<&PlacedDot> = dots.iter().filter(|d| d.strength != 0.0).collect();
        // value and increment per step, 0 beyond the reach
        let next = |k: usize| self.values.get(k + 1).copied().unwrap_or(0.0);
        let steps: Vec<(f32, f32)> =
            self.values.iter().enumerate().map(|(k, &v)| (v as f32, (next(k) - v) as f32)).collect();
        let per_step = (1.0 / self.step) as f32;
        plane.data.par_chunks_mut(width * BAND).enumerate().for_each(|(band, rows)| {
            let (top, bottom) = (band * BAND, band * BAND + rows.len() / width);
            for dot in &drawn {
                let strength = dot.strength as f32;
                for y in pixels_within(dot.at[1], reach, top..bottom) {
                    let row = &mut rows[(y - top) * width..(y - top + 1) * width];
                    let dy = y as f64 - dot.at[1];
                    let columns = pixels_within(dot.at[0], (reach * reach - dy * dy).max(0.0).sqrt(), 0..width);
                    let (first, dy) = ((columns.start as f64 - dot.at[0]) as f32, dy as f32);
                    for (k, out) in row[columns].iter_mut().enumerate() {
                        let dx = first + k as f32;
                        let t = (dx * dx + dy * dy).sqrt() * per_step;
                        if let Some((value, rise)) = steps.get(t as usize) {
                            *out += strength * (value + rise * t.fract());
                        }
                    }
                }
            }
        });
        plane
    }

    /// True when neighbouring dots, `pitch` px apart, merge.
    pub(super) fn merges(&self, pitch: f64) -> bool {
        self.at(0.5 * pitch).0.abs() > 0.25 * self.peak()
    }

    /// The largest contrast.
    pub(super) fn peak(&self) -> f64 {
        self.values.iter().fold(0.0_f64, |top, v| top.max(v.abs()))
    }

    /// Distance at which the contrast has fallen to half of its maximum, px.
    pub(super) fn half_width(&self) -> f64 {
        self.width_at(0.5)
    }

    /// Distance from which a dot leaves the ground white, px.
    pub(super) fn rim(&self) -> f64 {
        let tenth = self.width_at(0.1);
        // beyond a tenth the tail may be stripes of light and not the dot: its edge goes on as it fell to there
        tenth + 0.6 * (tenth - self.half_width())
    }

    /// Distance at which the contrast has fallen to `share` of its maximum, px.
    fn width_at(&self, share: f64) -> f64 {
        let half = share * self.values.iter().take(3).fold(0.0_f64, |top, v| top.max(v.abs()));
        // the first crossing: the tail may oscillate where few pixels determine it
        let Some(next) = self.values.iter().position(|v| v.abs() < half) else {
            return self.values.len() as f64 * self.step;
        };
        let Some(last) = next.checked_sub(1) else { return 0.5 * self.step };
        let (here, there) = (self.values[last].abs(), self.values[next].abs());
        (last as f64 + (here - half) / (here - there).max(1e-12)) * self.step
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_profile_of_overlapping_dots_is_recovered() {
        let dots: Vec<PlacedDot> = (0..36)
            .map(|k| PlacedDot { at: [20.3 + 12.0 * f64::from(k % 6), 18.7 + 12.0 * f64::from(k / 6)], strength: 1.0 })
            .collect();
        let truth = |rho: f64| 0.6 * (-rho * rho / 24.0).exp();
        let contrast = Plane::from_fn(100, 100, |x, y| {
            dots.iter().map(|d| truth((x as f64 - d.at[0]).hypot(y as f64 - d.at[1]))).sum::<f64>() as f32
        });
        let profile = RadialProfile::measure(&contrast, &Plane::filled(100, 100, 1), &dots, 14.0).expect("a profile");
        for rho in [0.5, 3.0, 6.0, 9.0] {
            assert!((profile.at(rho).0 - truth(rho)).abs() < 0.02, "{rho}: {} for {}", profile.at(rho).0, truth(rho));
        }
        let again = profile.render(&dots, 100, 100);
        let worst = again.data.iter().zip(&contrast.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 0.02, "{worst}");
        assert!(!profile.merges(30.0) && profile.merges(8.0));
    }

    #[test]
    fn without_dots_there_is_no_profile() {
        assert!(RadialProfile::measure(&Plane::filled(40, 40, 0.0), &Plane::filled(40, 40, 1), &[], 10.0).is_none());
    }
}
