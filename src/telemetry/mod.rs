//! Metrics for Prometheus, and traces for a collector of OpenTelemetry ([`traces`]).
//!
//! [`series`] is the table of all series: name, type, labels, help. Counters, histograms and the gauges of the workers
//! are kept by the recorder of the process ([`mod@recorder`]) and updated where something happens ([`events`]). Gauges
//! that are measured at each scrape are written by `http::system::metrics` with [`Exposition`].
//!
//! Every label value is from a fixed set. None comes from a client, so the number of series is bounded.

pub mod events;
mod exposition;
mod recorder;
pub mod series;
pub mod traces;

pub use exposition::Exposition;
pub use recorder::{Recorder, recorder};
pub use series::{ALL, Kind, Series};
