//! Detection of the dots of one slice: without prior knowledge in the first slice, relocated from its neighbour in
//! every other.
//!
//! | module | what it does |
//! |---|---|
//! | `grid` | finds the grid without prior knowledge |
//! | `unaided` | measures a slice in which the grid was found that way, and reads the code of its target |
//! | `relocation` | finds the grid of a neighbouring slice again |
//! | `measure`, `windows` | from approximate positions to measured dots |
//! | `motion` | how the grid moved from one slice to another |
//! | `diagnosis` | why a slice shows no grid |

mod diagnosis;
mod grid;
mod measure;
mod motion;
mod relocation;
mod unaided;
mod windows;

pub(super) use diagnosis::{Diagnosis, diagnose};
pub use grid::MAX_SAMPLES;
pub(super) use grid::detect_grid;
pub(super) use relocation::relocate_grid;
pub(super) use unaided::{detect_coded, measure_grid};
pub(super) use windows::{MAX_DOTS, grid_steps};
