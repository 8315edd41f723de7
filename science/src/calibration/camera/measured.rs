//! What the rail and a moved target measure of the lens, with standard deviations.

use crate::calibration::size_law::{ScaleSample, SizeLaw};
use crate::types::{calibration_options::CalibrationOptions, lens::Lens, profile::CaptureMode};

/// Relative standard deviation of the pitch of a printed target.
pub(super) const PRINT: f64 = 1e-3;
/// Relative standard deviation of the steps of a rail, and of the advance of a moved target.
const RAIL: f64 = 1e-3;
/// Standard deviation of the advance of a moved target beyond that, mm.
const ADVANCE_MM: f64 = 0.005;
/// Relative standard deviation of a specified focal length: it is rounded and holds at infinity, and a lens that
/// focuses internally is shorter at close range.
pub(super) const FOCAL: f64 = 0.1;
/// Relative standard deviation of a specified pupil ratio.
pub(super) const RATIO: f64 = 0.02;
/// The same where none is specified and 1 is assumed: most lenses are between 0.5 and 2.
pub(super) const ASSUMED_RATIO: f64 = 0.35;

/// A positive number with its relative standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Estimate {
    /// The number.
    pub value: f64,
    /// Its relative standard deviation.
    pub sigma: f64,
}

impl Estimate {
    /// The number; the standard deviations are independent. `None` unless it is positive.
    pub(super) fn new(value: f64, sigmas: impl IntoIterator<Item = f64>) -> Option<Self> {
        let sigma = sigmas.into_iter().fold(0.0, f64::hypot);
        (value > 0.0 && value.is_finite() && sigma.is_finite()).then_some(Self { value, sigma })
    }

    /// The standard deviation in the unit of the number.
    pub(super) fn absolute(self) -> f64 {
        self.value * self.sigma
    }
}

/// Measured quantities.
#[derive(Debug, Clone, Copy)]
pub(in crate::calibration) struct Known<'a> {
    /// Image size over target size.
    pub magnification: Option<f64>,
    /// Sizes over a rail whose positions are mm; empty otherwise.
    pub sizes: &'a [ScaleSample],
    /// The capture mode.
    pub capture: Option<CaptureMode>,
    /// Dot pitch in the reference slice, px, and its relative standard deviation.
    pub pitch_px: [f64; 2],
}

/// What the rail and a moved target measure.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Measured {
    /// E.
    pub exit: Option<Estimate>,
    /// D by the rail.
    pub entrance: Option<Estimate>,
    /// `1 / E + 1 / D` of a lens that moves alone.
    pub growth: Option<Estimate>,
    /// D by the moved target.
    pub by_target: Option<Estimate>,
    /// M.
    pub magnification: Option<Estimate>,
}

impl Measured {
    /// From the options and the sizes.
    pub(super) fn of(options: &CalibrationOptions, known: Known) -> Self {
        let law = known.capture.and_then(|mode| Some((mode, SizeLaw::fit(known.sizes, Some(mode))?)));
        let of_mode = |wanted: CaptureMode| law.filter(|(mode, _)| *mode == wanted).map(|(_, law)| law);
        let distance = |law: SizeLaw| Estimate::new(1.0 / law.growth.abs(), [law.relative_sigma(), RAIL]);
        let mut out = Self {
            exit: of_mode(CaptureMode::FixedLens).and_then(distance),
            entrance: of_mode(CaptureMode::MovingLens).and_then(distance),
            growth: of_mode(CaptureMode::LensAlone)
                .and_then(|law| Estimate::new(law.growth.abs(), [law.relative_sigma(), RAIL])),
            by_target: moved_target(options, known),
            magnification: known.magnification.and_then(|m| Estimate::new(m, [PRINT])),
        };
        if let (Some(growth), Some(depth)) = (out.growth, out.depth()) {
            // 1 / E is what D leaves of the growth
            let rest = growth.value - 1.0 / depth.value;
            let error = growth.absolute().hypot(depth.sigma / depth.value);
            out.exit = Estimate::new(1.0 / rest, [error / rest]).filter(|exit| exit.sigma < 0.3);
        }
        out
    }

    /// D, by the rail if it measures it.
    pub(super) fn depth(&self) -> Option<Estimate> {
        self.entrance.or(self.by_target)
    }

    /// P, by both pupils.
    pub(super) fn ratio(&self) -> Option<Estimate> {
        let (exit, depth, m) = (self.exit?, self.depth()?, self.magnification?);
        Estimate::new(exit.value / (m.value * depth.value), [exit.sigma, depth.sigma, m.sigma])
    }

    /// The lens that has the measured distance and a pupil ratio.
    pub(super) fn lens(&self, ratio: f64) -> Option<Lens> {
        let m = self.magnification?.value;
        let by_depth = self.depth().map(|depth| Lens::of_entrance_pupil(depth.value, m, ratio));
        let by_exit = || self.exit.map(|exit| Lens::of_exit_pupil(exit.value, m, ratio));
        let by_growth = || self.growth.map(|growth| Lens::of_growth(growth.value, m, ratio));
        by_depth.or_else(by_exit).or_else(by_growth)
    }

    /// The pupil ratio that a focal length implies.
    pub(super) fn ratio_of(&self, focal: f64) -> Option<f64> {
        let m = self.magnification?.value;
        if let Some(depth) = self.entrance {
            return Some(1.0 / (depth.value / focal - 1.0 / m));
        }
        if let Some(exit) = self.exit {
            return Some(exit.value / focal - m);
        }
        let growth = self.growth?.value * focal;
        Some((1.0 - growth * m) / (growth - m))
    }
}

/// D by the moved target, which was nearer to the lens.
fn moved_target(options: &CalibrationOptions, known: Known) -> Option<Estimate> {
    let (advance, nearer) = (options.target_advance_mm?, options.moved_target_pitch_px?);
    let [pitch, sigma] = known.pitch_px;
    let depth = advance / (1.0 - pitch / nearer);
    // the moved target is less sharp: its pitch is taken to be three times as uncertain
    let dots = 1_f64.hypot(3.0) * sigma * (depth / advance).abs() * pitch / nearer;
    Estimate::new(depth, [dots, RAIL, ADVANCE_MM / advance.abs()]).filter(|depth| depth.sigma < 0.3)
}
