//! How the grid moved from one slice to another.

use crate::calibration::coarse_registration::SimilarityMotion;
use crate::calibration::lattice::{self, Places};
use crate::imaging::Raster;

/// Whether a grid with steps `to` is mirrored (true) or turned by more than 45 degrees (false) against one with steps
/// `from`; `None` when it has the same orientation.
pub(super) fn turned(from: [[f64; 2]; 2], to: [[f64; 2]; 2]) -> Option<bool> {
    let area = |[u, v]: [[f64; 2]; 2]| u[0] * v[1] - u[1] * v[0];
    let along = |k: usize| from[k][0] * to[k][0] + from[k][1] * to[k][1];
    let across = from[0][0] * to[0][1] - from[0][1] * to[0][0];
    let is_mirrored = area(from) * area(to) < 0.0;
    (is_mirrored || along(0) < across.abs()).then_some(is_mirrored)
}

/// The motion from one slice to another by the dots that both show.
pub(super) fn motion_between(from: &Places, to: &Places, middle: [f64; 2]) -> SimilarityMotion {
    let scale = lattice::pitch_of(to) / lattice::pitch_of(from).max(1e-9);
    let shifts: Vec<[f64; 2]> = from
        .iter()
        .filter_map(|(label, p)| to.get(label).map(|q| [0, 1].map(|a| q[a] - middle[a] - scale * (p[a] - middle[a]))))
        .collect();
    let mean = |a: usize| shifts.iter().map(|s| s[a]).sum::<f64>() / shifts.len().max(1) as f64;
    SimilarityMotion { scale, shift: [mean(0), mean(1)] }
}

/// The centre of the image, px.
pub(super) fn slice_middle(slice: &Raster) -> [f64; 2] {
    [(slice.width as f64 - 1.0) / 2.0, (slice.height as f64 - 1.0) / 2.0]
}
