//! Diagnosis: why a slice shows no grid.

use crate::calibration::statistics::{quantile, thinned};
use crate::calibration::working_image::WorkingImage;
use crate::imaging::{Plane, Raster};

/// A likely reason why no grid was found in a slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Diagnosis {
    /// A large part is at full scale.
    Clipped,
    /// Almost no light.
    Black,
    /// Light, but almost no differences.
    NoContrast,
    /// Differences, but no edges.
    Blurred,
    /// Edges, but no grid of dots.
    Other,
}

impl Diagnosis {
    /// The reason, with what to do; a phrase whose subject is the slice.
    pub(crate) fn phrase(self) -> &'static str {
        match self {
            Self::Clipped => "is clipped in a large part: reduce the exposure",
            Self::Black => "is almost black: increase the exposure, and check the lamp and the shutter",
            Self::NoContrast => "has almost no contrast: check that the target is in view, lit and in focus",
            Self::Blurred => "is blurred everywhere: focus on the target in at least one slice",
            Self::Other => "shows no grid that can be followed: use a flat, well printed target that fills the image",
        }
    }
}

/// The likely reason why no grid was found in `slice`.
pub(crate) fn diagnose(slice: &Raster) -> Diagnosis {
    let image = WorkingImage::of(slice, slice.width.max(slice.height).div_ceil(1600).max(1));
    let plane = &image.plane;
    let mut levels = thinned(plane);
    let (dark, bright) = (quantile(&mut levels, 0.02), quantile(&mut levels, 0.98));
    match () {
        () if image.clipped > 0.3 => Diagnosis::Clipped,
        () if bright < 20.0 => Diagnosis::Black,
        () if bright - dark < 0.12 * bright => Diagnosis::NoContrast,
        () if gradient(plane) < 0.02 * (bright - dark) => Diagnosis::Blurred,
        () => Diagnosis::Other,
    }
}

/// 98th percentile of the differences between neighbouring samples.
fn gradient(plane: &Plane<f32>) -> f64 {
    let stride = (plane.height / 200).max(1);
    let mut steps = Vec::new();
    for y in (0..plane.height).step_by(stride) {
        steps.extend(plane.row(y).windows(2).step_by(3).map(|w| f64::from((w[1] - w[0]).abs())));
    }
    quantile(&mut steps, 0.98)
}
