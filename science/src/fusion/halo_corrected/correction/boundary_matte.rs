//! The boundary matte: how much of a pixel near an occlusion boundary shows the far part, where the decision map is
//! ambiguous.
//!
//! Let `I_a` be the slice of the near part, `I_b` that of the far part, and `D *` the blur by the disc between them.
//! Where a pixel shows the far part, `I_a` is the defocused `I_b` and looks like `D * I_b`; where it shows the near
//! part, `I_b` looks like `D * I_a`. Let `u_far` be the rms of `I_a - D * I_b` and `u_near` that of `I_b - D * I_a`,
//! in grey levels of 255. The share of the far part is
//!
//! ```text
//! m = ramp(q, 0.45, 0.8),  q = u_far / (u_far + u_near + 1.75)
//! ```
//!
//! where `ramp(x, a, b)` is 1 up to `a`, 0 from `b` on, and linear between. The rms is over the channels and over 3 x 3
//! px with binomial weights. A quotient, because the differences grow with the contrast of the texture.
//!
//! Limit: beside its outline, the blur of the near part is in `I_b`, and so in `u_far`. If the two parts differ much in
//! brightness, the share of the far part comes out too small.

use super::super::warped_slices::Patch;
use crate::imaging::{
    Rect,
    simd::{self, Avx2},
};

/// How far around a pixel the slices are compared, px.
pub(super) const REACH: usize = 1;

/// Difference that noise makes, grey levels of 255.
const NOISE: f32 = 1.75;

/// Quotient of the differences up to which the pixel shows the far part alone, and from which it shows none of it.
const FAR: f32 = 0.45;
const NEAR: f32 = 0.8;

/// The matte of a rectangle: squared differences per pixel, grey levels of 255 squared.
pub(super) struct BoundaryMatte {
    rect: Rect,
    /// Of the near slice from the blurred far slice.
    from_far: Vec<f32>,
    /// Of the far slice from the blurred near slice.
    from_near: Vec<f32>,
}

impl BoundaryMatte {
    /// The matte of `rect`, which all patches must contain. `near` are the near slice and the blurred far slice, `far`
    /// the far slice and the blurred near slice; `level` is a grey level of 255 in their scale.
    pub(super) fn new<const C: usize>(near: [&Patch<C>; 2], far: [&Patch<C>; 2], rect: Rect, level: f32) -> Self {
        Self { rect, from_far: differences(near, rect, level), from_near: differences(far, rect, level) }
    }

    /// Share of the far part at the pixel (x, y) of the canvas, 0 to 1.
    pub(super) fn far_share(&self, x: usize, y: usize) -> f32 {
        let at = (y - self.rect.y) * self.rect.width + x - self.rect.x;
        let (from_far, from_near) = (self.from_far[at].sqrt(), self.from_near[at].sqrt());
        let quotient = from_far / (from_far + from_near + NOISE);
        ((NEAR - quotient) / (NEAR - FAR)).clamp(0.0, 1.0)
    }
}

/// Mean square of the difference of two patches in `rect`, over the channels and 3 x 3 px with binomial weights, in
/// grey levels of 255 squared.
fn differences<const C: usize>([one, other]: [&Patch<C>; 2], rect: Rect, level: f32) -> Vec<f32> {
    let width = rect.width;
    let (simd, scale) = (Avx2::detect(), 1.0 / (C as f32 * level * level));
    let mut squares = vec![0.0f32; width * rect.height];
    for (y, squares) in (rect.y..).zip(squares.chunks_exact_mut(width.max(1))) {
        for channel in 0..C {
            let (one, other) = (one.row(channel, y, rect), other.row(channel, y, rect));
            simd::run(
                simd,
                #[inline(always)]
                || {
                    for ((sum, one), other) in squares.iter_mut().zip(one).zip(other) {
                        *sum += (one - other) * (one - other) * scale;
                    }
                },
            );
        }
    }
    smooth(&mut squares, width);
    squares
}

/// Smooths an image of `width` columns by the weights `1 2 1` along both axes. Beyond its border the border pixels are
/// repeated.
fn smooth(values: &mut [f32], width: usize) {
    let simd = Avx2::detect();
    let mut line = vec![0.0f32; width + 2];
    for row in values.chunks_exact_mut(width.max(1)) {
        line[1..=width].copy_from_slice(row);
        (line[0], line[width + 1]) = (row[0], row[width - 1]);
        simd::run(
            simd,
            #[inline(always)]
            || {
                for (out, around) in row.iter_mut().zip(line.windows(3)) {
                    *out = binomial(around[0], around[1], around[2]);
                }
            },
        );
    }
    // the row above, as it was
    let mut above = values.get(..width).map(<[f32]>::to_vec).unwrap_or_default();
    let rows = values.len() / width.max(1);
    for y in 0..rows {
        let (here, below) = values[y * width..].split_at_mut(width);
        line[..width].copy_from_slice(here);
        let below = if y + 1 < rows { &below[..width] } else { &line[..width] };
        simd::run(
            simd,
            #[inline(always)]
            || {
                for ((out, above), below) in here.iter_mut().zip(&above).zip(below) {
                    *out = binomial(*above, *out, *below);
                }
            },
        );
        above.copy_from_slice(&line[..width]);
    }
}

/// The mean of three neighbours with the weights `1 2 1`.
#[inline(always)]
fn binomial(before: f32, here: f32, after: f32) -> f32 {
    0.25 * (before + after) + 0.5 * here
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::{Plane, filter::disc::Disc};

    const WIDTH: usize = 80;
    const HEIGHT: usize = 40;
    /// The near part lies left of this column.
    const OUTLINE: usize = 40;

    /// A plane of values by column and row.
    fn plane(of: impl Fn(usize, usize) -> f32) -> Plane<f32> {
        let data = (0..WIDTH * HEIGHT).map(|at| of(at % WIDTH, at / WIDTH)).collect();
        Plane { width: WIDTH, height: HEIGHT, data }
    }

    /// A surface: grey levels around `mean` that vary by `contrast` from pixel to pixel.
    fn surface(mean: f32, contrast: f32, seed: usize) -> Plane<f32> {
        plane(|x, y| {
            let hash = (x * 7919 + y * 104_729 + seed * 1_299_709).wrapping_mul(2_654_435_761) >> 7;
            mean + contrast * ((hash % 1000) as f32 / 500.0 - 1.0)
        })
    }

    /// The mean share of the far part in the fourth column of pixels on the near side of the outline and in the second
    /// beyond it, for the surfaces `near` and `far` as a lens images them: in its own slice each is sharp.
    fn shares(near: &Plane<f32>, far: &Plane<f32>) -> [f32; 2] {
        let disc = Disc::new(5.0);
        let product = |a: &Plane<f32>, b: &Plane<f32>| plane(|x, y| a.at(x, y) * b.at(x, y));
        let opaque = plane(|x, _| if x < OUTLINE { 1.0 } else { 0.0 });
        let (far_blurred, spread) = (disc.blurred(far), disc.blurred(&product(near, &opaque)));
        let cover = disc.blurred(&opaque);
        let near_slice = plane(|x, y| if x < OUTLINE { near.at(x, y) } else { far_blurred.at(x, y) });
        let far_slice = plane(|x, y| far.at(x, y) * (1.0 - cover.at(x, y)) + spread.at(x, y));
        let whole = Rect::whole(WIDTH, HEIGHT);
        let slices = [near_slice, far_slice].map(|slice| Patch { rect: whole, channels: [slice] });
        let blurred = slices.each_ref().map(|slice| slice.blurred(&disc, whole));
        let matte = BoundaryMatte::new([&slices[0], &blurred[1]], [&slices[1], &blurred[0]], whole, 1.0);
        [OUTLINE - 4, OUTLINE + 1].map(|x| {
            let rows = 8..HEIGHT - 8;
            let count = rows.len() as f32;
            rows.map(|y| matte.far_share(x, y)).sum::<f32>() / count
        })
    }

    #[test]
    fn the_far_share_is_large_beyond_the_outline_and_small_on_the_near_part() {
        for (near, far, contrast) in
            [(100.0, 100.0, 30.0), (90.0, 110.0, 30.0), (110.0, 90.0, 30.0), (90.0, 110.0, 90.0)]
        {
            let shares = (0..8).map(|seed| shares(&surface(near, contrast, seed), &surface(far, contrast, seed + 8)));
            let [on_near, beyond] =
                shares.fold([0.0, 0.0], |sum, share| [sum[0] + share[0] / 8.0, sum[1] + share[1] / 8.0]);
            assert!(on_near < 0.4 && beyond > 0.7, "{near} {far} {contrast}: {on_near} {beyond}");
        }
    }

    #[test]
    fn differences_are_smoothed_along_both_axes_up_to_the_border() {
        let (zero, mut one) = (plane(|_, _| 0.0), plane(|_, _| 0.0));
        one.row_mut(2)[3] = 4.0;
        one.row_mut(20)[30] = 8.0;
        let whole = Rect::whole(WIDTH, HEIGHT);
        let [zero, one] = [zero, one].map(|plane| Patch { rect: whole, channels: [plane] });
        // the pixel (3, 2) of the canvas is the first of the rectangle
        let rect = Rect { x: 3, y: 2, width: 40, height: 30 };
        let found = differences([&zero, &one], rect, 2.0);
        let expected = |x: usize, y: usize| match (x, y) {
            (0, 0) => 4.0 * 9.0 / 16.0,
            (1, 0) | (0, 1) => 4.0 * 3.0 / 16.0,
            (1, 1) => 4.0 / 16.0,
            (27, 18) => 16.0 * 4.0 / 16.0,
            (26 | 28, 18) | (27, 17 | 19) => 16.0 * 2.0 / 16.0,
            (26 | 28, 17 | 19) => 16.0 / 16.0,
            _ => 0.0,
        };
        for (at, &found) in found.iter().enumerate() {
            let (x, y) = (at % rect.width, at / rect.width);
            assert_eq!(found, expected(x, y), "at {x} {y}");
        }
    }
}
