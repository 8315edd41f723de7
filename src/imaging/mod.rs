//! Pictures: planes, codecs, warp, and the filters that everything above is made of.

pub mod raster;
pub mod slices;

pub use raster::{Depth, Plane, Raster, Rect, Samples};
pub use slices::{SliceError, Slices};
