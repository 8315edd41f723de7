//! What [`fuse`](super::fuse) is asked for.

use super::height::axis::HeightAxis;
use crate::{
    imaging::{Plane, warp::Warp},
    types::{
        Error, ErrorKind, Homography,
        distortion::Distortion,
        fusion_options::{GuidedParams, Method},
        lateral_colour::LateralColour,
        profile::{CaptureMode, ProfileInput},
    },
};

#[cfg(doc)]
use super::Fused;

/// Value of [`Fused::index`] where no slice covers the canvas.
pub const UNCOVERED: u16 = u16::MAX;

/// Largest distance of the slope of the gains from that of a fixed lens. A moving lens has slopes near 0.
const GAIN_SLOPE_TOLERANCE: f64 = 0.5;
/// Smallest change of scale over the stack, as |ln(first / last)|, that decides which end of the stack is near.
const MIN_LOG_SCALE_CHANGE: f64 = 2e-3;

/// How a stack is fused.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Width of every slice and of the canvas, px. The canvas is the pixel grid of the reference slice.
    pub width: usize,
    /// Height of the same, px.
    pub height: usize,
    /// Geometry, brightness and rail position of each slice, in the order of the stack.
    pub slices: Vec<SlicePlan>,
    /// 0-based index of the reference slice. Where no slice shows any detail, its pixels are used.
    pub reference: usize,
    /// The fusion method.
    pub method: Method,
    /// Parameters of [`Method::Guided`]; they have no effect on the other methods.
    pub params: GuidedParams,
    /// Whether the first slice is focused nearest to the camera and the last farthest from it. `None` if unknown: then
    /// [`Method::HaloCorrected`] estimates it from the slices.
    pub near_first: Option<bool>,
    /// Measure a height map on this axis. `None`: do not.
    pub height_map: Option<HeightAxis>,
    /// Lens distortion of all slices and of the canvas, if there is any.
    pub distortion: Option<Distortion>,
    /// Lateral colour of the lens, which is corrected when slices are resampled; `None`: colours stay where they are.
    pub lateral_colour: Option<LateralColour>,
}

/// One slice of a [`Plan`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlicePlan {
    /// Maps pixels of the slice to pixels of the canvas.
    pub homography: Homography,
    /// Factor that brings the samples of the slice to the brightness of the reference slice; above 0.
    pub gain: f64,
    /// Position on the rail, mm. If it is unknown for any slice, the steps between slices are assumed to be equal.
    pub rail_mm: Option<f64>,
}

impl SlicePlan {
    /// A slice that is aligned and has the brightness of the reference slice; its rail position is unknown.
    pub const ALIGNED: Self = Self { homography: Homography::IDENTITY, gain: 1.0, rail_mm: None };
}

impl Plan {
    /// A plan for `slices` slices that are aligned and equally bright: the middle slice is the reference, the method is
    /// [`Method::Guided`] with the parameters of Li, Kang & Hu (2013).
    pub fn aligned(width: usize, height: usize, slices: usize) -> Self {
        Self {
            width,
            height,
            slices: vec![SlicePlan::ALIGNED; slices],
            reference: slices / 2,
            method: Method::Guided,
            params: GuidedParams::default(),
            near_first: None,
            height_map: None,
            distortion: None,
            lateral_colour: None,
        }
    }

    /// The plan for a stack taken with the rig of `profile`.
    pub fn from_profile(profile: &ProfileInput, method: Method, params: GuidedParams) -> Self {
        let rail = profile.rail_positions_mm.as_deref();
        let slice = |(index, &homography): (usize, &Homography)| SlicePlan {
            homography,
            gain: profile.gain(index),
            rail_mm: rail.and_then(|rail| rail.get(index)).copied(),
        };
        Self {
            width: profile.image_width as usize,
            height: profile.image_height as usize,
            slices: profile.homographies.iter().enumerate().map(slice).collect(),
            reference: profile.reference_index as usize,
            method,
            params,
            near_first: near_first(profile),
            height_map: None,
            distortion: profile.distortion,
            lateral_colour: profile.lateral_colour,
        }
    }

    /// The same plan with a height map, in the unit that follows from `profile`.
    #[must_use]
    pub fn with_height_map(self, profile: &ProfileInput) -> Self {
        Self { height_map: Some(HeightAxis::from_profile(profile, self.near_first)), ..self }
    }

    /// The resampling of slice `index` of the plan to the canvas.
    ///
    /// # Errors
    /// [`ErrorKind::InvalidProfile`] when its homography, its gain, the distortion or the lateral colour cannot be
    /// applied.
    pub(super) fn warp(&self, index: usize) -> Result<Warp, Error> {
        let size = (self.width, self.height);
        let slice = &self.slices[index];
        Warp::with_distortion(&slice.homography, slice.gain, size, self.distortion.as_ref())
            .and_then(|warp| warp.with_lateral_colour(self.lateral_colour.as_ref()))
            .ok_or_else(|| {
                let detail = format!(
                    "slice {index} cannot be resampled: its homography, its gain, the lens distortion or the lateral \
                     colour of the profile is not valid; correct the profile, or calibrate again"
                );
                Error::new(ErrorKind::InvalidProfile, detail)
            })
    }

    /// Rail positions of all slices, mm; `None` if any is unknown.
    pub(super) fn rail_mm(&self) -> Option<Vec<f64>> {
        self.slices.iter().map(|slice| slice.rail_mm).collect()
    }

    /// Checks the plan for a stack of `slices` slices.
    pub(super) fn check(&self, slices: usize) -> Result<(), Error> {
        let planned = self.slices.len();
        if slices == 0 || planned != slices {
            return Err(Error::new(
                ErrorKind::SliceCountMismatch,
                format!(
                    "the stack has {slices} slices and its profile has {planned}; upload as many slices as the \
                     profile has, and at least one"
                ),
            ));
        }
        let internal = |what: &str| Err(Error::new(ErrorKind::Internal, format!("the fusion plan has {what}")));
        if slices >= usize::from(UNCOVERED) {
            return Err(Error::new(ErrorKind::ArchiveTooLarge, "a stack can have at most 65534 slices".to_owned()));
        }
        if self.width == 0 || self.height == 0 || self.reference >= slices {
            return internal("an empty canvas or a reference slice that does not exist");
        }
        if self.height_map.as_ref().is_some_and(|axis| axis.heights.len() != slices) {
            return internal("an axis of heights for another number of slices");
        }
        let params = &self.params;
        if params.average.is_multiple_of(2) || params.average > 255 || params.r1 > 512 || params.r2 > 512 {
            return internal("filter sizes that are out of range");
        }
        let gains = self.slices.iter().map(|slice| slice.gain).enumerate();
        if let Some((slice, gain)) = gains.into_iter().find(|(_, gain)| !gain.is_finite() || *gain <= 0.0) {
            return Err(Error::new(
                ErrorKind::InvalidProfile,
                format!("the gain of slice {slice} is {gain}; it must be above 0"),
            ));
        }
        Ok(())
    }
}

/// Whether the first slice is focused nearest to the camera, as far as the scales of the homographies tell.
///
/// Let `s = sqrt(det A)` be the scale of a homography with linear part `A`, of the first and of the last slice.
///
/// | capture mode | what moves | near end of the stack |
/// |---|---|---|
/// | fixed lens | the sensor moves back: the image grows, so `s` falls, and the focus comes nearer | smaller `s` |
/// | moving lens | the camera moves back: the image shrinks, so `s` grows, and the focus comes nearer | larger `s` |
/// | lens alone | the lens moves back: the image shrinks, so `s` grows; the focus comes nearer where the magnification is above 1 | larger `s` there, else smaller |
///
/// Without a capture mode, gains of a fixed lens identify it: light falls off with the squared distance of the sensor,
/// as the area of the image grows, so `ln g = -2 ln s`.
///
/// `None` if neither decides, or if the scales differ by less than [`MIN_LOG_SCALE_CHANGE`].
fn near_first(profile: &ProfileInput) -> Option<bool> {
    let (first, last) = (scale(profile.homographies.first()?), scale(profile.homographies.last()?));
    let growth = (first / last).ln();
    match profile.capture_mode.or_else(|| fixed_lens_by_gains(profile))? {
        _ if growth.abs() < MIN_LOG_SCALE_CHANGE || !growth.is_finite() => None,
        CaptureMode::FixedLens => Some(growth < 0.0),
        CaptureMode::MovingLens => Some(growth > 0.0),
        CaptureMode::LensAlone => Some((growth > 0.0) == (profile.magnification? > 1.0)),
    }
}

/// The fixed lens, if the gains follow its law: the slope of `ln g` over `ln s`, by least squares through the reference
/// slice, is -2 within [`GAIN_SLOPE_TOLERANCE`]. Gains of a moving lens stay near 1, and so do those of a camera that
/// sets its exposure itself; they decide nothing.
fn fixed_lens_by_gains(profile: &ProfileInput) -> Option<CaptureMode> {
    let gains = profile.gains.as_ref()?;
    let (mut squares, mut products) = (0.0, 0.0);
    for (homography, gain) in profile.homographies.iter().zip(gains) {
        let (scale, gain) = (scale(homography).ln(), gain.ln());
        squares += scale * scale;
        products += scale * gain;
    }
    let slope = products / squares;
    ((slope + 2.0).abs() <= GAIN_SLOPE_TOLERANCE).then_some(CaptureMode::FixedLens)
}

/// Scale of the linear part of a homography; its perspective is neglected.
fn scale(homography: &Homography) -> f64 {
    (homography.0[0] * homography.0[4] - homography.0[1] * homography.0[3]).sqrt()
}

/// What [`fuse`](super::fuse) is asked for besides the fused image. The default is nothing, for an image that is shown
/// as a whole.
#[derive(Debug, Clone, Copy, Default)]
pub struct FusionRequest<'a> {
    /// Whether [`Fused::quality`] is measured.
    pub metrics: bool,
    /// Silhouette of the object: 255 inside, 0 outside, of the size of the canvas. The metrics are restricted to it,
    /// and so is [`Fused::height_map`].
    pub object: Option<&'a Plane<u8>>,
    /// The pixels of the image that will be shown: those that are not 0, of the size of the canvas. They contain the
    /// object. They and what is within 32 px of them are fused. To save time, other pixels of [`Fused::image`] may be
    /// those of the reference slice, and [`Fused::index`] may be less exact there. `None`: all pixels are shown.
    pub shown: Option<&'a Plane<u8>>,
    /// Whether [`Fused::decision`] is kept, for further lights.
    pub decision: bool,
}

impl FusionRequest<'_> {
    /// Checks the planes against the canvas of `plan`.
    pub(super) fn check(&self, plan: &Plan) -> Result<(), Error> {
        let planes = [self.object, self.shown].into_iter().flatten();
        if planes.into_iter().any(|plane| (plane.width, plane.height) != (plan.width, plan.height)) {
            let detail = "the silhouette or the plane of shown pixels does not have the size of the canvas";
            return Err(Error::new(ErrorKind::Internal, detail));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A profile of three slices whose scales are `scale`, 1 and `1 / scale`.
    fn profile(capture_mode: Option<CaptureMode>, scale: f64) -> ProfileInput {
        let slice = |scale: f64| Homography::similarity(scale, [3.0, -2.0]);
        ProfileInput {
            image_width: 60,
            image_height: 40,
            reference_index: 1,
            homographies: vec![slice(scale), Homography::IDENTITY, slice(1.0 / scale)],
            gains: Some(vec![0.9, 1.0, 1.1]),
            rail_positions_mm: Some(vec![0.0, 0.5, 1.0]),
            capture_mode,
            ..ProfileInput::default()
        }
    }

    #[test]
    fn the_near_end_follows_from_the_capture_mode_and_the_scales() {
        let (fixed, moving) = (Some(CaptureMode::FixedLens), Some(CaptureMode::MovingLens));
        for (mode, scale, expected) in [
            (fixed, 0.98, Some(true)),
            (fixed, 1.02, Some(false)),
            (moving, 0.98, Some(false)),
            (moving, 1.02, Some(true)),
            (fixed, 1.0004, None),
        ] {
            assert_eq!(near_first(&profile(mode, scale)), expected, "{mode:?}, {scale}");
        }
    }

    #[test]
    fn without_a_capture_mode_the_gains_of_a_fixed_lens_give_the_near_end() {
        let with_gains = |scale: f64, exponent: f64| {
            let gains = [scale, 1.0, 1.0 / scale].map(|scale| scale.powf(exponent));
            ProfileInput { gains: Some(gains.to_vec()), ..profile(None, scale) }
        };
        for scale in [0.98, 1.02] {
            let fixed = near_first(&profile(Some(CaptureMode::FixedLens), scale));
            assert_eq!(near_first(&with_gains(scale, -2.0)), fixed);
            assert_eq!(near_first(&with_gains(scale, -1.7)), fixed, "gains are measured within a few percent");
            for other in [0.0, -1.0, 2.0, -4.0] {
                assert_eq!(near_first(&with_gains(scale, other)), None, "{scale}, {other}");
            }
            assert_eq!(near_first(&ProfileInput { gains: None, ..profile(None, scale) }), None);
        }
    }

    #[test]
    fn a_slice_that_cannot_be_resampled_is_named_with_what_to_do() {
        let mut plan = Plan::aligned(60, 40, 2);
        plan.slices[1].homography = Homography([0.0; 9]);
        let Err(error) = plan.warp(1) else { panic!("a singular homography") };
        assert!(
            error.detail.starts_with("slice 1 cannot be resampled: its homography, its gain, "),
            "{}",
            error.detail
        );
        assert!(error.detail.ends_with("; correct the profile, or calibrate again"), "{}", error.detail);
        assert!(plan.warp(0).is_ok());
    }

    #[test]
    fn a_plan_has_the_gain_and_the_rail_position_of_each_slice_of_the_profile() {
        let profile = profile(None, 1.1);
        let plan = Plan::from_profile(&profile, Method::Pyramid, GuidedParams::default());
        let gains: Vec<f64> = plan.slices.iter().map(|slice| slice.gain).collect();
        assert_eq!((gains, plan.rail_mm()), (vec![0.9, 1.0, 1.1], Some(vec![0.0, 0.5, 1.0])));
        assert_eq!(plan.check(3), Ok(()));
        let unknown = ProfileInput { gains: None, rail_positions_mm: None, ..profile };
        let plan = Plan::from_profile(&unknown, Method::Pyramid, GuidedParams::default());
        assert!(plan.slices.iter().all(|slice| slice.gain == 1.0));
        assert_eq!(plan.rail_mm(), None);
    }
}
