//! Floating-point weighted sums, for 16-bit samples and for any gain.

use super::parts::{PHASES, Source, kernel};
use crate::imaging::{
    Sample,
    simd::{self, Avx2},
};

/// Four weights for each phase. The gain is applied last.
pub(super) struct Float {
    weights: Box<[[f32; 4]; PHASES]>,
    gain: f32,
    simd: Option<Avx2>,
}

impl Float {
    pub(super) fn new(gain: f64, simd: Option<Avx2>) -> Self {
        let mut weights = Box::new([[0.0; 4]; PHASES]);
        for (out, weights) in weights.iter_mut().zip(kernel()) {
            *out = weights.map(|weight| weight as f32);
        }
        Self { weights, gain: gain as f32, simd }
    }

    /// Computes the pixels of `out` from the source positions `us`, `vs`.
    pub(super) fn weigh<S: Sample, const C: usize>(
        &self,
        source: &Source<'_, S, C>,
        (us, vs): (&[i32], &[i32]),
        out: &mut [S],
    ) {
        #[cfg_attr(not(target_arch = "x86_64"), expect(unused_mut, reason = "there are kernels for x86 alone"))]
        let mut done = 0..0;
        #[cfg(target_arch = "x86_64")]
        if let Some(simd) = self.simd {
            done = super::float_avx2::weigh(simd, (&self.weights, self.gain), source, (us, vs), out);
        }
        let end = us.len().min(vs.len());
        for part in [0..done.start, done.end..end] {
            let places = us[part.clone()].iter().zip(&vs[part.clone()]);
            let out = &mut out[part.start * C..part.end * C];
            simd::run(
                self.simd,
                #[inline(always)]
                || {
                    for (out, (&u, &v)) in out.chunks_exact_mut(C).zip(places) {
                        let value = self.at(source, u, v);
                        for (sample, value) in out.iter_mut().zip(value) {
                            *sample = S::rounded(value * self.gain);
                        }
                    }
                },
            );
        }
    }

    #[inline(always)]
    fn at<S: Sample, const C: usize>(&self, source: &Source<'_, S, C>, u: i32, v: i32) -> [f32; C] {
        let (weights_x, weights_y) =
            (&self.weights[u as usize & (PHASES - 1)], &self.weights[v as usize & (PHASES - 1)]);
        let ([x, y], inside) = source.corner(u, v);
        // columns first: the 4 x C samples of a row are contiguous; the array holds up to three channels
        let mut columns = [0.0f32; 12];
        for (j, &weight) in weights_y.iter().enumerate() {
            if inside {
                let start = ((y as usize + j) * source.width + x as usize) * C;
                let row = &source.samples[start..start + 4 * C];
                match row.first_chunk::<12>() {
                    Some(row) if C == 3 => add(&mut columns, weight, row),
                    _ => add(&mut columns[..4 * C], weight, row),
                }
            } else {
                for i in 0..4 {
                    let pixel = source.pixel(x + i as isize, y + j as isize);
                    add(&mut columns[i * C..(i + 1) * C], weight, pixel);
                }
            }
        }
        let mut value = [0.0f32; C];
        for (weight, column) in weights_x.iter().zip(columns.chunks_exact(C)) {
            for (value, column) in value.iter_mut().zip(column) {
                *value += weight * column;
            }
        }
        value
    }
}

#[inline(always)]
fn add<S: Sample>(sums: &mut [f32], weight: f32, samples: &[S]) {
    for (sum, sample) in sums.iter_mut().zip(samples) {
        *sum += weight * sample.value();
    }
}
