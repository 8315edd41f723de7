//! Verdict against truth: the faults, the comparison of a stack with its truth, and the table.

mod family;
mod judge;
mod table;

pub use family::{Selection, stacks};
pub use judge::{Judgement, judge};
pub use table::table;
