//! The parts of the bench of whole stacks: what is fused, its stages, the clock, another program.

mod case;
mod clock;
mod enfuse;
mod make;
mod stages;

pub use case::{Case, FRONT, Kind, PHOTOGRAPHED};
pub use clock::Cost;
pub use enfuse::enfuse;
pub use make::{RENDERED, make, packed};
pub use stages::{OF_BACK, STAGES, stage};
