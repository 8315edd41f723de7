//! The codes of warnings and of findings of the metrics: one row per code.
//!
//! Clients see the text. This program compares the variants, so the compiler finds every use of a code that is renamed.

use std::fmt;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Makes the enum, the list of all codes, and the conversions to and from text.
macro_rules! codes {
    ($($variant:ident $text:literal)+) => {
        /// The code of a [`Warning`](super::Warning) or of a [`Finding`](super::metrics::Finding).
        #[derive(Debug, Clone, PartialEq, Eq)]
        pub enum WarningCode {
            $(#[doc = concat!("`", $text, "`")] $variant,)+
            /// A code that this version does not know: of a profile or a job that another version stored.
            Other(String),
        }

        impl WarningCode {
            /// All codes that this version gives.
            pub const ALL: &[Self] = &[$(Self::$variant,)+];

            /// The text that clients see, `snake_case`.
            pub fn as_str(&self) -> &str {
                match self {
                    $(Self::$variant => $text,)+
                    Self::Other(text) => text,
                }
            }
        }

        impl From<String> for WarningCode {
            fn from(text: String) -> Self {
                match text.as_str() {
                    $($text => Self::$variant,)+
                    _ => Self::Other(text),
                }
            }
        }
    };
}

codes! {
    // the zip
    UnclearFileNames "unclear_file_names"
    RawPassedOver "raw_passed_over"
    FilesPassedOver "files_passed_over"
    ManifestPassedOver "manifest_passed_over"
    CounterRollover "counter_rollover"
    CopiedFileName "copied_file_name"
    OrderContradictsTimes "order_contradicts_times"
    MixedBitDepth "mixed_bit_depth"
    MixedColour "mixed_colour"
    MixedColourSpaces "mixed_colour_spaces"
    UnknownColourSpace "unknown_colour_space"
    OrientationUnknown "orientation_unknown"
    ViewsDiffer "views_differ"
    BackLightIgnored "back_light_ignored"
    // the calibration
    CalibratedByStacks "calibrated_by_stacks"
    SliceMissing "slice_missing"
    SliceDoubled "slice_doubled"
    RailStill "rail_still"
    SlicesOutOfOrder "slices_out_of_order"
    UnevenStep "uneven_step"
    RigBumped "rig_bumped"
    SliceDisplaced "slice_displaced"
    CaptureModeDisagrees "capture_mode_disagrees"
    FocalLengthDisagrees "focal_length_disagrees"
    PupilRatioDisagrees "pupil_ratio_disagrees"
    TargetAdvanceDisagrees "target_advance_disagrees"
    PupilRatioAssumed "pupil_ratio_assumed"
    ClippedWhite "clipped_white"
    UncertainGains "uncertain_gains"
    ExposureOutlier "exposure_outlier"
    TintOutlier "tint_outlier"
    LampBanding "lamp_banding"
    UnevenLight "uneven_light"
    SliceInterpolated "slice_interpolated"
    DotsInverted "dots_inverted"
    UncertainCorners "uncertain_corners"
    ManyOutliers "many_outliers"
    Perspective "perspective"
    SmallTarget "small_target"
    TargetAslant "target_aslant"
    LateralColour "lateral_colour"
    BlurredReference "blurred_reference"
    LensDistortion "lens_distortion"
    ShiftAmbiguous "shift_ambiguous"
    ProfileNotKept "profile_not_kept"
    Rebased "rebased"
    // the fusion
    UnusedParameters "unused_parameters"
    UnusedInputBits "unused_input_bits"
    DepthOrderDisagrees "depth_order_disagrees"
    CanvasNotCovered "canvas_not_covered"
    FusionOvershoot "fusion_overshoot"
    FocalLengthDropped "focal_length_dropped"
    LightsExchanged "lights_exchanged"
    DotTarget "dot_target"
    // the mask
    MaskEmpty "mask_empty"
    MaskFull "mask_full"
    MaskLowSeparability "mask_low_separability"
    MaskUnevenLight "mask_uneven_light"
    MaskTranslucent "mask_translucent"
    MaskInverted "mask_inverted"
    MaskTouchesBorder "mask_touches_border"
    // the metrics; some have codes of the calibration too
    ExposureFlicker "exposure_flicker"
    ExposureDrift "exposure_drift"
    WhiteBalanceDrift "white_balance_drift"
    RangeTooShortNear "range_too_short_near"
    RangeTooShortFar "range_too_short_far"
    CoverageGap "coverage_gap"
    RedundantSlices "redundant_slices"
    ProfileMisfit "profile_misfit"
    LightMisfit "light_misfit"
    SliceMisaligned "slice_misaligned"
    PictureJumps "picture_jumps"
    ForeignSlice "foreign_slice"
    AlignmentNotMeasured "alignment_not_measured"
    Clipped "clipped"
    Halos "halos"
    UnfocusedArea "unfocused_area"
    SmallCommonArea "small_common_area"
    LittleTexture "little_texture"
    DuplicateSlice "duplicate_slice"
    SlicesReversed "slices_reversed"
    // the capture plan
    DiffractionLimited "diffraction_limited"
    Oversampled "oversampled"
    StepBelowRailResolution "step_below_rail_resolution"
    TooFewSlices "too_few_slices"
    FirstOrder "first_order"
    // the poses
    NoSurface "no_surface"
    SeveralCameras "several_cameras"
    KnownLengthDisagrees "known_length_disagrees"
    OneRing "one_ring"
    NoScale "no_scale"
    NotRegistered "not_registered"
    UnknownViews "unknown_views"
    DuplicateViews "duplicate_views"
    Outliers "outliers"
    NoAngles "no_angles"
    NoAxis "no_axis"
    NoSense "no_sense"
    Clockwise "clockwise"
}

impl fmt::Display for WarningCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl Serialize for WarningCode {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.as_str())
    }
}

impl<'de> Deserialize<'de> for WarningCode {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer).map(Self::from)
    }
}

/// With the text that clients see, in tests.
impl PartialEq<&str> for WarningCode {
    fn eq(&self, text: &&str) -> bool {
        self.as_str() == *text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_is_read_back_from_its_text_and_an_unknown_one_is_kept() {
        for code in WarningCode::ALL.iter().cloned().chain([WarningCode::Other("of_another_version".into())]) {
            let text = serde_json::to_string(&code).expect("JSON");
            assert_eq!(text, format!("\"{code}\""));
            assert_eq!(serde_json::from_str::<WarningCode>(&text).expect("a code"), code);
        }
    }
}
