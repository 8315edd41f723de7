//! The page of one stack: the viewer, its tiles, the plots of the metrics, and what can be done with the stack.

pub mod actions;
pub mod facts;
pub mod findings;
pub mod page;
pub mod plots;
pub mod relief;
pub mod tiles;
pub mod viewer;
