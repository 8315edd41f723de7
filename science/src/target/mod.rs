//! The coded dot target: what is printed, as a pure function of the column and the row of a dot.
//!
//! A plain grid of dots looks the same after a shift by one pitch, and after quarter turns. On a coded target the sizes
//! of the dots tell them apart. Renderers and printers of targets and the calibration use the definition in this
//! module.

mod code;

pub use code::{CODE_DESCRIPTION, CODE_PERIOD, CODE_VERSION, DotSize, dot_size};
