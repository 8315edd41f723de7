//! Source positions of red and blue where the lens has lateral colour.

use super::parts::{BLOCK, PHASES};
use crate::types::lateral_colour::{ColourDisplacement, LateralColour};

/// Position of a colour in the slice: `factor * p + offset`, with `p` the position of green.
#[derive(Debug, Clone, Copy)]
pub(super) struct ColourPosition {
    /// Index of the colour in a pixel.
    pub channel: usize,
    factor: f64,
    /// In 1/1024 px.
    offset: [f64; 2],
}

impl ColourPosition {
    /// Red and blue in a slice of `width` x `height` px.
    pub(super) fn of(colours: &LateralColour, (width, height): (usize, usize)) -> [Self; 2] {
        let of = |channel, ColourDisplacement { scale, shift_px }: ColourDisplacement| {
            let middle = [width, height].map(|length| 0.5 * (length as f64 - 1.0));
            let offset = [0, 1].map(|a| (shift_px[a] - scale * middle[a]) * PHASES as f64);
            Self { channel, factor: 1.0 + scale, offset }
        };
        [of(0, colours.red), of(2, colours.blue)]
    }

    /// The positions of the colour for the positions `us`, `vs` of green, in 1/1024 px. One that would be left of or
    /// above the slice is at its border.
    #[inline(always)]
    pub(super) fn positions(&self, green: [&[i32; BLOCK]; 2]) -> [[i32; BLOCK]; 2] {
        [0, 1].map(|a| {
            // 0.5 rounds to the nearest integer; the conversion limits what is out of range
            green[a].map(|at| (f64::from(at) * self.factor + self.offset[a] + 0.5).max(0.0) as i32)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::Warp;
    use crate::types::{
        Homography,
        distortion::Distortion,
        lateral_colour::{ColourDisplacement, LateralColour},
    };

    const SIZE: (usize, usize) = (150, 110);

    fn lens() -> LateralColour {
        LateralColour {
            red: ColourDisplacement { scale: 0.012, shift_px: [0.4, -0.3] },
            blue: ColourDisplacement { scale: -0.009, shift_px: [0.0, 0.25] },
        }
    }

    /// A smooth pattern of another shape in each colour, 0 to 1.
    fn scene(channel: usize, [x, y]: [f64; 2]) -> f64 {
        let phase = channel as f64;
        0.5 + 0.2 * (0.11 * x + phase).sin() * (0.09 * y + 0.4).cos() + 0.15 * (0.05 * (x + y) + 2.0 * phase).sin()
    }

    /// What a sensor sees of the scene: `of` maps px of the slice to px of the reference slice, for green.
    fn slice(lens: Option<&LateralColour>, of: impl Fn([f64; 2]) -> [f64; 2]) -> Vec<f64> {
        let mut samples = Vec::new();
        let middle = [SIZE.0, SIZE.1].map(|length| 0.5 * (length as f64 - 1.0));
        for k in 0..SIZE.0 * SIZE.1 {
            let seen = [(k % SIZE.0) as f64, (k / SIZE.0) as f64];
            for channel in 0..3 {
                let moved = lens.and_then(|lens| [Some(lens.red), None, Some(lens.blue)][channel]).unwrap_or_default();
                // the place of green whose colour is seen here
                let green =
                    [0, 1].map(|a| (seen[a] - moved.shift_px[a] + moved.scale * middle[a]) / (1.0 + moved.scale));
                samples.push(scene(channel, of(green)));
            }
        }
        samples
    }

    fn eight(samples: &[f64]) -> Vec<u8> {
        samples.iter().map(|v| (255.0 * v).round() as u8).collect()
    }

    fn sixteen(samples: &[f64]) -> Vec<u16> {
        samples.iter().map(|v| (65_535.0 * v).round() as u16).collect()
    }

    /// Pixels that are off by more than `limit` in a colour, without the border, where colours are missing.
    fn off<S: Copy + Into<i64>>(found: &[S], truth: &[S], warp: &Warp, limit: i64) -> (usize, usize) {
        let (mut wrong, mut compared) = (0, 0);
        for y in 5..SIZE.1 - 5 {
            for x in warp.coverage().span(y).filter(|x| (5..SIZE.0 - 5).contains(x)) {
                let at = 3 * (y * SIZE.0 + x);
                let difference = |c: usize| (found[at + c].into() - truth[at + c].into()).abs();
                wrong += usize::from((0..3).any(|c| difference(c) > limit));
                compared += 1;
            }
        }
        (wrong, compared)
    }

    #[test]
    fn red_and_blue_come_to_where_green_is() {
        let turn = Homography([1.02, 0.008, -1.0, -0.009, 1.03, -1.2, 1e-5, -1e-5, 1.0]);
        let truth = slice(None, |p| p);
        let distortion = Distortion { centre_px: [74.0, 56.0], k1: 0.03, k2: 0.0, radius_px: 92.0 };
        for homography in [Homography::IDENTITY, turn] {
            for bent in [None, Some(distortion)] {
                let of = |p: [f64; 2]| match &bent {
                    Some(bent) => bent.distort(homography.apply(bent.undistort(p))),
                    None => homography.apply(p),
                };
                let seen = slice(Some(&lens()), of);
                let plain = Warp::with_distortion(&homography, 1.0, SIZE, bent.as_ref()).expect("valid");
                let warp = plain.clone().with_lateral_colour(Some(&lens())).expect("valid");
                let (wide, narrow) = (warp.apply(sixteen(&seen), 3), warp.apply(eight(&seen), 3));
                // 0.02 px at the steepest slope, and the rounding of 8 bits
                let (wrong, compared) = off(&wide, &sixteen(&truth), &warp, 40);
                assert!(wrong == 0 && compared > 12_000, "{wrong} of {compared}: {homography:?}, {bent:?}");
                assert_eq!(off(&narrow, &eight(&truth), &warp, 1).0, 0);
                // the same bits without vector instructions
                assert_eq!(warp.clone().portable().apply(sixteen(&seen), 3), wide);
                assert_eq!(warp.clone().portable().apply(eight(&seen), 3), narrow);
                // without the correction the colours are apart, and green is the same
                let uncorrected = plain.apply(sixteen(&seen), 3);
                assert!(off(&uncorrected, &sixteen(&truth), &plain, 40).0 > compared / 2);
                assert!(uncorrected.iter().skip(1).step_by(3).eq(wide.iter().skip(1).step_by(3)));
            }
        }
    }

    #[test]
    fn grey_slices_and_lenses_without_lateral_colour_are_not_changed() {
        let turn = Homography::similarity(1.02, [1.0, -2.0]);
        let warp = Warp::new(&turn, 1.1, SIZE, SIZE).expect("regular");
        let samples = eight(&slice(None, |p| p));
        let corrected = warp.clone().with_lateral_colour(Some(&lens())).expect("valid");
        let grey: Vec<u8> = samples.iter().step_by(3).copied().collect();
        assert_eq!(corrected.apply(grey.clone(), 1), warp.apply(grey, 1));
        let none = LateralColour { red: ColourDisplacement::default(), blue: ColourDisplacement::default() };
        for none in [None, Some(&none)] {
            let same = warp.clone().with_lateral_colour(none).expect("valid");
            assert_eq!(same.apply(samples.clone(), 3), warp.apply(samples.clone(), 3));
        }
        let impossible = LateralColour { red: ColourDisplacement { scale: 0.5, shift_px: [0.0; 2] }, ..lens() };
        assert!(warp.with_lateral_colour(Some(&impossible)).is_none());
    }
}
