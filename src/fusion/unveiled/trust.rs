//! Where the labelled picture is believed, and where the one put together from pyramids is.
//!
//! Labels put whole slices side by side. That is right where they say from what the veil was taken, and it has the least
//! noise; but where slices differ in what is far out of focus in all of them, their borders would show as seams. Pyramids
//! have no seams, but halos. So the labelled picture is taken where the veil was taken off it, and where both agree in all
//! that is coarser than a few pixels, so that no seam can be there; elsewhere, and where only the pyramids have kept a
//! fine line, or only the labels are frayed, theirs is.

use crate::imaging::{
    Plane, Rect, Sample,
    filter::focus::{FocusEnergy, Rows},
    grey,
};

/// Side of the two means, one after the other, that tell where a veil was taken off, px.
const VEIL_SIDE: usize = 9;

/// Mean veil, grey levels of 255, from which the labelled picture is taken wholly.
const VEIL: f32 = 3.0;

/// Side of the two means, one after the other, of what differs between the pictures, px: their noise is left out ...
const COARSE_SIDE: usize = 9;
/// ... and of the mean of its size: a seam differs to both sides of it.
const AROUND_SIDE: usize = 19;

/// Difference, grey levels of 255, up to which the pictures agree, and from which they do not at all.
const AGREED: f32 = 0.75;
const DIFFERENT: f32 = 1.5;

/// How far around a pixel it is looked, px.
pub(super) const REACH: usize = 2 * (COARSE_SIDE / 2) + AROUND_SIDE / 2;

/// Fine energy of the pyramids' picture over that of the labelled one from which it has kept more (wholly, from e times as
/// much), and the energy, squared grey levels, that counts as none.
const FINER: f32 = 1.3;
const NONE: f32 = 0.5;

/// The other way round: from this share on the labelled picture is frayed, which is no detail.
const ROUGHER: f32 = 1.5;

/// Two pictures of the rectangle `window`, interleaved samples of `C` channels.
pub(super) struct Pair<'a, S> {
    pub window: Rect,
    pub labelled: &'a [S],
    pub pyramids: &'a [S],
    /// What taking off the veil has changed, in the scale of the samples.
    pub veil: &'a [f32],
}

impl<S: Sample> Pair<'_, S> {
    /// The samples of `rect`, which is at least [`REACH`] inside the window where that does not end at the canvas's rim.
    pub fn mixed<const C: usize>(&self, rect: Rect, rows: &mut Rows, out: &mut Vec<S>) {
        let shares = self.shares::<C>(rows);
        let (left, top) = (rect.x - self.window.x, rect.y - self.window.y);
        out.clear();
        out.reserve(rect.width * rect.height * C);
        for y in top..top + rect.height {
            for x in left..left + rect.width {
                let share = shares.at(x, y);
                let at = (y * self.window.width + x) * C;
                for (labelled, pyramids) in self.labelled[at..at + C].iter().zip(&self.pyramids[at..at + C]) {
                    let from = pyramids.value();
                    out.push(S::rounded(from + share * (labelled.value() - from)));
                }
            }
        }
    }

    /// How much of the labelled picture each pixel of the window gets.
    fn shares<const C: usize>(&self, rows: &mut Rows) -> Plane<f32> {
        let (width, height) = (self.window.width, self.window.height);
        let level = S::DEPTH.max() / 255.0;
        // whole numbers, so that sums do not depend on where they begin
        let veil = self.veil.iter().map(|&veil| (16.0 * veil.min(64.0 * level) / level) as i64).collect();
        let veil = smoothed(veil, width, height, VEIL_SIDE, 2);
        let veil_scale = 1.0 / (16 * VEIL_SIDE.pow(4)) as f32;
        let mut different = vec![0i64; width * height];
        for channel in 0..C {
            let of_channel = |samples: &[S], at: usize| samples[at * C + channel].value() as i64;
            let difference = |at| of_channel(self.labelled, at) - of_channel(self.pyramids, at);
            let coarse = smoothed((0..width * height).map(difference).collect(), width, height, COARSE_SIDE, 2);
            different.iter_mut().zip(coarse).for_each(|(most, coarse)| *most = (*most).max(coarse.abs()));
        }
        let different = smoothed(different, width, height, AROUND_SIDE, 1);
        let scale = 1.0 / ((COARSE_SIDE.pow(4) * AROUND_SIDE.pow(2)) as f32 * level);
        let [labelled, pyramids] = [self.labelled, self.pyramids].map(|samples| {
            let mut luma = Plane::filled(width, height, 0.0f32);
            grey::luma_row(samples, C, &mut luma.data);
            FocusEnergy::fine().plane(&luma, rows)
        });
        Plane::from_fn(width, height, |x, y| {
            let at = y * width + x;
            let unveiled = (veil[at] as f32 * veil_scale / VEIL).min(1.0);
            let agreed = ((DIFFERENT - different[at] as f32 * scale) / (DIFFERENT - AGREED)).clamp(0.0, 1.0);
            let finer = ((pyramids.at(x, y) + NONE) / (labelled.at(x, y) + NONE) / FINER).ln();
            let rougher = ((labelled.at(x, y) + NONE) / (pyramids.at(x, y) + NONE) / ROUGHER).ln();
            unveiled.max(agreed) * (1.0 - finer.clamp(0.0, 1.0)) * (1.0 - rougher.clamp(0.0, 1.0))
        })
    }
}

/// Sums over squares of `side` px, so many times over: `side^(2 times)` times the mean. The border is repeated.
fn smoothed(mut values: Vec<i64>, width: usize, height: usize, side: usize, times: usize) -> Vec<i64> {
    let half = side / 2;
    let mut line = Vec::new();
    for _ in 0..times {
        for row in values.chunks_exact_mut(width) {
            line.clear();
            line.extend_from_slice(row);
            let at = |x: usize, steps: isize| line[x.saturating_add_signed(steps).min(width - 1)];
            let mut sum: i64 = (-(half as isize)..half as isize).map(|steps| at(0, steps)).sum();
            for (x, out) in row.iter_mut().enumerate() {
                sum += at(x, half as isize);
                *out = sum;
                sum -= at(x, -(half as isize));
            }
        }
        let above = values.clone();
        let row = |y: usize, steps: isize| {
            let y = y.saturating_add_signed(steps).min(height - 1);
            &above[y * width..(y + 1) * width]
        };
        let mut sums = vec![0i64; width];
        for steps in -(half as isize)..half as isize {
            sums.iter_mut().zip(row(0, steps)).for_each(|(sum, value)| *sum += value);
        }
        for (y, out) in values.chunks_exact_mut(width).enumerate() {
            let (entering, leaving) = (row(y, half as isize), row(y, -(half as isize)));
            for (((out, sum), entering), leaving) in out.iter_mut().zip(&mut sums).zip(entering).zip(leaving) {
                *sum += entering;
                *out = *sum;
                *sum -= leaving;
            }
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 80;

    fn mixed(labelled: &[u8], pyramids: &[u8], veil: &[f32], rect: Rect) -> Vec<u8> {
        let window = rect.grown(REACH + FocusEnergy::fine().reach(), SIDE, SIDE);
        let cut = |x: usize, y: usize| (window.y + y) * SIDE + window.x + x;
        let places = || (0..window.height).flat_map(|y| (0..window.width).map(move |x| (x, y)));
        let samples = |of: &[u8]| places().map(|(x, y)| of[cut(x, y)]).collect::<Vec<u8>>();
        let veil: Vec<f32> = places().map(|(x, y)| veil[cut(x, y)]).collect();
        let (labelled, pyramids) = (samples(labelled), samples(pyramids));
        let pair = Pair { window, labelled: &labelled, pyramids: &pyramids, veil: &veil };
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
        let out = mixed(&seam, &smooth, &[0.0; SIDE * SIDE], WHOLE);
        assert!(out.chunks_exact(SIDE).all(|row| row.windows(2).all(|two| two[0].abs_diff(two[1]) <= 2)));
    }

    #[test]
    fn where_both_agree_the_one_with_less_noise_is_taken() {
        let noisy = picture(|x, y| 101 + u8::from((x * 7 + y * 13) % 11 == 0));
        let (calm, veil) = (picture(|_, _| 101), [0.0; SIDE * SIDE]);
        let kept = mixed(&calm, &noisy, &veil, WHOLE).iter().filter(|&&v| v != 101).count();
        let noise = noisy.iter().filter(|&&v| v != 101).count();
        assert!(kept * 4 < noise, "{kept} of {noise}");
    }

    #[test]
    fn where_a_veil_was_taken_off_the_picture_without_it_is_taken() {
        let (without, with) = (picture(|_, _| 60), picture(|_, _| 90));
        let veil: Vec<f32> = (0..SIDE * SIDE).map(|at| if at % SIDE < 40 { 30.0 } else { 0.0 }).collect();
        let out = mixed(&without, &with, &veil, WHOLE);
        assert!(out.chunks_exact(SIDE).all(|row| row[20] == 60 && row[70] == 90));
    }

    #[test]
    fn a_fine_line_that_only_the_pyramids_have_kept_stays() {
        let (without, with) = (picture(|_, _| 120), picture(|x, _| if x == 40 { 60 } else { 120 }));
        assert!(mixed(&without, &with, &[0.0; SIDE * SIDE], WHOLE).chunks_exact(SIDE).all(|row| row[40] < 66));
    }

    #[test]
    fn a_part_of_a_picture_is_mixed_as_the_whole_is() {
        let hash = |x: usize, y: usize| ((x * 7919 + y * 104_729) >> 3) % 97;
        let (one, other) = (picture(|x, y| 90 + hash(x, y) as u8 / 9), picture(|x, y| 91 + hash(y, x) as u8 / 8));
        let veil: Vec<f32> = (0..SIDE * SIDE).map(|at| (hash(at % SIDE, 5) % 3) as f32).collect();
        let whole = mixed(&one, &other, &veil, WHOLE);
        let rect = Rect { x: 31, y: 3, width: 20, height: 17 };
        let part = mixed(&one, &other, &veil, rect);
        for (y, row) in part.chunks_exact(rect.width).enumerate() {
            assert_eq!(row, &whole[(rect.y + y) * SIDE + rect.x..][..rect.width]);
        }
    }
}
