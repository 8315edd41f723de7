//! The parts of the calibration sweep: which cases, how one is judged, how all are summed up.

mod case;
mod outcome;

pub use case::{Case, cases};
pub use outcome::{Outcome, judge, tables};
