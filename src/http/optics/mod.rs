//! Capture planning: one endpoint per file.

pub mod plan;
