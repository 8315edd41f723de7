//! Filters: the focus measure, the guided filter, and the windowed sums they are made of.
//!
//! Wherever a sum must not depend on how a picture is cut into tiles, it is a sum of integers held in `f64`,
//! far below 2^53: such sums are exact, and so the same in every order.

pub mod disc;
pub mod focus;
pub mod guided;
pub mod mean;
pub mod saliency;
