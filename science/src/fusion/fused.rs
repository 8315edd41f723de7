//! What [`fuse`](super::fuse) returns.

pub use super::halo_corrected::Decision;
use super::height::HeightMap;
use crate::{
    imaging::{Plane, Raster},
    quality::StackQuality,
    types::Warning,
};

#[cfg(doc)]
use crate::{fusion::UNCOVERED, types::fusion_options::Method};

/// A fused stack.
#[derive(Debug, Clone, PartialEq)]
pub struct Fused {
    /// The fused image, in the bit depth of the first slice; 1 channel if the first slice is grey, else 3. Black where
    /// no slice covers the canvas.
    pub image: Raster,
    /// 0-based slice per pixel, [`UNCOVERED`] where no slice covers the canvas: the decision map of
    /// [`Method::HaloCorrected`], and for the other methods the slice with the largest focus measure.
    pub index: Plane<u16>,
    /// The height map, if the plan asked for it.
    pub height_map: Option<HeightMap>,
    /// 255 where at least one slice covers the canvas, else 0.
    pub valid: Plane<u8>,
    /// The metrics, if they were requested.
    pub quality: Option<StackQuality>,
    /// What further lights are fused by, if it was requested.
    pub decision: Option<Decision>,
    /// What the user should know about the result.
    pub warnings: Vec<Warning>,
}
