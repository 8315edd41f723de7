//! Visual information fidelity for fusion (Han, Cai, Cao and Xu, Information Fusion 14(2), 2013), from the formulas of
//! the paper.

use crate::{imaging::Plane, quality::score::same_shape};

/// Variance of the visual noise.
const NOISE: f64 = 0.005 * 255.0 * 255.0;
/// A smaller variance counts as zero.
const LEAST_VARIANCE: f64 = 1e-10;
/// Weights of the four scales, from fine to coarse.
const SCALES: [f64; 4] = [1.0, 0.0, 0.15, 1.0];

/// VIFF of a fusion of any number of sources: 1 if the fused image has the information of the sharpest source
/// everywhere, more if it is over-sharpened. Luma planes 0..255 of one size; none if the sizes differ, there is no
/// source, or the planes are too small (below about 40 px).
pub(crate) fn viff(sources: &[&Plane<f32>], fused: &Plane<f32>) -> Option<f64> {
    if sources.is_empty() || sources.iter().any(|source| !same_shape(*source, fused)) {
        return None;
    }
    let mut sources: Vec<Grid> = sources.iter().map(|source| Grid::of(source)).collect();
    let mut fused = Grid::of(fused);
    let mut quality = 0.0;
    for (k, weight) in SCALES.into_iter().enumerate() {
        let side = (1 << (4 - k)) + 1;
        let window = gaussian(side);
        if k > 0 {
            fused = fused.filtered(&window)?.halved();
            sources = sources.iter().map(|s| Some(s.filtered(&window)?.halved())).collect::<Option<_>>()?;
        }
        if weight > 0.0 {
            quality += weight * scale(&sources, &fused, &window)?;
        }
    }
    let value = quality / SCALES.iter().sum::<f64>();
    value.is_finite().then_some(value)
}

/// Information in the fused image over information in the sharpest sources, at one scale.
fn scale(sources: &[Grid], fused: &Grid, window: &[f64]) -> Option<f64> {
    let of_fused = Local::of(fused, window)?;
    let windows = of_fused.mean.data.len();
    // the source with the smallest gain is the sharpest: a blurred one needs a larger gain to explain the fused image
    let mut sharpest = vec![Channel { gain: f64::INFINITY, residue: 0.0, variance: 0.0 }; windows];
    for source in sources {
        let of_source = Local::of(source, window)?;
        let products = source.times(fused).filtered(window)?;
        for (i, best) in sharpest.iter_mut().enumerate() {
            let covariance = products.data[i] - of_source.mean.data[i] * of_fused.mean.data[i];
            let channel = Channel::of(of_source.variance[i], of_fused.variance[i], covariance);
            if channel.gain < best.gain {
                *best = channel;
            }
        }
    }
    let (mut kept, mut available) = (0.0, 0.0);
    for channel in &sharpest {
        kept += (1.0 + channel.gain * channel.gain * channel.variance / (channel.residue + NOISE)).log10() + 1e-7;
        available += (1.0 + channel.variance / NOISE).log10() + 1e-7;
    }
    Some(kept / available)
}

/// Model of a window: fused = gain * source + residue.
#[derive(Debug, Clone, Copy)]
struct Channel {
    gain: f64,
    residue: f64,
    variance: f64,
}

impl Channel {
    fn of(source: f64, fused: f64, covariance: f64) -> Self {
        let gain = covariance / (source + LEAST_VARIANCE);
        let mut channel = Self { gain, residue: fused - gain * covariance, variance: source };
        if source < LEAST_VARIANCE {
            channel = Self { gain: 0.0, residue: fused, variance: 0.0 };
        }
        if fused < LEAST_VARIANCE {
            channel.gain = 0.0;
            channel.residue = 0.0;
        }
        if channel.gain < 0.0 {
            channel.residue = fused;
            channel.gain = 0.0;
        }
        channel.residue = channel.residue.max(LEAST_VARIANCE);
        channel
    }
}

/// Mean and variance in a Gaussian window around each position.
struct Local {
    mean: Grid,
    variance: Vec<f64>,
}

impl Local {
    fn of(grid: &Grid, window: &[f64]) -> Option<Self> {
        let mean = grid.filtered(window)?;
        let squares = grid.times(grid).filtered(window)?;
        let variance = squares.data.iter().zip(&mean.data).map(|(s, m)| (s - m * m).max(0.0)).collect();
        Some(Self { mean, variance })
    }
}

fn gaussian(side: usize) -> Vec<f64> {
    let (middle, sigma) = ((side / 2) as f64, side as f64 / 5.0);
    let taps: Vec<f64> = (0..side).map(|i| (-(i as f64 - middle).powi(2) / (2.0 * sigma * sigma)).exp()).collect();
    let sum: f64 = taps.iter().sum();
    taps.into_iter().map(|tap| tap / sum).collect()
}

#[derive(Debug, Clone)]
struct Grid {
    width: usize,
    height: usize,
    data: Vec<f64>,
}

impl Grid {
    fn of(plane: &Plane<f32>) -> Self {
        let data = plane.data.iter().map(|&v| f64::from(v)).collect();
        Self { width: plane.width, height: plane.height, data }
    }

    fn times(&self, other: &Self) -> Self {
        let data = self.data.iter().zip(&other.data).map(|(a, b)| a * b).collect();
        Self { width: self.width, height: self.height, data }
    }

    /// Convolution with a separable window, where it lies entirely inside; none if it does not fit.
    // inlined into all its callers it takes the compiler four seconds
    #[inline(never)]
    fn filtered(&self, window: &[f64]) -> Option<Self> {
        let side = window.len();
        if self.width < side || self.height < side {
            return None;
        }
        let (width, height) = (self.width + 1 - side, self.height + 1 - side);
        let mut across = Vec::with_capacity(width * self.height);
        for row in self.data.chunks_exact(self.width) {
            across.extend(row.windows(side).map(|part| part.iter().zip(window).map(|(v, w)| v * w).sum::<f64>()));
        }
        let mut data = vec![0.0; width * height];
        for (y, out) in data.chunks_exact_mut(width).enumerate() {
            for (row, weight) in across[y * width..].chunks_exact(width).zip(window) {
                out.iter_mut().zip(row).for_each(|(out, value)| *out += value * weight);
            }
        }
        Some(Self { width, height, data })
    }

    /// Every other sample of every other row.
    fn halved(&self) -> Self {
        let data: Vec<f64> =
            self.data.chunks_exact(self.width).step_by(2).flat_map(|row| row.iter().step_by(2).copied()).collect();
        Self { width: self.width.div_ceil(2), height: self.height.div_ceil(2), data }
    }
}
