//! Pictures: planes, codecs, warp, and the filters that everything above is made of.

pub mod codec;
pub mod compositing;
pub mod coverage;
pub mod filter;
pub mod grey;
pub mod raster;
pub mod sample;
pub mod simd;
pub mod slices;
pub mod statistics;
pub mod thumbnail;
pub mod warp;

pub use coverage::Coverage;
pub use grey::LUMA;
pub use raster::{Depth, Plane, Raster, Rect, Samples};
pub use sample::Sample;
pub use slices::{SliceError, Slices};
