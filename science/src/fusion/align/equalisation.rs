//! Equalisation: slices that a stronger or weaker flash exposed get the brightness and colour of the slices around.
//!
//! Every method compares energies of detail, and the fourth power of an energy is a weight of the pyramid: a slice that
//! is brighter by a factor would win wherever no slice stands out, and make the whole image brighter. The factors are
//! known after the first pass, so they are applied to the stored samples before the second pass reads them. Slices
//! without a factor stay as they are.
//!
//! What a brighter slice clips is at least as bright as full scale times the factor, and at most white. In between, the
//! nearest slice without a factor tells: the sample is replaced by that slice's.

use crate::imaging::{
    Sample,
    simd::{self, Avx2},
};

/// Samples that are equalised together: whole vectors, and whole pixels of one channel and of three.
const TOGETHER: usize = 48;

/// From this share of full scale on, a sample is replaced gradually, up to full scale.
const NEARLY_CLIPPED: f32 = 0.94;

/// How a slice is equalised.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Equalisation {
    /// The factors of red, green and blue; of a grey slice the first.
    pub factors: [f32; 3],
    /// The nearest slice without factors, if there is one.
    pub beside: Option<usize>,
}

impl Equalisation {
    /// The equalisation of every slice from the factors of all.
    pub(super) fn of_slices(factors: &[Option<[f32; 3]>]) -> Vec<Option<Self>> {
        let plain = |from: usize| {
            let plain = (0..factors.len()).filter(|&slice| factors[slice].is_none());
            plain.min_by_key(|slice| slice.abs_diff(from))
        };
        let of_slice = |(slice, factors): (usize, &Option<[f32; 3]>)| {
            factors.map(|factors| Self { factors, beside: plain(slice) })
        };
        factors.iter().enumerate().map(of_slice).collect()
    }

    /// Whether the slice beside matters: whether a sample is nearly clipped.
    pub(super) fn needs_beside<S: Sample>(samples: &[S]) -> bool {
        samples.iter().max().is_some_and(|most| most.value() > knee::<S>())
    }

    /// Equalises interleaved samples of `channels` channels, 1 or 3; `beside` are those of the slice beside, or zeros.
    pub(super) fn apply<S: Sample>(&self, samples: &mut [S], beside: &[S], channels: usize) {
        let (max, knee) = (S::DEPTH.max(), knee::<S>());
        let factors: [f32; TOGETHER] = std::array::from_fn(|at| self.factors[at % channels]);
        simd::run(
            Avx2::detect(),
            #[inline(always)]
            || {
                for (samples, beside) in samples.chunks_mut(TOGETHER).zip(beside.chunks(TOGETHER)) {
                    for ((sample, beside), factor) in samples.iter_mut().zip(beside).zip(&factors) {
                        let value = sample.value();
                        let scaled = factor * value;
                        let clipped = ((value - knee) / (max - knee)).max(0.0);
                        let brighter = (beside.value() - scaled).max(0.0);
                        *sample = S::rounded(scaled + clipped * brighter);
                    }
                }
            },
        );
    }
}

fn knee<S: Sample>() -> f32 {
    NEARLY_CLIPPED * S::DEPTH.max()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_channel_has_its_factor_and_what_is_clipped_is_that_of_the_slice_beside() {
        let mut samples = [100u8, 100, 100, 0, 240, 255];
        Equalisation { factors: [0.5, 1.0, 2.0], beside: None }.apply(&mut samples, &[0; 6], 3);
        assert_eq!(samples, [50, 100, 200, 0, 240, 255]);
        let mut samples = [0u16, 40_000, 65_535, 65_535, 65_535];
        let beside = [500, 500, 500, 60_000, 65_535];
        Equalisation { factors: [0.75; 3], beside: Some(0) }.apply(&mut samples, &beside, 1);
        assert_eq!(samples, [0, 30_000, 49_151, 60_000, 65_535]);
    }

    #[test]
    fn the_slice_beside_is_the_nearest_that_has_no_factors() {
        let factors = [None, Some([0.5; 3]), Some([0.7; 3]), None, None];
        let beside = Equalisation::of_slices(&factors).into_iter().map(|slice| slice.map(|slice| slice.beside));
        assert_eq!(beside.collect::<Vec<_>>(), [None, Some(Some(0)), Some(Some(3)), None, None]);
        assert_eq!(Equalisation::of_slices(&factors[1..2]), [Some(Equalisation { factors: [0.5; 3], beside: None })]);
    }
}
