//! Connections, so that no client keeps the others out: slots and shares of them, a reserve for health checks, and an
//! end for those that do not read.

pub mod in_progress;
pub mod slots;
pub mod write_timeout;

pub use in_progress::InProgress;
pub use slots::{Seat, Slots};
pub use write_timeout::WriteTimeout;
