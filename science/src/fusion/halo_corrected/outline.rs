//! How much of a pixel beside an outline is the far part's, where its label does not say.
//!
//! The label of a near part reaches over its outline. What of it is the far part's tells the slice in which the near part
//! is sharp: beside the outline it shows the far part alone, blurred, so it looks like the blurred slice of the far part;
//! on the near part it does not. How much it looks unlike it is compared with the most around, because the blur that the
//! near part lays over the far slice is in the blurred one too.

use crate::imaging::{
    Plane,
    simd::{self, Avx2},
};

/// How far around a pixel the most is looked for, px.
pub(super) const REACH: usize = 4;

/// Difference that noise makes, grey levels of 255.
const NOISE: f32 = 1.75;

/// Share of the most from which less than all of the far part's detail is taken, and from which none.
const ALL: f32 = 0.2;
const NONE: f32 = 1.1;

/// Distance of what is surely the far part's, px, from which less than all of its detail is taken, and from which none.
const CLOSE: f32 = 2.0;
const AWAY: f32 = 8.0;

/// What of a rectangle is the far part's.
pub(super) struct Outline {
    /// Squared differences between the slice of the near part and the blurred one of the far part, grey levels of 255.
    unlike: Vec<f32>,
    /// The largest of them within [`REACH`].
    most: Vec<f32>,
}

impl Outline {
    /// Between the slice of the near part and the blurred one of the far part; `level` is a grey level of 255 in their
    /// scale.
    pub(super) fn between<const C: usize>(near: &[Plane<f32>; C], far: &[Plane<f32>; C], level: f32) -> Self {
        let (width, height) = near.first().map_or((0, 0), |plane| (plane.width, plane.height));
        let (simd, scale) = (Avx2::detect(), 1.0 / (C as f32 * level * level));
        let mut unlike = vec![0.0f32; width * height];
        for (near, far) in near.iter().zip(far) {
            simd::run(
                simd,
                #[inline(always)]
                || {
                    for ((sum, near), far) in unlike.iter_mut().zip(&near.data).zip(&far.data) {
                        *sum += (near - far) * (near - far) * scale;
                    }
                },
            );
        }
        let most = largest_around(&unlike, width, height, simd);
        Self { unlike, most }
    }

    /// How much of the far part's detail is taken, 0 to 1, at place `at` of the rectangle, `away` px from what is surely the
    /// far part's.
    pub(super) fn far_detail(&self, at: usize, away: f32) -> f32 {
        let unlike = self.unlike[at].sqrt() / (self.most[at].sqrt() + NOISE);
        let far = ((NONE - unlike) / (NONE - ALL)).clamp(0.0, 1.0);
        far * ((AWAY - away) / (AWAY - CLOSE)).clamp(0.0, 1.0)
    }
}

/// The largest value in the square of [`REACH`] around each place.
fn largest_around(values: &[f32], width: usize, height: usize, simd: Option<Avx2>) -> Vec<f32> {
    let mut out = vec![0.0f32; values.len()];
    // no value is below 0
    let mut down = vec![0.0f32; width + 2 * REACH];
    for (y, out) in out.chunks_exact_mut(width.max(1)).enumerate() {
        let rows = y.saturating_sub(REACH)..(y + REACH + 1).min(height);
        simd::run(
            simd,
            #[inline(always)]
            || {
                let inner = &mut down[REACH..REACH + width];
                inner.fill(0.0);
                for row in rows {
                    let values = &values[row * width..(row + 1) * width];
                    inner.iter_mut().zip(values).for_each(|(most, &value)| *most = value.max(*most));
                }
                for by in 0..2 * REACH + 1 {
                    out.iter_mut().zip(&down[by..]).for_each(|(most, &value)| *most = value.max(*most));
                }
            },
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A near part left of column 20, before a far part with stripes; as their slices show them, the far one blurred.
    fn sides() -> Outline {
        let plane = |of: fn(usize) -> f32| {
            let data = (0..40 * 30).map(|at| of(at % 40)).collect();
            [Plane { width: 40, height: 30, data }]
        };
        let near = plane(|x| if x < 20 { 30.0 } else { 120.0 });
        let far = plane(|x| if x < 15 { 80.0 } else { 110.0 });
        Outline::between(&near, &far, 1.0)
    }

    #[test]
    fn beyond_the_outline_the_far_part_s_detail_is_taken_and_on_the_near_part_little() {
        let outline = sides();
        let row = 10 * 40;
        assert!(outline.far_detail(row + 22, 1.0) > 0.95);
        assert!(outline.far_detail(row + 18, 1.0) < 0.2);
    }

    #[test]
    fn the_farther_away_the_far_part_surely_is_the_less_of_its_detail_is_taken() {
        let outline = sides();
        let at = |away: f32| outline.far_detail(10 * 40 + 22, away);
        assert!(at(1.0) > at(4.0) && at(4.0) > at(6.0));
        assert_eq!(at(9.0), 0.0);
    }

    #[test]
    fn the_largest_around_is_that_of_the_square() {
        let values: Vec<f32> = (0..23 * 17).map(|at| ((at * 7919 + 13) % 101) as f32).collect();
        let largest = largest_around(&values, 23, 17, Avx2::detect());
        for y in 0..17usize {
            for x in 0..23usize {
                let rows = y.saturating_sub(REACH)..(y + REACH + 1).min(17);
                let of_row = |row: usize| values[row * 23..][x.saturating_sub(REACH)..(x + REACH + 1).min(23)].to_vec();
                let most = rows.flat_map(of_row).fold(0.0, f32::max);
                assert_eq!(largest[y * 23 + x], most);
            }
        }
    }
}
