//! One row per code of a stack: verdict, what the service can do, what happened, what to do.

use pinstack_science::types::WarningCode;

use super::{Explanation, Remedy::*, Verdict::*};

/// Makes [`row`] of the rows, and of the codes that no stack has. The compiler reports a code that is in neither.
macro_rules! rows {
    (
        stack { $($code:ident $verdict:ident [$($remedy:ident),*] $title:literal, $cure:literal;)+ }
        no_stack { $($other:ident)+ }
    ) => {
        /// What is said of a code; `None` for one that no stack has.
        pub(super) fn row(code: &WarningCode) -> Option<Explanation> {
            Some(match code {
                $(WarningCode::$code => Explanation {
                    verdict: $verdict, title: $title, cure: $cure, remedies: &[$($remedy),*],
                },)+
                $(WarningCode::$other)|+ | WarningCode::Other(_) => return None,
            })
        }
    };
}

rows! {
stack {
    // order and number of slices
    SlicesReversed DoNotUse [FuseInOtherOrder] "The slices are in reverse order",
        "Fuse the stack again in the other order. The calibration is right: do not repeat it.";
    SlicesOutOfOrder DoNotUse [DeleteView] "The slices are in a wrong order",
        "Compare their order with the rail, rename the files or list them in manifest.json, and send the stack again.";
    ForeignSlice DoNotUse [DeleteView] "A slice shows something else",
        "Put the right picture in its place and send the stack again.";
    DuplicateSlice Look [] "A slice is there twice",
        "Put the right picture in its place. If it is lost, take the stack again.";
    OrderContradictsTimes Look [] "The times of capture contradict the order",
        "Check the order of the slices. If the names are right, nothing has to be done.";
    CounterRollover Look [] "The camera began to count anew within the stack", "Check the order of the slices.";
    CopiedFileName Look [] "Some files look like copies",
        "Check that no picture is there twice, and that each is a slice.";
    UnclearFileNames Use [] "The file names are not readable", "Make the next zip with UTF-8 names. The order is right.";
    // geometry
    ProfileMisfit DoNotUse [FuseWithCurrentRevision, Calibrate] "The slices do not fit the calibration",
        "Find out whether the lens, its aperture or the rail was touched, and calibrate again. If that was done already, \
         fuse the stack again with the current revision of the profile.";
    LightMisfit Look [] "The slices of a further light do not fit",
        "Take all lights of a view without touching camera, lens and rail, at the same rail positions.";
    SliceMisaligned Look [DeleteView] "A slice is displaced",
        "Look for double contours in its band of depth. Take the stack again; if every stack shows it, calibrate again.";
    PictureJumps DoNotUse [DeleteView] "The rig or the object was knocked", "Fix both and take the stack again.";
    SmallCommonArea Use [FuseCropped] "The slices have little in common at the rim", "Keep the object in the middle.";
    AlignmentNotMeasured Use [] "The alignment could not be measured", "Look for double contours.";
    OrientationUnknown Look [Calibrate] "The pictures are turned, and the profile does not say how",
        "Look for double contours. Remove the orientation tag of the files, or calibrate again with it.";
    // focus
    RangeTooShortNear Look [] "The near end of the object is out of focus", "Begin nearer next time.";
    RangeTooShortFar Look [] "The far end of the object is out of focus", "End farther away next time.";
    CoverageGap Look [] "A band of depth is sharp in no slice", "Find the missing slice, or use a smaller step.";
    UnevenStep Look [] "The steps of the rail are uneven", "Find the missing slice, or see whether the rail slips.";
    RedundantSlices Use [] "There are more slices than needed", "A larger step gives the same picture in less time.";
    UnfocusedArea Use [] "A large area is never in focus", "See whether it is smooth, or out of range.";
    LittleTexture Use [] "There is little texture", "Do not rely on the figures for focus and alignment.";
    DepthOrderDisagrees Look [FuseByPyramid] "The stack seems to be numbered from the other end",
        "Look for rims around near parts. Correct the capture mode of the profile or the order of the slices; the pyramid \
         method needs neither.";
    Halos Use [FuseByPyramid] "There may be rims around near parts", "Look at the edges, and compare with another method.";
    // light
    ExposureFlicker Look [] "The brightness flickers", "Use constant light, manual exposure and a fixed aperture.";
    ExposureDrift Look [Calibrate] "The brightness drifts", "Let the lamps warm up, and calibrate again.";
    WhiteBalanceDrift Look [] "The colour drifts", "Set the white balance by hand, and let the lamps warm up.";
    Clipped Look [] "Bright parts are clipped", "Shorten the exposure, or soften the light.";
    UnusedInputBits Look [FuseWithBits] "The picture is dark: the files use only a part of their bits",
        "Fuse the stack again with the number of bits of the sensor.";
    LightsExchanged DoNotUse [DeleteView] "Front light and back light are exchanged",
        "Exchange the folders front and back, and send the stack again.";
    DotTarget DoNotUse [Calibrate] "The stack shows a dot target", "Send these pictures as a calibration.";
    // files
    RawPassedOver Use [] "Raw files were passed over", "Nothing has to be done if they are not slices.";
    FilesPassedOver Use [] "Other files were passed over", "Nothing has to be done if they are not slices.";
    ManifestPassedOver Look [] "manifest.json was ignored",
        "If it was meant to set the order, list the slices in it under front and back.";
    MixedBitDepth Look [] "The slices differ in their bits", "Save all slices in one format.";
    MixedColour Look [] "Some slices are grey, others coloured", "Save all slices in one format.";
    MixedColourSpaces Look [] "The slices differ in their colour space", "Save all slices in one colour space.";
    UnknownColourSpace Look [] "The colour space is not known", "Save all slices in sRGB, or with an ICC profile for RGB.";
    // options and profile
    UnusedParameters Use [FuseGuided] "Some options had no effect", "They belong to the guided method.";
    CanvasNotCovered Look [FuseCropped] "A part of the picture is covered by no slice",
        "It is black and transparent. Cut it off.";
    FusionOvershoot Look [] "Many pixels reached black or white", "Look for rims, and expose with a margin at both ends.";
    FocalLengthDropped Use [] "The picture has no focal length", "Calibrate with the focal length and the pixel pitch.";
    // the mask
    MaskEmpty DoNotUse [FuseWithoutMask] "The mask is empty", "Check the back light, or fuse without a mask.";
    MaskFull DoNotUse [FuseWithoutMask] "The mask covers all", "Check the back light, or fuse without a mask.";
    MaskInverted DoNotUse [FuseWithoutMask] "The mask seems to be inverted",
        "Check the back light: the object must be dark before it.";
    MaskLowSeparability Look [FuseWithoutMask] "Object and background differ little in the back light",
        "Look at the outline. Make the back light brighter and the room darker.";
    MaskUnevenLight Look [] "The back light is uneven", "Look at the outline near the dark side.";
    MaskTranslucent Look [] "Parts of the object let the back light through", "Look for missing parts, such as wings.";
    MaskTouchesBorder Look [] "The object touches the border", "See whether it is cut off.";
}
no_stack {
    ViewsDiffer BackLightIgnored CalibratedByStacks SliceMissing SliceDoubled RailStill RigBumped SliceDisplaced CaptureModeDisagrees
    FocalLengthDisagrees PupilRatioDisagrees TargetAdvanceDisagrees PupilRatioAssumed ClippedWhite UncertainGains
    ExposureOutlier TintOutlier LampBanding UnevenLight SliceInterpolated DotsInverted UncertainCorners ManyOutliers
    Perspective SmallTarget TargetAslant LateralColour BlurredReference LensDistortion ShiftAmbiguous ProfileNotKept
    Rebased DiffractionLimited Oversampled StepBelowRailResolution TooFewSlices FirstOrder NoSurface SeveralCameras
    KnownLengthDisagrees OneRing NoScale NotRegistered UnknownViews DuplicateViews Outliers NoAngles NoAxis NoSense
    Clockwise
}
}
