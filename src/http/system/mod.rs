//! Endpoints about the service itself: health, limits, metrics, the OpenAPI document, problem types.

pub mod docs;
pub mod examples;
mod gauges;
pub mod healthz;
pub mod info;
pub mod metrics;
pub mod openapi;
pub mod parameters;
pub mod problems;
pub mod readyz;
pub mod schemas;
