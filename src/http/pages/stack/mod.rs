//! The page of one stack: the viewer, its tiles, the plots of the metrics, what can be done with the stack,
//! and the runs of its pictures beside each other.

pub mod actions;
pub mod comparison;
pub mod facts;
pub mod findings;
pub mod page;
pub mod plots;
pub mod relief;
pub mod runs;
pub mod tiles;
pub mod viewer;
