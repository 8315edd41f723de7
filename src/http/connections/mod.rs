//! Connections, so that no client keeps the others out: slots and shares of them, a reserve for health checks, and an
//! end for those that do not read.

pub mod range;
pub mod reading;
pub mod slots;
pub mod tally;

pub use range::AddressRange;
pub use reading::Reading;
pub use slots::{Seat, Slots};
pub use tally::Tally;
