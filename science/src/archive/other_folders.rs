//! Folders whose names say that their pictures are no slices.

use crate::types::text::folded;

/// Folders with results of focus stacking, and folders with pictures of a target, in lower case.
const RESULTS: &str = "stacked fused edof mask masks masked cutout cutouts thumbs thumbnails preview previews \
    result results output outputs";
const TARGETS: &str = "calibration calib target dots";

/// Why the pictures in `folder` are no slices; `None` when they may be.
pub(super) fn no_slices(folder: &str) -> Option<&'static str> {
    let parts: Vec<String> = folder.split('/').map(folded).collect();
    let is_in = |names: &str| parts.iter().any(|part| names.split(' ').any(|name| name == part));
    if is_in(RESULTS) {
        return Some("its folder holds results, not slices");
    }
    is_in(TARGETS).then_some("its folder holds pictures of a calibration target: send them to /v1/calibrations")
}
