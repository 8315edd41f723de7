//! Dot targets for calibrations: one endpoint per file.

pub mod advice;
pub mod dots;
