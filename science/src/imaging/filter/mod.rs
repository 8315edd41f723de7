//! Filters: the two focus measures, the guided filter, the mean filter, and blur by a disc.
//!
//! The guided filter and the mean filter add integers (`u32`, `u64`, or integers in `f64` below 2^53): such sums are
//! exact, and so the same in every order and for every division into tiles.

pub mod disc;
pub mod focus;
pub mod guided;
mod laplacian;
pub mod mean;
pub mod saliency;
