//! Fixed-point weighted sums, for 8-bit samples.
//!
//! Along x the weights are in units of 2^-13, and the sums are truncated to units of 2^-6. Along y the weights include
//! the gain and are as fine as 16 bits allow. Before rounding, the result differs by at most 0.04 levels from floating
//! point. Integer positions and constant images are exact.

use super::{PHASES, Source, kernel};
use crate::imaging::simd::Avx2;

const X_BITS: u32 = 13;
/// Vector instructions multiply bytes, so a weight along x is split into 2^7 times a high part and a signed low part.
const LOWER_BITS: u32 = 7;
/// Fractional bits that remain of the sums along x.
const LEFT_BITS: u32 = 6;
/// Maximum number of fractional bits of the weights along y.
const MOST_Y_BITS: i32 = 14;
/// Minimum number of them: larger gains use floating point.
const LEAST_Y_BITS: i32 = 11;

/// Weights for each phase, repeated as vector instructions need them.
pub(super) struct Fixed {
    x: Box<[AlongX; PHASES]>,
    /// The weight of each of the four rows, eight times.
    y: Box<[[[i16; 8]; 4]; PHASES]>,
    /// The same for grey: the weight of each row twice, row by row.
    #[cfg(target_arch = "x86_64")]
    y_of_grey: Box<[[i16; 8]; PHASES]>,
    /// Added before the final truncation, to round: half a level, and the mean loss of the truncations along x.
    half: i32,
    shift: u32,
    simd: Option<Avx2>,
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
    fn weight(&self, i: usize) -> i32 {
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

    /// Computes the pixels of `out` from the source positions `us`, `vs`.
    pub(super) fn weigh<const C: usize>(&self, source: &Source<'_, u8, C>, (us, vs): (&[i32], &[i32]), out: &mut [u8]) {
        #[cfg_attr(not(target_arch = "x86_64"), expect(unused_mut, reason = "there are kernels for x86 alone"))]
        let mut done = 0..0;
        #[cfg(target_arch = "x86_64")]
        if let Some(simd) = self.simd {
            done = match C {
                1 => super::fixed_avx2_grey::weigh(simd, self, source, (us, vs), out),
                _ => super::fixed_avx2::weigh(simd, self, source, (us, vs), out),
            };
        }
        let _ = self.simd;
        let end = us.len().min(vs.len());
        for i in (0..done.start).chain(done.end..end) {
            self.pixel(source, us[i], vs[i], &mut out[i * C..(i + 1) * C]);
        }
    }

    #[inline]
    fn pixel<const C: usize>(&self, source: &Source<'_, u8, C>, u: i32, v: i32, out: &mut [u8]) {
        let wx = &self.x[u as usize & (PHASES - 1)];
        let wy = &self.y[v as usize & (PHASES - 1)];
        let ([x, y], inside) = source.corner(u, v);
        // four rows of up to four pixels of three samples
        let mut taps = [[0u8; 12]; 4];
        for (j, taps) in taps.iter_mut().enumerate() {
            if inside {
                let start = ((y as usize + j) * source.width + x as usize) * C;
                taps[..4 * C].copy_from_slice(&source.samples[start..start + 4 * C]);
            } else {
                for (i, tap) in taps[..4 * C].chunks_exact_mut(C).enumerate() {
                    tap.copy_from_slice(source.pixel(x + i as isize, y + j as isize));
                }
            }
        }
        let mut sums = [self.half; C];
        for (j, taps) in taps.iter().enumerate() {
            for (c, sum) in sums.iter_mut().enumerate() {
                let at = |i: usize| wx.weight(i) * i32::from(taps[i * C + c]);
                let (left, right) = ((at(0) + at(1)) >> (X_BITS - LEFT_BITS), (at(2) + at(3)) >> (X_BITS - LEFT_BITS));
                *sum += i32::from(wy[j][0]) * (left + right);
            }
        }
        for (out, sum) in out.iter_mut().zip(sums) {
            *out = (sum >> self.shift).clamp(0, 255) as u8;
        }
    }

    #[cfg(target_arch = "x86_64")]
    pub(super) fn weights(&self, u: i32, v: i32) -> (&AlongX, &[[i16; 8]; 4]) {
        (&self.x[u as usize & (PHASES - 1)], &self.y[v as usize & (PHASES - 1)])
    }

    #[cfg(target_arch = "x86_64")]
    pub(super) fn grey_weights(&self, u: i32, v: i32) -> (&AlongX, &[i16; 8]) {
        (&self.x[u as usize & (PHASES - 1)], &self.y_of_grey[v as usize & (PHASES - 1)])
    }

    #[cfg(target_arch = "x86_64")]
    pub(super) fn half(&self) -> i32 {
        self.half
    }

    #[cfg(target_arch = "x86_64")]
    pub(super) fn shift(&self) -> u32 {
        self.shift
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
