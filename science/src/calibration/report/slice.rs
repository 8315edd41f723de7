//! One slice in the report.

use crate::calibration::findings::Facts;
use crate::calibration::result::{Dot, DotUse};
use crate::types::report::{DotReport, SliceReport};
use crate::types::{distortion::Distortion, profile::ProfileSlice};

/// Most dots per slice that a report keeps.
const MAX_DOTS: usize = 2000;

/// What was measured of slice `index`. The dots are reported where they are seen, with `distortion`.
pub(super) fn report(facts: &Facts, distortion: Option<&Distortion>, index: usize) -> SliceReport {
    let (slice, tracked) = (&facts.profile[index], facts.tracked);
    let solved = &facts.solution.slices[index];
    let detection = tracked.detections[index].as_ref();
    let [width, height] = tracked.size();
    let law = solved.estimate.by_law.map(|h| ProfileSlice::given(0, h, 1.0, width, height));
    let base = tracked.detections[facts.solution.reference].as_ref();
    let every = solved.dots.len().div_ceil(MAX_DOTS).max(1);
    let dot = |d: &Dot| DotReport {
        at: distortion.map_or(d.at, |distortion| distortion.distort(d.at)),
        residual: base.and_then(|b| b.dots.get(&d.label)).map(|b| {
            let sent = slice.homography.apply(d.at);
            [sent[0] - b.at[0], sent[1] - b.at[1]]
        }),
        inlier: d.used == DotUse::Inlier,
    };
    SliceReport {
        index: slice.index,
        name: facts.slices.name(index).to_owned(),
        scale: slice.scale,
        law_scale: law.as_ref().map(|l| l.scale),
        shift_px: slice.shift_px,
        law_shift_px: law.map(|l| l.shift_px),
        off_law_px: solved.estimate.off_law,
        blur_radius_px: facts.blurs[index].zip(detection).map(|(b, s)| b * s.pitch),
        contrast: detection.map(|s| s.modulation / tracked.strongest()),
        gain: slice.gain,
        gain_sigma: Some(solved.gain.sigma).filter(|s| s.is_finite()),
        law_gain: solved.gain.by_model,
        clipped: detection.map(|s| s.clipped),
        dots_found: slice.dots_found.unwrap_or(0),
        inliers: slice.inliers.unwrap_or(0),
        rms_px: slice.rms_px,
        corner_sigma_px: solved.estimate.sigma,
        interpolated: slice.interpolated,
        dots: solved.dots.iter().step_by(every).map(dot).collect(),
    }
}
