//! What the service tells Prometheus.
//!
//! [`series`] is the table of all series: name, type, labels, help. Counters, histograms and the gauges of the workers are
//! kept by the recorder of the process ([`recorder`]) and are written where something happens ([`events`]). Gauges that
//! are measured when they are asked for are written by `http::system::metrics` with [`Exposition`].
//!
//! Every label value is from a fixed set of this program. No value comes from a client, so the number of series is bounded.

pub mod events;
mod exposition;
mod recorder;
pub mod series;

pub use exposition::Exposition;
pub use recorder::{Recorder, recorder};
pub use series::{ALL, Kind, Series};
