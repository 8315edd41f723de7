//! What decided the fusion of a front light, for the further lights of the same view.
//!
//! Further lights are composed by the same map, so that the same pixel of all of them comes from the same slices. They
//! also have the defocus spread of the front light at the same outlines, and lose it by the same correction. They are
//! not blended with a pyramid image: it would decide by the detail of that light alone.

use std::sync::Arc;

use super::{
    correction,
    decision_map::DecisionMap,
    defocus_model::DefocusModel,
    mosaic,
    rounding::{out_of_range, rounded},
    warped_slices::WarpedSlices,
};
use crate::{
    fusion::{
        align::Aligned,
        run::Run,
        shown,
        tiles::{Blended, in_tiles},
    },
    imaging::{Plane, Rect, Sample},
    types::Interrupted,
};

/// The slices that each pixel of a front light was taken from, and the blur between them.
#[derive(Debug, Clone, PartialEq)]
pub struct Decision {
    pub(super) map: DecisionMap,
    pub(super) model: DefocusModel,
}

impl Decision {
    /// Bytes per pixel of the canvas that it holds: slice and texture.
    pub const BYTES_PER_PIXEL: u64 = 3;

    /// The decision of a method that has no decision map: the sharpest slice of each pixel, without a model of blur.
    pub(in crate::fusion) fn by_sharpest(sharpest: &Arc<Plane<u16>>, slices: usize) -> Self {
        let textured = Plane::filled(sharpest.width, sharpest.height, true);
        Self { map: DecisionMap { slice: Arc::clone(sharpest), textured }, model: DefocusModel::unknown(slices) }
    }

    /// Width and height of the canvas, px.
    pub(in crate::fusion) fn size(&self) -> (usize, usize) {
        (self.map.slice.width, self.map.slice.height)
    }

    /// The number of slices that it was made of.
    pub(in crate::fusion) fn slices(&self) -> usize {
        self.model.positions.len()
    }

    /// The picture of another light: the warped slices `aligned`, composed and corrected as the front light was.
    pub(in crate::fusion) fn blend<S: Sample, const C: usize>(
        &self,
        run: &Run<'_>,
        aligned: &Aligned,
    ) -> Result<Blended<S>, Interrupted> {
        let (slices, Self { map, model }) = (WarpedSlices::<S, C>::new(aligned, run.control), self);
        let tile = |(): &mut (), rect: Rect, out: &mut Vec<S>| {
            let mut values = mosaic::mosaic(&slices, map, model, rect)?;
            correction::correct(&slices, map, model, rect, &mut values)?;
            *out = rounded(&values);
            Ok(out_of_range::<S, C>(&values, rect, rect))
        };
        in_tiles::<S, C, _>((run, aligned, shown::MARGIN), "fusing", || (), tile)
    }
}
