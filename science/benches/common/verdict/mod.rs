//! Verdict against truth: the faults, the comparison of a stack with its truth, and the table.

mod family;
mod judge;
mod stacks;
mod table;

pub use judge::{Judgement, judge};
pub use stacks::{Selection, stacks};
pub use table::table;
