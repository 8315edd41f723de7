//! Where the labelled picture is believed, and where the one put together from pyramids is.
//!
//! Labels put whole slices side by side. That is right where they say from what the veil was taken, and it has the least
//! noise; but where slices differ in what is far out of focus in all of them, their borders would show as seams. Pyramids
//! have no seams, but halos. So the labelled picture is taken where the veil was taken off it; where both agree in all that is
//! coarser than a few pixels, so that no seam can be there, both are, because their noise is not the same; elsewhere, and
//! where only the pyramids have kept a fine line, or only the labels are frayed, theirs is.
//!
//! Labels go astray where nothing is sharp in any slice, and what is taken off them there is no veil. It shows: where a veil
//! was taken off, the pyramids' picture has all of the veil, or part of it, or none. So where it is not between the labelled
//! picture before and after that, it is taken.

use super::squares::{Squares, Whole};
use crate::imaging::{
    Plane, Rect, Sample,
    filter::focus::{FocusEnergy, Rows},
    grey,
    simd::{self, Avx2},
};

/// Side of the two means, one after the other, that tell where a veil was taken off, px.
const VEIL_SIDE: usize = 9;

/// Mean veil, grey levels of 255, from which the labelled picture is taken wholly.
const VEIL: f32 = 3.0;

/// How far from what lies between both, grey levels of 255, the pyramids' picture may be for that, and from where on it is
/// taken wholly; both more by that share of the veil.
const BETWEEN: f32 = 2.0;
const BEYOND: f32 = 4.0;
const OF_VEIL: f32 = 0.2;

/// Side of the two means, one after the other, of what differs between the pictures, px: their noise is left out ...
const COARSE_SIDE: usize = 9;
/// ... and of the mean of its size: a seam differs to both sides of it.
const AROUND_SIDE: usize = 19;

/// Difference, grey levels of 255, up to which the pictures agree, and from which they do not at all.
const AGREED: f32 = 1.5;
const DIFFERENT: f32 = 3.0;

/// Share of the labelled picture where both agree: half of each has the least noise where there is no detail. Where there is
/// much, one slice is better than many; the energy, squared grey levels, at which the share is in the middle.
const EVEN: f32 = 0.45;
const DETAILED: f32 = 0.9;
const DETAIL: f32 = 20.0;

/// How far around a pixel differences are looked at, px; energies see less than that.
pub(super) const REACH: usize = 2 * (COARSE_SIDE / 2) + AROUND_SIDE / 2;

/// Fine energy of the pyramids' picture over that of the labelled one from which it has kept more (wholly, from e times as
/// much), and the energy, squared grey levels, that counts as none.
const FINER: f32 = 1.3;
const NONE: f32 = 0.5;

/// The other way round: from this share on the labelled picture is frayed, which is no detail. Where there is none, and
/// where there is much: among detail labels have more of it than pyramids have, and nobody sees what is frayed.
const ROUGHER: f32 = 1.2;
const ROUGHER_IN_DETAIL: f32 = 2.7;
/// Energy, squared grey levels, of the pyramids' picture at which it is in the middle.
const SOME: f32 = 5.0;

/// Two pictures of the rectangle `window`, interleaved samples of `C` channels.
pub(super) struct Pair<'a, S> {
    pub window: Rect,
    pub labelled: &'a [S],
    /// The samples of `labelled` before they were rounded, so that what is mixed is rounded once.
    pub values: &'a [f32],
    /// The samples of the labelled picture before the veil was taken off.
    pub veiled: &'a [S],
    pub pyramids: &'a [S],
    /// What taking off the veil has changed, in the scale of the samples.
    pub veil: &'a [f32],
}

impl<S: Sample> Pair<'_, S> {
    /// The samples of `rect`, which is at least [`REACH`] inside the window where that does not end at the canvas's rim.
    pub(super) fn mixed<const C: usize>(&self, rect: Rect, rows: &mut Rows, out: &mut Vec<S>) {
        let shares = self.shares::<C>(rows);
        let (left, top) = (rect.x - self.window.x, rect.y - self.window.y);
        out.resize(rect.width * rect.height * C, S::default());
        for (y, out) in (top..).zip(out.chunks_exact_mut(rect.width * C)) {
            let at = (y * self.window.width + left) * C..(y * self.window.width + left + rect.width) * C;
            let (values, pyramids) = (&self.values[at.clone()], &self.pyramids[at]);
            let shares = &shares.row(y)[left..left + rect.width];
            simd::run(
                Avx2::detect(),
                #[inline(always)]
                || mix::<S, C>(values, pyramids, shares, out),
            );
        }
    }

    /// How much of the labelled picture each pixel of the window gets.
    fn shares<const C: usize>(&self, rows: &mut Rows) -> Plane<f32> {
        match S::BYTES {
            // no sum is larger than 3 * 255 * 9^4 * 19^2
            1 => self.shares_by::<i32, C>(rows),
            _ => self.shares_by::<i64, C>(rows),
        }
    }

    /// The same with sums of kind `N`.
    fn shares_by<N: Whole, const C: usize>(&self, rows: &mut Rows) -> Plane<f32> {
        let (width, height) = (self.window.width, self.window.height);
        let level = S::DEPTH.max() / 255.0;
        let mut squares = Squares::of(width, height);
        // whole numbers, so that sums do not depend on where they begin
        let mut veil: Vec<N> =
            self.veil.iter().map(|&veil| N::from((16.0 * veil.min(64.0 * level) / level) as i32)).collect();
        let mut spare = Vec::new();
        squares.smooth(&mut veil, &mut spare, VEIL_SIDE, 2);
        let veil_scale = 1.0 / (16 * VEIL_SIDE.pow(4)) as f32;
        let any_veil = veil.iter().any(|&veil| veil > N::default());
        let [different, astray] = self.differences::<N, C>(any_veil, &mut squares, &mut spare);
        let scale = 1.0 / ((COARSE_SIDE.pow(4) * AROUND_SIDE.pow(2)) as f32 * level);
        let [labelled, pyramids] = [self.labelled, self.pyramids].map(|samples| {
            let mut luma = Plane::filled(width, height, 0.0f32);
            grey::luma_row(samples, C, &mut luma.data);
            FocusEnergy::fine().plane(&luma, rows)
        });
        // the logarithm of what is no more than 1 is not asked for
        let above = |ratio: f32| if ratio > 1.0 { ratio.ln().min(1.0) } else { 0.0 };
        let share = |(at, (labelled, pyramids)): (usize, (&f32, &f32))| {
            let veil = veil[at].value() * veil_scale;
            let astray = (astray[at].value() * scale / C as f32 - OF_VEIL * veil).max(0.0);
            let unveiled = (veil / VEIL).min(1.0) * ((BEYOND - astray) / (BEYOND - BETWEEN)).clamp(0.0, 1.0);
            let agreed = ((DIFFERENT - different[at].value() * scale) / (DIFFERENT - AGREED)).clamp(0.0, 1.0);
            let even = EVEN + (DETAILED - EVEN) * labelled / (labelled + DETAIL);
            let taken = unveiled.max(agreed * even);
            if taken == 0.0 {
                return 0.0;
            }
            let (labelled, pyramids) = (labelled + NONE, pyramids + NONE);
            let rougher = ROUGHER + (ROUGHER_IN_DETAIL - ROUGHER) * pyramids / (pyramids + SOME);
            taken * (1.0 - above(pyramids / labelled / FINER)) * (1.0 - above(labelled / pyramids / rougher))
        };
        let energies = labelled.data.iter().zip(&pyramids.data);
        Plane { width, height, data: energies.enumerate().map(share).collect() }
    }

    /// How far the pyramids' picture is, in all that is coarser than a few pixels, from the labelled one (sums of the largest
    /// of a pixel's channels), and, with a veil, from what lies between that before and after the veil was taken off (sums of
    /// all of its channels).
    fn differences<N: Whole, const C: usize>(
        &self,
        any_veil: bool,
        squares: &mut Squares<N>,
        spare: &mut Vec<N>,
    ) -> [Vec<N>; 2] {
        let nothing = || vec![N::default(); self.window.width * self.window.height];
        let (mut different, mut coarse, mut after) = (nothing(), Vec::new(), nothing());
        for channel in 0..C {
            let of_channel = |pixel: &[S]| pixel[channel].integer() as i32;
            let pixels = self.labelled.chunks_exact(C).zip(self.pyramids.chunks_exact(C));
            coarse.clear();
            coarse.extend(pixels.map(|(one, other)| N::from(of_channel(one) - of_channel(other))));
            squares.smooth(&mut coarse, spare, COARSE_SIDE, 2);
            different.iter_mut().zip(&coarse).for_each(|(most, coarse)| *most = (*most).max(coarse.size()));
            after.iter_mut().zip(&coarse).for_each(|(sum, coarse)| *sum += *coarse);
        }
        squares.smooth(&mut different, spare, AROUND_SIDE, 1);
        let mut astray = nothing();
        if any_veil {
            let all = |pixel: &[S]| pixel.iter().map(|sample| sample.integer() as i32).sum::<i32>();
            let pixels = self.veiled.chunks_exact(C).zip(self.pyramids.chunks_exact(C));
            let mut before: Vec<N> = pixels.map(|(one, other)| N::from(all(one) - all(other))).collect();
            squares.smooth(&mut before, spare, COARSE_SIDE, 2);
            let both = after.iter().zip(&before);
            astray.iter_mut().zip(both).for_each(|(astray, (&after, &before))| *astray = away(after, before));
            squares.smooth(&mut astray, spare, AROUND_SIDE, 1);
        }
        [different, astray]
    }
}

/// How far 0 is from what lies between two numbers.
fn away<N: Whole>(one: N, other: N) -> N {
    let nothing = N::default();
    match (one > nothing) == (other > nothing) {
        true => one.size().min(other.size()),
        false => nothing,
    }
}

/// Rows of both pictures, of the first as much as `shares` say.
#[inline(always)]
fn mix<S: Sample, const C: usize>(values: &[f32], pyramids: &[S], shares: &[f32], out: &mut [S]) {
    let pixels = values.as_chunks::<C>().0.iter().zip(pyramids.as_chunks::<C>().0);
    for ((out, (values, pyramids)), share) in out.as_chunks_mut::<C>().0.iter_mut().zip(pixels).zip(shares) {
        for c in 0..C {
            let from = pyramids[c].value();
            out[c] = S::rounded((from + share * (values[c] - from)).max(0.0));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 80;

    /// The labelled picture after and before the veil was taken off, mixed with that of the pyramids.
    fn mixed([labelled, veiled]: [&[u8]; 2], pyramids: &[u8], rect: Rect) -> Vec<u8> {
        let window = rect.grown(REACH.max(FocusEnergy::fine().reach()), SIDE, SIDE);
        let cut = |x: usize, y: usize| (window.y + y) * SIDE + window.x + x;
        let places = || (0..window.height).flat_map(|y| (0..window.width).map(move |x| (x, y)));
        let samples = |of: &[u8]| places().map(|(x, y)| of[cut(x, y)]).collect::<Vec<u8>>();
        let (labelled, veiled, pyramids) = (samples(labelled), samples(veiled), samples(pyramids));
        let values: Vec<f32> = labelled.iter().map(|&v| v.into()).collect();
        let veil: Vec<f32> = labelled.iter().zip(&veiled).map(|(one, other)| one.abs_diff(*other).into()).collect();
        let [labelled, veiled, pyramids] = [&labelled[..], &veiled, &pyramids];
        let pair = Pair { window, labelled, values: &values, veiled, pyramids, veil: &veil };
        let mut out = Vec::new();
        pair.mixed::<1>(rect, &mut Rows::default(), &mut out);
        out
    }

    fn picture(of: impl Fn(usize, usize) -> u8) -> Vec<u8> {
        (0..SIDE * SIDE).map(|at| of(at % SIDE, at / SIDE)).collect()
    }

    const WHOLE: Rect = Rect { x: 0, y: 0, width: SIDE, height: SIDE };

    #[test]
    fn a_seam_between_slices_of_different_brightness_does_not_show() {
        let (seam, smooth) = (picture(|x, _| if x < 40 { 100 } else { 110 }), picture(|x, _| 100 + (x / 8) as u8));
        let out = mixed([&seam; 2], &smooth, WHOLE);
        assert!(out.chunks_exact(SIDE).all(|row| row.windows(2).all(|two| two[0].abs_diff(two[1]) <= 2)));
    }

    #[test]
    fn where_both_agree_their_noise_is_averaged() {
        let hash = |x: usize, y: usize, of: usize| (((x * 7919 + y * 104_729 + of * 31_337) * 2_654_435_761) >> 16) % 7;
        let noisy = |of: usize| picture(move |x, y| 97 + hash(x, y, of) as u8);
        let spread = |picture: &[u8]| picture.iter().map(|&v| (f64::from(v) - 100.0).powi(2)).sum::<f64>();
        let (one, other) = (noisy(1), noisy(2));
        let out = mixed([&one; 2], &other, WHOLE);
        assert!(spread(&out) < 0.7 * spread(&one).min(spread(&other)), "{} of {}", spread(&out), spread(&one));
    }

    #[test]
    fn where_a_veil_was_taken_off_the_picture_without_it_is_taken() {
        let (without, pyramids) = (picture(|_, _| 60), picture(|_, _| 90));
        let with = picture(|x, _| if x < 40 { 90 } else { 60 });
        let out = mixed([&without, &with], &pyramids, WHOLE);
        assert!(out.chunks_exact(SIDE).all(|row| row[20] == 60 && row[70] == 90));
    }

    #[test]
    fn where_pyramids_have_taken_part_of_a_veil_off_the_picture_without_it_is_taken() {
        let (without, with, pyramids) = (picture(|_, _| 60), picture(|_, _| 90), picture(|_, _| 72));
        assert!(mixed([&without, &with], &pyramids, WHOLE).iter().all(|&v| v == 60));
    }

    #[test]
    fn patches_of_labels_that_have_gone_astray_are_no_veil() {
        let patch = |x: usize, y: usize| (x / 5 + y / 4).is_multiple_of(3);
        let pyramids = picture(|_, _| 90);
        let veiled = picture(|x, y| if patch(x, y) { 170 } else { 92 });
        let labelled = picture(|x, y| if patch(x, y) { 180 } else { 112 });
        assert!(mixed([&labelled, &veiled], &pyramids, WHOLE).iter().all(|&v| v.abs_diff(90) <= 2));
    }

    #[test]
    fn a_fine_line_that_only_the_pyramids_have_kept_stays() {
        let (without, with) = (picture(|_, _| 120), picture(|x, _| if x == 40 { 60 } else { 120 }));
        assert!(mixed([&without; 2], &with, WHOLE).chunks_exact(SIDE).all(|row| row[40] < 66));
    }

    #[test]
    fn a_part_of_a_picture_is_mixed_as_the_whole_is() {
        let hash = |x: usize, y: usize| ((x * 7919 + y * 104_729) >> 3) % 97;
        let (one, other) = (picture(|x, y| 90 + hash(x, y) as u8 / 9), picture(|x, y| 91 + hash(y, x) as u8 / 8));
        let before = picture(|x, y| 90 + hash(x, y) as u8 / 9 + (hash(x, 5) % 3) as u8);
        let whole = mixed([&one, &before], &other, WHOLE);
        let rect = Rect { x: 31, y: 3, width: 20, height: 17 };
        let part = mixed([&one, &before], &other, rect);
        for (y, row) in part.chunks_exact(rect.width).enumerate() {
            assert_eq!(row, &whole[(rect.y + y) * SIDE + rect.x..][..rect.width]);
        }
    }
}
