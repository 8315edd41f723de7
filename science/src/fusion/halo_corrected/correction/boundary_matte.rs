//! The boundary matte: how much of a pixel near an occlusion boundary shows the far part, where the decision map is
//! ambiguous.
//!
//! Let `I_a` be the slice of the near part and `D * I_b` the blurred slice of the far part. Beside the outline, `I_a`
//! shows the far part alone, defocused: it looks like `D * I_b`. On the near part it does not. With the difference
//! `u = rms over channels of I_a - D * I_b`, in grey levels of 255, the dissimilarity of a pixel is
//! `x = u / (max of u within 4 px + 1.75)`. It is relative to the surroundings because `D * I_b` contains the blur of
//! the near part too.

use super::sliding_maximum::sliding_maximum;
use crate::imaging::{
    Plane, Rect,
    simd::{self, Avx2},
};

/// How far around a pixel the largest difference is searched, px.
pub(super) const REACH: usize = 4;

/// Difference that noise makes, grey levels of 255.
const NOISE: f32 = 1.75;

/// Dissimilarity up to which the pixel shows the far part alone, and from which it shows none of it.
const ALIKE: f32 = 0.2;
const UNLIKE: f32 = 1.1;

/// Distance of the nearest textured far pixel, px, up to which its part is believed to reach here, and from which it
/// does not.
const NEAR: f32 = 2.0;
const AWAY: f32 = 8.0;

/// The matte of a rectangle.
pub(super) struct BoundaryMatte {
    /// Mean over channels of the squared difference, grey levels of 255 squared.
    squared: Vec<f32>,
    /// The largest of them within [`REACH`].
    largest: Vec<f32>,
}

impl BoundaryMatte {
    /// `near` are the channels of the near slice, `blurred` those of the blurred far slice; `level` is a grey level of
    /// 255 in their scale.
    pub(super) fn new<const C: usize>(near: &[Plane<f32>; C], blurred: &[Plane<f32>; C], level: f32) -> Self {
        let (width, height) = near.first().map_or((0, 0), |plane| (plane.width, plane.height));
        let (simd, scale) = (Avx2::detect(), 1.0 / (C as f32 * level * level));
        let mut squared = vec![0.0f32; width * height];
        for (near, far) in near.iter().zip(blurred) {
            simd::run(
                simd,
                #[inline(always)]
                || {
                    for ((sum, near), far) in squared.iter_mut().zip(&near.data).zip(&far.data) {
                        *sum += (near - far) * (near - far) * scale;
                    }
                },
            );
        }
        let whole = Rect::whole(width, height);
        let largest = sliding_maximum::<f32, REACH>(&squared, whole, whole);
        Self { squared, largest }
    }

    /// Share of the far part at index `at` of the rectangle, 0 to 1, when the nearest textured far pixel is at
    /// `distance` px.
    pub(super) fn far_share(&self, at: usize, distance: f32) -> f32 {
        let dissimilarity = self.squared[at].sqrt() / (self.largest[at].sqrt() + NOISE);
        let far = ((UNLIKE - dissimilarity) / (UNLIKE - ALIKE)).clamp(0.0, 1.0);
        far * ((AWAY - distance) / (AWAY - NEAR)).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A near part left of column 20 in front of a far part with stripes, as the near slice and the blurred far slice
    /// show them.
    fn matte() -> BoundaryMatte {
        let plane = |of: fn(usize) -> f32| {
            let data = (0..40 * 30).map(|at| of(at % 40)).collect();
            [Plane { width: 40, height: 30, data }]
        };
        let near = plane(|x| if x < 20 { 30.0 } else { 120.0 });
        let far = plane(|x| if x < 15 { 80.0 } else { 110.0 });
        BoundaryMatte::new(&near, &far, 1.0)
    }

    #[test]
    fn the_far_share_is_large_beyond_the_outline_and_small_on_the_near_part() {
        let matte = matte();
        let row = 10 * 40;
        assert!(matte.far_share(row + 22, 1.0) > 0.95);
        assert!(matte.far_share(row + 18, 1.0) < 0.2);
    }

    #[test]
    fn the_far_share_falls_with_the_distance_of_the_far_part() {
        let matte = matte();
        let at = |distance: f32| matte.far_share(10 * 40 + 22, distance);
        assert!(at(1.0) > at(4.0) && at(4.0) > at(6.0));
        assert_eq!(at(9.0), 0.0);
    }
}
