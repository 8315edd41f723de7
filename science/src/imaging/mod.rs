//! Images: rasters and planes, file formats, warping, filters, and small tools that the modules above share.
//!
//! | module | content |
//! |---|---|
//! | [`raster`], [`sample`] | image types, 8 and 16 bits |
//! | [`codec`] | JPEG, PNG and TIFF, with ICC profile and EXIF |
//! | [`slices`], [`grey_slices`] | the source of the slices of a stack, in colour or grey |
//! | [`warp`], [`coverage`] | resampling to the reference slice, and which pixels a slice covers |
//! | [`filter`] | mean, guided filter, focus measures, blur by a disc |
//! | [`grey`], [`statistics`], [`thumbnail`], [`compositing`] | luma, medians and quantiles, small copies, RGBA output |
//! | [`simd`] | vector instructions, with the same bits as portable code |

pub mod codec;
pub mod compositing;
pub mod coverage;
pub mod filter;
pub mod grey;
pub mod grey_slices;
pub mod mapping;
pub mod padding;
pub mod raster;
pub mod sample;
pub mod simd;
pub mod slices;
pub mod statistics;
pub mod thumbnail;
pub mod warp;

pub use coverage::Coverage;
pub use grey::LUMA;
pub use mapping::SliceMapping;
pub use raster::{Plane, Raster, Rect};
pub use sample::{Depth, Sample, Samples, Sum};
pub use slices::Slices;
