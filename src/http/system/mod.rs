//! The service about itself.

pub mod docs;
pub mod healthz;
pub mod info;
pub mod metrics;
pub mod openapi;
pub mod readyz;
