//! Registration of one window of a slice in another slice, to a fraction of a pixel.
//!
//! The window minimises the squared difference of both details, each divided by its norm, by Gauss-Newton steps with
//! the mean of both gradients (Benhimane and Malis, IROS 2004): slice and window play the same part, so a slice that is
//! blurred more than the other, equally in all directions, does not draw the window to one side.

use crate::imaging::Plane;

/// Half the side of a window, px of its level.
pub(super) const HALF: usize = 16;
/// Side of a window, px.
const SIDE: usize = 2 * HALF + 1;
/// Side of a window with the neighbours that its gradient needs.
const WIDE: usize = SIDE + 2;
/// Steps after which a window that still moves is given up.
const MAX_STEPS: usize = 12;
/// A step below this ends the search, px.
const CONVERGED: f64 = 3e-3;
/// Least normalised correlation of a window that counts.
const LEAST_CORRELATION: f64 = 0.6;
/// The same for the detail's squared norms, the smaller over the larger: one slice shows much less than the other.
const LEAST_ENERGY_RATIO: f64 = 0.1;
/// Noise of detail is the same over about so many px, squared.
const NOISE_AREA: f64 = 8.0;

/// Where a window of one slice lies in another slice.
#[derive(Debug, Clone, Copy)]
pub(super) struct Found {
    /// Its middle, px of the level.
    pub at: [f64; 2],
    /// Covariance by the remaining differences, px^2: xx, xy, yy.
    pub covariance: [f64; 3],
}

/// A local map of the neighbourhood of a window: the derivatives of the transform, row by row.
pub(super) type Jacobian = [[f64; 2]; 2];

/// A window of one slice with its gradient.
pub(super) struct Window {
    middle: [usize; 2],
    weights: &'static [f32; SIDE * SIDE],
    /// With neighbours, divided by its norm.
    values: [f32; WIDE * WIDE],
    norm: f64,
}

impl Window {
    /// The window of `plane` around a pixel; `None` too near to the border.
    pub(super) fn of(plane: &Plane<f32>, middle: [usize; 2]) -> Option<Self> {
        let [x, y] = middle;
        let reach = HALF + 1;
        if x < reach || y < reach || x + reach >= plane.width || y + reach >= plane.height {
            return None;
        }
        let mut values = [0.0; WIDE * WIDE];
        for (row, out) in values.chunks_exact_mut(WIDE).enumerate() {
            out.copy_from_slice(&plane.row(y - reach + row)[x - reach..=x + reach]);
        }
        let weights = weights();
        let norm = normalised(&mut values, weights)?;
        Some(Self { middle, weights, values, norm })
    }

    /// The window in `plane`, searched from `start` on within `reach` px.
    pub(super) fn find(&self, plane: &Plane<f32>, start: [f64; 2], map: Jacobian, reach: f64) -> Option<Found> {
        let mut at = start;
        for _ in 0..MAX_STEPS {
            let mut there = sampled(plane, at, map)?;
            let norm = normalised(&mut there, self.weights)?;
            let Sums { normal, right, square, correlation } = self.compared(&there);
            let determinant = normal[0] * normal[2] - normal[1] * normal[1];
            if determinant <= 1e-4 * (normal[0] + normal[2]).powi(2) {
                return None;
            }
            let step = [
                (normal[2] * right[0] - normal[1] * right[1]) / determinant,
                (normal[0] * right[1] - normal[1] * right[0]) / determinant,
            ];
            // steps are px of this window; the map turns them into px of the other slice
            let moved = [0, 1].map(|a| map[a][0] * step[0] + map[a][1] * step[1]);
            at = [0, 1].map(|a| at[a] + moved[a].clamp(-2.0, 2.0));
            if (at[0] - start[0]).hypot(at[1] - start[1]) > reach {
                return None;
            }
            if step[0].hypot(step[1]) < CONVERGED {
                let ratio = (norm / self.norm).powi(2);
                if correlation < LEAST_CORRELATION || ratio.min(1.0 / ratio) < LEAST_ENERGY_RATIO {
                    return None;
                }
                let noise = square * NOISE_AREA / determinant;
                return Some(Found { at, covariance: [normal[2] * noise, -normal[1] * noise, normal[0] * noise] });
            }
        }
        None
    }

    /// The middle, px.
    pub(super) fn middle(&self) -> [f64; 2] {
        self.middle.map(|v| v as f64)
    }

    /// Normal equations of the shift between this window and another one.
    fn compared(&self, there: &[f32; WIDE * WIDE]) -> Sums {
        let (mut sums, mut weight_sum, mut correlation) = ([0.0_f64; 6], 0.0_f64, 0.0_f64);
        for y in 0..SIDE {
            let mut row = [0.0_f32; 6];
            let (mut of_weights, mut of_product) = (0.0_f32, 0.0_f32);
            for x in 0..SIDE {
                let k = (y + 1) * WIDE + x + 1;
                let weight = self.weights[y * SIDE + x];
                let gradient = |step: usize| {
                    0.25 * (self.values[k + step] - self.values[k - step] + there[k + step] - there[k - step])
                };
                let (gx, gy) = (gradient(1), gradient(WIDE));
                let difference = self.values[k] - there[k];
                row[0] += weight * gx * gx;
                row[1] += weight * gx * gy;
                row[2] += weight * gy * gy;
                row[3] += weight * gx * difference;
                row[4] += weight * gy * difference;
                row[5] += weight * difference * difference;
                of_weights += weight;
                of_product += weight * self.values[k] * there[k];
            }
            sums.iter_mut().zip(row).for_each(|(sum, v)| *sum += f64::from(v));
            weight_sum += f64::from(of_weights);
            correlation += f64::from(of_product);
        }
        Sums {
            normal: [sums[0], sums[1], sums[2]],
            right: [sums[3], sums[4]],
            square: sums[5] / weight_sum,
            correlation,
        }
    }
}

struct Sums {
    /// xx, xy, yy.
    normal: [f64; 3],
    right: [f64; 2],
    /// Mean squared difference.
    square: f64,
    correlation: f64,
}

/// Weights of a window: they fall smoothly to its border, so that nothing enters it by a jump.
fn weights() -> &'static [f32; SIDE * SIDE] {
    static WEIGHTS: std::sync::LazyLock<[f32; SIDE * SIDE]> = std::sync::LazyLock::new(|| {
        let hann = |k: usize| {
            let t = (k as f32 + 1.0) / (SIDE as f32 + 1.0);
            0.5 - 0.5 * (std::f32::consts::TAU * t).cos()
        };
        std::array::from_fn(|k| hann(k % SIDE) * hann(k / SIDE))
    });
    &WEIGHTS
}

/// Subtracts the weighted mean and divides by the weighted norm, which is returned; `None` for a window without detail.
fn normalised(values: &mut [f32; WIDE * WIDE], weights: &[f32; SIDE * SIDE]) -> Option<f64> {
    let (mut sum, mut of_weights) = (0.0_f64, 0.0_f64);
    let inner = |k: usize| (k / SIDE + 1) * WIDE + k % SIDE + 1;
    for (k, weight) in weights.iter().enumerate() {
        sum += f64::from(weight * values[inner(k)]);
        of_weights += f64::from(*weight);
    }
    let mean = (sum / of_weights) as f32;
    values.iter_mut().for_each(|v| *v -= mean);
    let square =
        weights.iter().enumerate().map(|(k, w)| f64::from(w * values[inner(k)] * values[inner(k)])).sum::<f64>();
    let norm = square.sqrt();
    // a hundredth of a grey level is less than rounding leaves
    let textured = square > 1e-4 * of_weights;
    if !textured {
        return None;
    }
    let scale = (1.0 / norm) as f32;
    values.iter_mut().for_each(|v| *v *= scale);
    Some(norm)
}

/// The pixels around `at` under a local map, by Keys' cubic; `None` too near to the border.
fn sampled(plane: &Plane<f32>, at: [f64; 2], map: Jacobian) -> Option<[f32; WIDE * WIDE]> {
    let reach = (HALF + 1) as f64;
    let far = [0, 1].map(|a| reach * (map[a][0].abs() + map[a][1].abs()) + 2.0);
    let size = [plane.width, plane.height].map(|v| v as f64);
    if !(0..2).all(|a| at[a] - far[a] >= 0.0 && at[a] + far[a] < size[a] - 1.0) {
        return None;
    }
    let mut out = [0.0; WIDE * WIDE];
    for (row, out) in out.chunks_exact_mut(WIDE).enumerate() {
        let dy = row as f64 - reach;
        for (column, v) in out.iter_mut().enumerate() {
            let dx = column as f64 - reach;
            let x = at[0] + map[0][0] * dx + map[0][1] * dy;
            let y = at[1] + map[1][0] * dx + map[1][1] * dy;
            *v = cubic(plane, x, y);
        }
    }
    Some(out)
}

#[inline(always)]
fn cubic(plane: &Plane<f32>, x: f64, y: f64) -> f32 {
    let (left, top) = (x as usize, y as usize);
    let (wx, wy) = (keys((x - left as f64) as f32), keys((y - top as f64) as f32));
    let first = (top - 1) * plane.width + left - 1;
    let mut sum = 0.0;
    for (k, wy) in wy.iter().enumerate() {
        let row = &plane.data[first + k * plane.width..first + k * plane.width + 4];
        sum += wy * (wx[0] * row[0] + wx[1] * row[1] + wx[2] * row[2] + wx[3] * row[3]);
    }
    sum
}

/// Weights of the four neighbours (Keys 1981, a = -1/2).
#[inline(always)]
fn keys(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [-0.5 * t3 + t2 - 0.5 * t, 1.5 * t3 - 2.5 * t2 + 1.0, -1.5 * t3 + 2.0 * t2 + 0.5 * t, 0.5 * t3 - 0.5 * t2]
}
