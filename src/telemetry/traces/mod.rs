//! Traces by OpenTelemetry: what became of one request, through the queue and the worker to the stored results.
//!
//! ```text
//! POST /v1/stacks              the request, a child of the client's span if it sent `traceparent`
//! ├─ receive upload
//! ├─ inspect archive
//! ├─ store upload
//! ├─ enqueue                   the row of the job keeps the trace and the span of the request
//! ├─ wait in queue
//! └─ run stack                 one per attempt, also in another process
//!    ├─ admit                  waits for memory and disk space
//!    ├─ fetch input
//!    ├─ reading, aligning, ... the stages, as `pinstack_job_stage_seconds` names them
//!    ├─ store results
//!    └─ publish
//! ```
//!
//! | module | task |
//! |---|---|
//! | [`collector`] | where spans are sent to; starts and stops the export |
//! | `client` | the HTTP client of the export |
//! | `export` | counts what is exported and lost, and bounds what waits |
//! | [`span`] | open spans, and how work runs within them |
//!
//! Nothing here waits for the collector: spans that do not fit into the queue, and those that the collector does not
//! take, are lost and counted. Without a collector there is no trace, no thread, and every function returns at once.

mod client;
pub mod collector;
mod export;
pub mod span;

pub use collector::{Collector, Export, inspect, start};
pub use span::{JobFacts, OpenSpan, carried, carried_by_thread, for_the_row, job, queued, request, section, within};
