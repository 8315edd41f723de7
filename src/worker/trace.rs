//! The span of an attempt of a job in the traces of OpenTelemetry. The trace is that of the request that made the job.

use tracing::{Span, field};
use uuid::Uuid;

use super::lease_keeper::LeaseKeeper;
use crate::{
    contract::Fault,
    store::Job,
    telemetry::{
        events,
        traces::{self, JobFacts, OpenSpan},
    },
};

/// The span of an attempt, and the job that it is of.
pub(super) struct Trace {
    job: Uuid,
    /// None without a collector.
    span: Option<OpenSpan>,
}

impl Trace {
    /// Begins the span of a claimed job. Before the first one, the time in the queue becomes a span.
    pub(super) fn of(job: &Job) -> Self {
        let row = job.trace.as_deref();
        if let (1, Some(claimed)) = (job.lease_token, job.started_at) {
            traces::queued(row, job.id, job.created_at, claimed);
        }
        let (rig, lens) = (job.rig.as_str(), job.lens.as_str());
        let facts = JobFacts { id: job.id, kind: job.request.kind(), attempt: job.attempt, rig, lens };
        Self { job: job.id, span: traces::job(row, facts) }
    }

    /// The span that work runs within.
    pub(super) fn span(&self) -> Option<&OpenSpan> {
        self.span.as_ref()
    }

    /// The span of the log lines, which adds the ids of the job and of the trace to them. Its level is `error`, so that
    /// the log filter never removes it.
    pub(super) fn log_span(&self) -> Span {
        let log = tracing::error_span!("job", job = %self.job, trace_id = field::Empty);
        if let Some(span) = &self.span {
            log.record("trace_id", field::display(span.trace_id()));
        }
        log
    }

    /// Adds the stages that the thread of the job was in until now.
    pub(super) fn add_stages(&self, keeper: &LeaseKeeper) {
        let Some(span) = &self.span else { return };
        for visit in keeper.visits() {
            span.add_child(visit.stage, visit.from, visit.to);
        }
    }

    /// Tells how the attempt ended.
    pub(super) fn ending(&self, ending: events::Ending, fault: Option<&Fault>) {
        let Some(span) = &self.span else { return };
        span.set("pinstack.job.ending", ending.as_str());
        if let Some(fault) = fault {
            span.set("error.type", fault.code.name());
            span.fail(crate::contract::one_line(&fault.detail));
        }
    }
}
