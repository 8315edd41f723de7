//! The parts of the quality bench of fusion: stacks with their truth, other programs, figures, crops.

mod case;
mod crops;
mod peers;
mod score;

pub use case::Case;
pub use crops::{Crop, worst};
pub use peers::Peers;
pub use score::{Regions, Scores, Table};
