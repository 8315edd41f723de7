//! Parts of the bench of fusion quality: stacks with their truth, other programs, scores and tables, crops, edge
//! softness.

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
