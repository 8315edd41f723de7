//! Light that falls off before the blur: its effect on the phase of blurred dots.
//!
//! A lamp or a lens may light one side of each blur disc more than the other. The image is then the pattern convolved
//! with a disc of tilted brightness, and the phase of the grid's first harmonic is shifted, by
//!
//! `g r J2(k r) / (k J1(k r))`
//!
//! along the gradient, with `g` the relative gradient of the light, `r` the blur radius and `k = 2 pi / pitch`. The
//! shift grows with the blur, without limit where the harmonic vanishes (`J1(k r) = 0` at 0.61 of the pitch). Gradient
//! and blur are measured at each dot: a lamp at one side lights the two sides differently, and a tilted target is
//! blurred more at one end.
//!
//! How much of the gradient arises before the blur is unknown (vignetting of the sensor side arises after it). So the
//! dots are not corrected. The shift is an error that all dots have in common, with one unknown factor: neither
//! residuals nor the number of dots show it. Each dot keeps it as [`MeasuredDot::doubt`], and the estimate of the slice
//! gets the uncertainty that the doubts of all its dots together mean at the corners.

use super::surface::{LevelSample, Surface};
use super::{blur, detected::Detection, detected::MeasuredDot, tracked::Tracked};

/// Standard deviation of the unknown factor.
const FACTOR: f64 = 0.5;
/// The same where the pattern nearly vanishes: there the shift depends much on the shape of the blur.
const WEAK_FACTOR: f64 = 1.5;
/// Shares of the strongest modulation between which the factor grows from [`WEAK_FACTOR`] to [`FACTOR`].
const WEAK: [f64; 2] = [0.25, 0.4];
/// Largest doubt, grid steps.
const MOST: f64 = 0.3;
/// Fewest dots by which light and blur are mapped.
const MIN_DOTS: usize = 12;
/// [`Surface`] settles at a hundredth of a grey level: of a logarithm or a share times this.
const LEVELS: f64 = 100.0;

/// Sets the doubt of every dot, and adds it to its standard deviation.
pub(super) fn doubt_uneven_light(tracked: &mut Tracked) {
    let maps: Vec<Option<Maps>> = tracked
        .detections
        .iter()
        .map(|d| d.as_ref().and_then(|d| Maps::of(d, tracked.width, tracked.height)))
        .collect();
    // a tilted target may be sharp nowhere in the whole of a slice, but somewhere in some slice
    let sharpest = |(d, maps): (&Option<Detection>, &Option<Maps>)| {
        let (d, maps) = (d.as_ref()?, maps.as_ref()?);
        Some(d.dots.values().map(|dot| maps.modulation(dot.at)).fold(0.0, f64::max))
    };
    let strongest = tracked.detections.iter().zip(&maps).filter_map(sharpest).fold(1e-9, f64::max);
    for (detection, maps) in tracked.detections.iter_mut().zip(&maps) {
        let (Some(detection), Some(maps)) = (detection, maps) else { continue };
        let pitch = detection.pitch;
        for dot in detection.dots.values_mut() {
            dot.doubt = maps.doubt(dot, strongest, pitch);
            dot.sigma = dot.sigma.hypot(dot.doubt[0].hypot(dot.doubt[1]));
        }
    }
}

/// Light and modulation of one slice by place.
struct Maps {
    /// `ln` of the mean light, times [`LEVELS`].
    light: Surface,
    /// Modulation, times [`LEVELS`].
    modulation: Surface,
    half: [f64; 2],
}

impl Maps {
    fn of(detection: &Detection, width: usize, height: usize) -> Option<Self> {
        let half = [width, height].map(|length| length as f64 / 2.0);
        let map = |value: &dyn Fn(&MeasuredDot) -> Option<f64>, degree| {
            let level = |dot: &MeasuredDot| {
                let [u, v] = unit(dot.at, half);
                Some(LevelSample { u, v, value: LEVELS * value(dot)? })
            };
            let levels: Vec<LevelSample> = detection.dots.values().filter_map(level).collect();
            (levels.len() >= MIN_DOTS).then(|| Surface::fit(&levels, degree, None))
        };
        let light = map(&|dot| dot.light.linear_mean.filter(|mean| *mean > 1e-4).map(f64::ln), 3)?;
        Some(Self { light, modulation: map(&|dot| Some(dot.modulation), 2)?, half })
    }

    fn modulation(&self, at: [f64; 2]) -> f64 {
        let [u, v] = unit(at, self.half);
        self.modulation.at(u, v) / LEVELS
    }

    /// The shift of a dot, px, times the standard deviation of the unknown factor.
    fn doubt(&self, dot: &MeasuredDot, strongest: f64, pitch: f64) -> [f64; 2] {
        let share = (self.modulation(dot.at) / strongest).min(1.0);
        let weak = ((WEAK[1] - share) / (WEAK[1] - WEAK[0])).clamp(0.0, 1.0);
        let factor = FACTOR + (WEAK_FACTOR - FACTOR) * weak;
        let shift = factor * blur::tilt_shift(blur::radius(share)) * pitch * pitch;
        let gradient = self.gradient(dot.at);
        let size = (shift * gradient[0].hypot(gradient[1])).abs().max(1e-30);
        gradient.map(|g| shift * g * (MOST * pitch / size).min(1.0))
    }

    /// Relative gradient of the light, per px.
    fn gradient(&self, at: [f64; 2]) -> [f64; 2] {
        const STEP: f64 = 1e-3;
        let [u, v] = unit(at, self.half);
        let along = [
            self.light.at(u + STEP, v) - self.light.at(u - STEP, v),
            self.light.at(u, v + STEP) - self.light.at(u, v - STEP),
        ];
        [0, 1].map(|axis| along[axis] / (2.0 * STEP * LEVELS * self.half[axis]))
    }
}

/// Px to -1..1.
fn unit(at: [f64; 2], half: [f64; 2]) -> [f64; 2] {
    [0, 1].map(|axis| (at[axis] + 0.5) / half[axis] - 1.0)
}
