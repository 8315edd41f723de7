//! The overlay: a slice with its measured dots drawn on it.

use super::result::{Calibration, Dot, DotUse};
use crate::imaging::{Raster, Samples};

/// Inliers.
const GREEN: [u8; 3] = [0, 190, 60];
/// Outliers.
const RED: [u8; 3] = [235, 30, 30];
/// Dots that were not used.
const AMBER: [u8; 3] = [240, 160, 0];
/// Dots of the reference slice at their predicted positions, when the slice was predicted.
const BLUE: [u8; 3] = [30, 110, 255];

/// The slice as an 8-bit RGB image with a circle and a cross on each dot.
///
/// | colour | dots |
/// |---|---|
/// | green | inliers |
/// | red | outliers |
/// | amber | measured but not used |
/// | blue | predicted positions, in a slice whose homography was predicted |
///
/// `index` is the index of the slice; for an index beyond the calibration nothing is drawn. `slice` may be a reduced
/// copy: positions are scaled to it.
pub fn overlay(slice: &Raster, calibration: &Calibration, index: usize) -> Raster {
    let mut canvas = Canvas::new(slice);
    let (Some(profile), Some(dots)) = (calibration.slices.get(index), calibration.dots.get(index)) else {
        return canvas.picture;
    };
    let pitch = calibration.dot_pitch_px / profile.scale.max(1e-3);
    let smaller = canvas.picture.width as f64 / f64::from(calibration.width.max(1));
    let place = |p: [f64; 2]| p.map(|v| (v + 0.5) * smaller - 0.5);
    let radius = (0.33 * pitch * smaller).clamp(3.0, 200.0);
    if profile.interpolated
        && let Some(back) = profile.homography.inverse()
    {
        for dot in calibration.dots.get(calibration.reference_index).into_iter().flatten() {
            let at = match &calibration.distortion {
                None => back.apply(dot.at),
                Some(lens) => lens.distort(back.apply(lens.undistort(dot.at))),
            };
            canvas.mark(place(at), radius, BLUE);
        }
    }
    for Dot { at, used, .. } in dots {
        let colour = match used {
            DotUse::Inlier => GREEN,
            DotUse::Outlier => RED,
            DotUse::Unused => AMBER,
        };
        canvas.mark(place(*at), radius, colour);
    }
    canvas.picture
}

struct Canvas {
    picture: Raster,
}

impl Canvas {
    fn new(slice: &Raster) -> Self {
        let step = slice.channels;
        let rgb = |k: usize, value: &dyn Fn(usize) -> u8| match step {
            1 => [value(k); 3],
            _ => [value(k * step), value(k * step + 1), value(k * step + 2)],
        };
        let pixels = slice.width * slice.height;
        let samples = match &slice.samples {
            Samples::Eight(s) => (0..pixels).flat_map(|k| rgb(k, &|at| s[at])).collect(),
            Samples::Sixteen(s) => (0..pixels).flat_map(|k| rgb(k, &|at| (s[at] >> 8) as u8)).collect(),
        };
        Self { picture: Raster::eight(slice.width, slice.height, 3, samples) }
    }

    /// Draws a thin circle of `radius` px and a small cross, both centred at `at`.
    fn mark(&mut self, at: [f64; 2], radius: f64, colour: [u8; 3]) {
        if !at.iter().all(|v| v.is_finite()) {
            return;
        }
        let arm = (0.4 * radius).clamp(3.0, 12.0);
        let reach = radius + 1.5;
        let low = [at[0] - reach, at[1] - reach].map(|v| v.floor().max(0.0) as usize);
        let high = [
            ((at[0] + reach).ceil().max(-1.0) as i64).min(self.picture.width as i64 - 1),
            ((at[1] + reach).ceil().max(-1.0) as i64).min(self.picture.height as i64 - 1),
        ];
        for y in low[1] as i64..=high[1] {
            for x in low[0] as i64..=high[0] {
                let (dx, dy) = (x as f64 - at[0], y as f64 - at[1]);
                let circle = 1.0 - ((dx.hypot(dy) - radius).abs() - 0.1).max(0.0);
                let line = |across: f64, along: f64| if along.abs() <= arm { 1.0 - across.abs() } else { 0.0 };
                let coverage = circle.max(line(dx, dy)).max(line(dy, dx)).clamp(0.0, 1.0);
                if coverage > 0.0 {
                    self.blend(x as usize, y as usize, colour, coverage);
                }
            }
        }
    }

    fn blend(&mut self, x: usize, y: usize, colour: [u8; 3], coverage: f64) {
        let at = (y * self.picture.width + x) * 3;
        let Samples::Eight(samples) = &mut self.picture.samples else { return };
        for (sample, c) in samples[at..at + 3].iter_mut().zip(colour) {
            *sample = (f64::from(*sample) * (1.0 - coverage) + f64::from(c) * coverage).round() as u8;
        }
    }
}
