//! Connections, so that no client keeps the others out: slots and shares of them, a reserve for health checks, and an
//! end for those that do not read.

pub mod slots;
pub mod tally;
pub mod write_timeout;

pub use slots::{Seat, Slots};
pub use tally::Tally;
pub use write_timeout::WriteTimeout;
