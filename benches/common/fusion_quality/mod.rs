//! The parts of the quality bench of fusion: stacks with their truth, other programs, figures, crops, how soft edges are.

mod case;
mod crops;
mod peers;
mod score;
mod spread;

pub use case::Case;
pub use crops::{Crop, worst};
pub use peers::Peers;
pub use score::{Regions, Scores, Table};
pub use spread::spreads;
