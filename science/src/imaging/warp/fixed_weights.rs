//! The fixed-point weights of [`super::fixed`], as the kernels read them.

use super::parts::{PHASES, kernel};
use crate::imaging::simd::Avx2;

pub(super) const X_BITS: u32 = 13;
/// Vector instructions multiply bytes, so a weight along x is split into 2^7 times a high part and a signed low part.
const LOWER_BITS: u32 = 7;
/// Fractional bits that remain of the sums along x.
pub(super) const LEFT_BITS: u32 = 6;
/// Maximum number of fractional bits of the weights along y.
const MOST_Y_BITS: i32 = 14;
/// Minimum number of them: larger gains use floating point.
const LEAST_Y_BITS: i32 = 11;

/// Weights for each phase, repeated as vector instructions need them.
pub(super) struct Fixed {
    pub(super) x: Box<[AlongX; PHASES]>,
    /// The weight of each of the four rows, eight times.
    pub(super) y: Box<[[[i16; 8]; 4]; PHASES]>,
    /// The same for grey: the weight of each row twice, row by row.
    #[cfg(target_arch = "x86_64")]
    y_of_grey: Box<[[i16; 8]; PHASES]>,
    /// Added before the final truncation, to round: half a level, and the mean loss of the truncations along x.
    pub(super) half: i32,
    pub(super) shift: u32,
    pub(super) simd: Option<Avx2>,
}

/// `[w0 w1 w2 w3]`, four times.
#[derive(Clone, Copy)]
pub(super) struct AlongX {
    pub upper: [i8; 16],
    pub lower: [i8; 16],
}

impl AlongX {
    const NONE: Self = Self { upper: [0; 16], lower: [0; 16] };

    fn new(weights: [i16; 4]) -> Self {
        let half = 1 << (LOWER_BITS - 1);
        let upper = weights.map(|w| (w + half) >> LOWER_BITS);
        Self {
            upper: std::array::from_fn(|i| upper[i % 4] as i8),
            lower: std::array::from_fn(|i| (weights[i % 4] - (upper[i % 4] << LOWER_BITS)) as i8),
        }
    }

    #[inline(always)]
    pub(super) fn weight(&self, i: usize) -> i32 {
        (i32::from(self.upper[i]) << LOWER_BITS) + i32::from(self.lower[i])
    }
}

impl Fixed {
    /// `None` for gains that are too large.
    pub(super) fn new(gain: f64, simd: Option<Avx2>) -> Option<Self> {
        let bits = ((f64::from(i16::MAX) / gain).log2().floor()).min(f64::from(MOST_Y_BITS)) as i32;
        if bits < LEAST_Y_BITS {
            return None;
        }
        let whole = (gain * f64::from(bits).exp2()).round() as i32;
        let (mut x, mut y) = (Box::new([AlongX::NONE; PHASES]), Box::new([[[0; 8]; 4]; PHASES]));
        for ((x, y), weights) in x.iter_mut().zip(y.iter_mut()).zip(kernel()) {
            *x = AlongX::new(quantised(weights, 1 << X_BITS));
            *y = quantised(weights, whole).map(|weight| [weight; 8]);
        }
        let shift = bits as u32 + LEFT_BITS;
        #[cfg(target_arch = "x86_64")]
        let y_of_grey = Box::new(std::array::from_fn(|phase| std::array::from_fn(|i| y[phase][i / 2][0])));
        Some(Self {
            x,
            y,
            #[cfg(target_arch = "x86_64")]
            y_of_grey,
            half: (1 << (shift - 1)) + whole,
            shift,
            simd,
        })
    }

    #[cfg(target_arch = "x86_64")]
    pub(super) fn weights(&self, u: i32, v: i32) -> (&AlongX, &[[i16; 8]; 4]) {
        (&self.x[u as usize & (PHASES - 1)], &self.y[v as usize & (PHASES - 1)])
    }

    #[cfg(target_arch = "x86_64")]
    pub(super) fn grey_weights(&self, u: i32, v: i32) -> (&AlongX, &[i16; 8]) {
        (&self.x[u as usize & (PHASES - 1)], &self.y_of_grey[v as usize & (PHASES - 1)])
    }
}

/// Integer weights whose sum is exactly `whole`.
fn quantised(weights: [f64; 4], whole: i32) -> [i16; 4] {
    let mut out = weights.map(|weight| (weight * f64::from(whole)).round() as i32);
    let rest = whole - out.iter().sum::<i32>();
    // the larger middle weight absorbs the remainder best
    let middle = if out[1] >= out[2] { 1 } else { 2 };
    out[middle] += rest;
    out.map(|weight| weight as i16)
}
