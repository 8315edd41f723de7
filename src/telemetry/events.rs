//! Records events: one function per event, so that names and labels of series occur once.

use std::time::Duration;

use metrics::{counter, gauge, histogram};

use super::series::*;
use crate::contract::{Code, JobKind};

/// What a request waited on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WaitsOn {
    /// The bytes of its body.
    Body,
    /// The end of a job.
    Job,
}

/// How a job left its worker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// With results.
    Succeeded,
    /// With an error.
    Failed,
    /// On request.
    Cancelled,
    /// It went back to the queue.
    Released,
    /// The lease went to another worker.
    Lost,
}

impl Ending {
    const ALL: [Self; 5] = [Self::Succeeded, Self::Failed, Self::Cancelled, Self::Released, Self::Lost];

    /// Value of the label `ending`, also in the log.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Succeeded => "succeeded",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
            Self::Released => "released",
            Self::Lost => "lost",
        }
    }
}

/// Initialises the counters to 0, so that the first event is a change.
pub(super) fn begin() {
    counter!(UPLOAD_BYTES.name).increment(0);
    for kind in JobKind::ALL.map(JobKind::as_str) {
        counter!(JOB_RETRIES.name, "kind" => kind).increment(0);
        counter!(LEASES_LOST.name, "kind" => kind).increment(0);
        for ending in Ending::ALL {
            counter!(JOBS_ENDED.name, "kind" => kind, "ending" => ending.as_str()).increment(0);
        }
    }
    for outcome in ["succeeded", "failed"] {
        counter!(SWEEPS.name, "outcome" => outcome).increment(0);
    }
    swept(0, 0, 0, 0);
    counter!(LOG_LINES_LOST.name).increment(0);
    spans_left(true, 0);
    spans_left(false, 0);
    for series in [WORKERS, WORKERS_BUSY, MEMORY_BUDGET_BYTES, MEMORY_RESERVED_BYTES] {
        gauge!(series.name).set(0.0);
    }
}

/// The headers of a response left after `seconds` of service; `waits` are the times that the request waited.
pub fn answered(method: &'static str, route: &str, status: u16, service: Duration, waits: &[(WaitsOn, Duration)]) {
    let route = route.to_owned();
    counter!(HTTP_REQUESTS.name, "method" => method, "route" => route.clone(), "status" => status.to_string())
        .increment(1);
    histogram!(HTTP_REQUEST_SECONDS.name, "method" => method, "route" => route.clone()).record(service.as_secs_f64());
    for (on, time) in waits.iter().filter(|(_, time)| !time.is_zero()) {
        let on = match on {
            WaitsOn::Body => "body",
            WaitsOn::Job => "job",
        };
        histogram!(HTTP_WAIT_SECONDS.name, "method" => method, "route" => route.clone(), "on" => on)
            .record(time.as_secs_f64());
    }
}

/// A request was answered with a problem.
pub fn refused(code: Code) {
    counter!(HTTP_PROBLEMS.name, "code" => code.name()).increment(1);
}

/// Bytes of an upload arrived.
pub fn received(bytes: u64) {
    counter!(UPLOAD_BYTES.name).increment(bytes);
}

/// A job was claimed for its first attempt, `waited` after it was accepted.
pub fn started(kind: JobKind, waited: Duration) {
    histogram!(JOB_WAIT_SECONDS.name, "kind" => kind.as_str()).record(waited.as_secs_f64());
}

/// A job was claimed again.
pub fn retried(kind: JobKind) {
    counter!(JOB_RETRIES.name, "kind" => kind.as_str()).increment(1);
}

/// A job spent `time` in a stage.
pub fn stage_done(kind: JobKind, stage: &'static str, time: Duration) {
    histogram!(JOB_STAGE_SECONDS.name, "kind" => kind.as_str(), "stage" => stage).record(time.as_secs_f64());
}

/// A job left its worker after `time`.
pub fn left(kind: JobKind, ending: Ending, time: Duration) {
    let (kind, ending) = (kind.as_str(), ending.as_str());
    counter!(JOBS_ENDED.name, "kind" => kind, "ending" => ending).increment(1);
    histogram!(JOB_SECONDS.name, "kind" => kind, "ending" => ending).record(time.as_secs_f64());
}

/// A job failed.
pub fn failed(kind: JobKind, code: Code) {
    counter!(JOB_FAILURES.name, "kind" => kind.as_str(), "code" => code.name()).increment(1);
}

/// The lease of a job was lost.
pub fn lease_lost(kind: JobKind) {
    counter!(LEASES_LOST.name, "kind" => kind.as_str()).increment(1);
}

/// A garbage collection ended.
pub fn gc_ended(succeeded: bool) {
    counter!(SWEEPS.name, "outcome" => if succeeded { "succeeded" } else { "failed" }).increment(1);
}

/// A garbage collection removed expired jobs, zips of jobs that keep their results, abandoned uploads, and files
/// without a row (counted by job).
pub fn swept(expired: usize, uploads: usize, given_up: usize, orphans: usize) {
    for (content, count) in
        [("expired_job", expired), ("job_upload", uploads), ("open_upload", given_up), ("orphaned_files", orphans)]
    {
        counter!(SWEPT.name, "content" => content).increment(count as u64);
    }
}

/// Spans of traces were exported, or lost.
pub fn spans_left(exported: bool, count: usize) {
    let outcome = if exported { "exported" } else { "lost" };
    counter!(TRACE_SPANS.name, "outcome" => outcome).increment(count as u64);
}

/// A task that runs as long as the process panicked `times` times; 0 when it starts, so that its series exists.
pub fn task_panicked(task: &'static str, times: u64) {
    counter!(TASK_PANICS.name, "task" => task).increment(times);
}

/// A line of the log could not be written.
pub fn log_line_lost() {
    counter!(LOG_LINES_LOST.name).increment(1);
}

/// The memory of the workers of this process, bytes.
pub fn pool_started(memory_budget: u64) {
    gauge!(MEMORY_BUDGET_BYTES.name).set(memory_budget as f64);
}

/// Raises a gauge by an amount until it is dropped.
#[must_use]
pub struct Held(&'static str, f64);

impl Held {
    fn new(series: &Series, amount: f64) -> Self {
        gauge!(series.name).increment(amount);
        Self(series.name, amount)
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        gauge!(self.0).decrement(self.1);
    }
}

/// A worker is alive until this is dropped.
pub fn alive() -> Held {
    Held::new(&WORKERS, 1.0)
}

/// A worker has a job until this is dropped.
pub fn busy() -> Held {
    Held::new(&WORKERS_BUSY, 1.0)
}

/// A job has reserved `bytes` of memory until this is dropped.
pub fn memory_reserved(bytes: u64) -> Held {
    Held::new(&MEMORY_RESERVED_BYTES, bytes as f64)
}
