//! The calibration sweep: cases, the comparison of a case with its truth, and the summary tables.

mod case;
mod outcome;

pub use case::{Case, cases};
pub use outcome::{Outcome, judge, tables};
