//! The focus measure of guided filtering fusion (Li, Kang & Hu 2013): `|Laplacian|`, smoothed by a Gaussian.

/// Shape of the Gaussian that smooths `|Laplacian|`.
#[derive(Debug, Clone)]
pub struct Saliency {
    /// Half of the symmetric kernel: `weights[d]` is the weight at distance `d`.
    weights: Vec<f32>,
}

impl Saliency {
    /// A Gaussian of `2 * radius + 1` taps and standard deviation `sigma` px, normalised to a sum of 1.
    pub fn new(radius: usize, sigma: f64) -> Self {
        let half: Vec<f64> = (0..=radius).map(|d| (-((d * d) as f64) / (2.0 * sigma * sigma)).exp()).collect();
        let sum = half[0] + 2.0 * half[1..].iter().sum::<f64>();
        Self { weights: half.iter().map(|w| (w / sum) as f32).collect() }
    }

    /// How far from a pixel its saliency looks: the Gaussian and one pixel of the Laplacian.
    pub fn reach(&self) -> usize {
        self.weights.len()
    }

    /// Saliency of the rows `rows` of a `width` x `height` picture. `luma(y, out)` fills `out` with row `y` of
    /// its luma; `emit(y, luma, saliency)` gets the rows in ascending order. Beyond the picture its border is
    /// repeated, both for the Laplacian (kernel `[0 1 0; 1 -4 1; 0 1 0]`) and for the Gaussian.
    ///
    /// A row's result does not depend on the range it is computed in.
    pub fn rows(
        &self,
        (width, height): (usize, usize),
        rows: std::ops::Range<usize>,
        luma: impl Fn(usize, &mut [f32]),
        mut emit: impl FnMut(usize, &[f32], &[f32]),
    ) {
        if width == 0 || rows.is_empty() {
            return;
        }
        let radius = self.weights.len() - 1;
        let first_lap = rows.start.saturating_sub(radius);
        let last_lap = (rows.end - 1 + radius).min(height - 1);
        let first_luma = first_lap.saturating_sub(1);
        let last_luma = (last_lap + 1).min(height - 1);

        let mut grey = vec![0.0f32; (last_luma - first_luma + 1) * width];
        for (i, row) in grey.chunks_exact_mut(width).enumerate() {
            luma(first_luma + i, row);
        }
        let grey_row = |y: usize| &grey[(y - first_luma) * width..(y - first_luma + 1) * width];

        let mut padded = vec![0.0f32; width + 2 * radius];
        let mut blurred = vec![0.0f32; (last_lap - first_lap + 1) * width];
        for (i, out) in blurred.chunks_exact_mut(width).enumerate() {
            let y = first_lap + i;
            let (above, below) = (y.saturating_sub(1), (y + 1).min(height - 1));
            laplacian(grey_row(above), grey_row(y), grey_row(below), &mut padded[radius..radius + width]);
            let (left, right) = (padded[radius], padded[radius + width - 1]);
            padded[..radius].fill(left);
            padded[radius + width..].fill(right);
            weighted(out, &padded[radius..radius + width], self.weights[0]);
            for (d, &weight) in self.weights.iter().enumerate().skip(1) {
                add_pair(out, &padded[radius - d..], &padded[radius + d..], weight);
            }
        }
        let blurred_row = |y: usize| &blurred[(y - first_lap) * width..(y - first_lap + 1) * width];

        let mut out = vec![0.0f32; width];
        for y in rows {
            weighted(&mut out, blurred_row(y), self.weights[0]);
            for (d, &weight) in self.weights.iter().enumerate().skip(1) {
                add_pair(&mut out, blurred_row(y.saturating_sub(d)), blurred_row((y + d).min(height - 1)), weight);
            }
            emit(y, grey_row(y), &out);
        }
    }
}

/// `|Laplacian|` of the middle row. Neighbours are added in pairs, so that a constant gives exactly 0.
fn laplacian(above: &[f32], middle: &[f32], below: &[f32], out: &mut [f32]) {
    let width = middle.len();
    let value = |x: usize, left: usize, right: usize| {
        ((above[x] + below[x]) + (middle[left] + middle[right]) - 4.0 * middle[x]).abs()
    };
    out[0] = value(0, 0, 1.min(width - 1));
    out[width - 1] = value(width - 1, width.saturating_sub(2), width - 1);
    if width < 3 {
        return;
    }
    let inner = out[1..width - 1].iter_mut().zip(&middle[..width - 2]).zip(&middle[2..]);
    let columns = above[1..width - 1].iter().zip(&middle[1..width - 1]).zip(&below[1..width - 1]);
    for (((out, left), right), ((above, here), below)) in inner.zip(columns) {
        *out = ((above + below) + (left + right) - 4.0 * here).abs();
    }
}

fn weighted(out: &mut [f32], values: &[f32], weight: f32) {
    for (out, value) in out.iter_mut().zip(values) {
        *out = weight * value;
    }
}

fn add_pair(out: &mut [f32], one: &[f32], other: &[f32], weight: f32) {
    for ((out, one), other) in out.iter_mut().zip(one).zip(other) {
        *out += weight * (one + other);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::Plane;

    fn speckle(x: usize, y: usize) -> f32 {
        ((x * 7919 + y * 104_729 + x * y * 31) % 251) as f32
    }

    fn all_rows(picture: &Plane<f32>, saliency: &Saliency, band: usize) -> Plane<f32> {
        let mut out = Plane::filled(picture.width, picture.height, 0.0);
        let size = (picture.width, picture.height);
        for start in (0..picture.height).step_by(band) {
            let rows = start..(start + band).min(picture.height);
            let luma = |y: usize, row: &mut [f32]| row.copy_from_slice(picture.row(y));
            saliency.rows(size, rows, luma, |y, _, values| out.row_mut(y).copy_from_slice(values));
        }
        out
    }

    #[test]
    fn it_is_the_smoothed_absolute_laplacian_with_repeated_borders() {
        let picture = Plane::from_fn(23, 17, speckle);
        let clamp = |v: i64, n: usize| v.clamp(0, n as i64 - 1) as usize;
        let at = |x: i64, y: i64| f64::from(picture.at(clamp(x, 23), clamp(y, 17)));
        let lap = |x: i64, y: i64| {
            let (x, y) = (clamp(x, 23) as i64, clamp(y, 17) as i64);
            (at(x - 1, y) + at(x + 1, y) + at(x, y - 1) + at(x, y + 1) - 4.0 * at(x, y)).abs()
        };
        let weight = |d: i64| (-(d * d) as f64 / 50.0).exp();
        let norm: f64 = (-5..=5).map(weight).sum();
        let result = all_rows(&picture, &Saliency::new(5, 5.0), 17);
        for y in 0..17i64 {
            for x in 0..23i64 {
                let mut expected = 0.0;
                for dy in -5..=5 {
                    for dx in -5..=5 {
                        expected += weight(dx) * weight(dy) / (norm * norm) * lap(x + dx, y + dy);
                    }
                }
                let got = f64::from(result.at(x as usize, y as usize));
                assert!((got - expected).abs() < 1e-3, "at {x}, {y}: {got} instead of {expected}");
            }
        }
    }

    #[test]
    fn rows_do_not_depend_on_the_band_they_are_computed_in() {
        let picture = Plane::from_fn(40, 50, speckle);
        let saliency = Saliency::new(5, 5.0);
        let whole = all_rows(&picture, &saliency, 50);
        assert_eq!(all_rows(&picture, &saliency, 7), whole);
        assert_eq!(all_rows(&picture, &saliency, 1), whole);
    }

    #[test]
    fn a_flat_picture_has_none_at_all() {
        let flat = all_rows(&Plane::filled(20, 20, 77.77), &Saliency::new(5, 5.0), 20);
        assert!(flat.data.iter().all(|&v| v == 0.0));
    }

    #[test]
    fn pictures_smaller_than_the_kernel_are_fine() {
        for (width, height) in [(1, 1), (1, 7), (2, 2), (5, 1)] {
            let picture = Plane::from_fn(width, height, speckle);
            assert!(all_rows(&picture, &Saliency::new(5, 5.0), 3).data.iter().all(|v| v.is_finite()));
        }
    }
}
