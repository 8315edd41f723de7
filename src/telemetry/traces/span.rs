//! Open spans, and how work runs within them.
//!
//! The span of the current work is the context of OpenTelemetry of its thread. [`within`] sets it for a future,
//! [`carried`] and [`carried_by_thread`] pass it on to tasks and threads. Names and attributes follow the conventions
//! of OpenTelemetry where there are any; attributes of our own begin with `pinstack.`.

use std::{
    borrow::Cow,
    time::{Instant, SystemTime},
};

use futures::future::Either;
use hyper::HeaderMap;
use jiff::Timestamp;
use opentelemetry::{
    Context, KeyValue, Value,
    propagation::{Extractor, TextMapPropagator},
    trace::{FutureExt, SpanBuilder, SpanKind, Status, TraceContextExt},
};
use opentelemetry_http::HeaderExtractor;
use opentelemetry_sdk::propagation::TraceContextPropagator;
use uuid::Uuid;

use super::collector::tracer;
use crate::contract::JobKind;

/// Longest `tracestate` that goes along with a job: what the standard requires to be passed on.
const MAX_STATE: usize = 512;

/// A span that has begun and not ended. It ends at the latest when the last clone is dropped.
#[derive(Debug, Clone)]
pub struct OpenSpan(Context);

impl OpenSpan {
    fn start(builder: SpanBuilder, parent: &Context) -> Option<Self> {
        let tracer = tracer()?;
        Some(Self(parent.with_span(builder.start_with_context(tracer, parent))))
    }

    /// The id of its trace, 32 hexadecimal digits, for log lines.
    pub fn trace_id(&self) -> String {
        self.0.span().span_context().trace_id().to_string()
    }

    /// Sets an attribute.
    pub fn set(&self, key: &'static str, value: impl Into<Value>) {
        self.0.span().set_attribute(KeyValue::new(key, value));
    }

    /// Marks it as failed.
    pub fn fail(&self, why: impl Into<Cow<'static, str>>) {
        self.0.span().set_status(Status::error(why));
    }

    /// Adds a child that was open between two times.
    pub fn add_child(&self, name: &'static str, from: Instant, to: Instant) {
        let Some(tracer) = tracer() else { return };
        let builder = SpanBuilder::from_name(name).with_start_time(time_of(from));
        let child = self.0.with_span(builder.start_with_context(tracer, &self.0));
        child.span().end_with_timestamp(time_of(to));
    }

    /// Ends it.
    pub fn end(&self) {
        self.0.span().end();
    }
}

/// The wall-clock time of a moment of the monotonic clock.
fn time_of(moment: Instant) -> SystemTime {
    SystemTime::now() - moment.elapsed()
}

/// The span of an HTTP request, a child of the span in its `traceparent`. `None` without a collector.
pub fn request(method: &'static str, route: &str, path: String, headers: &HeaderMap) -> Option<OpenSpan> {
    tracer()?;
    let parent = TraceContextPropagator::new().extract_with_context(&Context::new(), &HeaderExtractor(headers));
    let builder = SpanBuilder::from_name(format!("{method} {route}")).with_kind(SpanKind::Server).with_attributes([
        KeyValue::new("http.request.method", method),
        KeyValue::new("http.route", route.to_owned()),
        KeyValue::new("url.path", path),
    ]);
    OpenSpan::start(builder, &parent)
}

/// What spans say of a job.
#[derive(Debug, Clone, Copy)]
pub struct JobFacts<'a> {
    /// Its id.
    pub id: Uuid,
    /// Its kind.
    pub kind: JobKind,
    /// Number of this attempt.
    pub attempt: u32,
    /// Rig of the profile.
    pub rig: &'a str,
    /// Lens of the profile.
    pub lens: &'a str,
}

/// The span of an attempt of a job, whose row has the context `row` ([`for_the_row`]). `None` without a collector.
pub fn job(row: Option<&str>, facts: JobFacts<'_>) -> Option<OpenSpan> {
    tracer()?;
    let name = match facts.kind {
        JobKind::Stack => "run stack",
        JobKind::Calibration => "run calibration",
        JobKind::Reconstruction => "run reconstruction",
    };
    let builder = SpanBuilder::from_name(name).with_kind(SpanKind::Consumer).with_attributes([
        KeyValue::new("pinstack.job.id", facts.id.to_string()),
        KeyValue::new("pinstack.job.kind", facts.kind.as_str()),
        KeyValue::new("pinstack.job.attempt", i64::from(facts.attempt)),
        KeyValue::new("pinstack.rig", facts.rig.to_owned()),
        KeyValue::new("pinstack.lens", facts.lens.to_owned()),
    ]);
    OpenSpan::start(builder, &of_the_row(row))
}

/// The time that a job waited for its first attempt, as a span beside that of the attempt.
pub fn queued(row: Option<&str>, id: Uuid, accepted: Timestamp, claimed: Timestamp) {
    if tracer().is_none() || row.is_none() {
        return;
    }
    let builder = SpanBuilder::from_name("wait in queue")
        .with_start_time(SystemTime::from(accepted))
        .with_attributes([KeyValue::new("pinstack.job.id", id.to_string())]);
    if let Some(waiting) = OpenSpan::start(builder, &of_the_row(row)) {
        waiting.0.span().end_with_timestamp(SystemTime::from(claimed.max(accepted)));
    }
}

/// Runs work within a span; without one, just runs it.
pub async fn within<F: Future>(span: Option<&OpenSpan>, work: F) -> F::Output {
    match span {
        Some(span) => work.with_context(span.0.clone()).await,
        None => work.await,
    }
}

/// Runs a section of the current request or job in a span of its own, which fails if the section does. Without a
/// current span it is just that work.
///
/// # Errors
/// Those of the work.
pub async fn section<T, E>(name: &'static str, work: impl Future<Output = Result<T, E>>) -> Result<T, E> {
    let Some(span) = child(name) else { return work.await };
    let done = work.with_context(span.0.clone()).await;
    if done.is_err() {
        span.fail("");
    }
    span.end();
    done
}

fn child(name: &'static str) -> Option<OpenSpan> {
    tracer()?;
    let parent = Context::current();
    parent.has_active_span().then(|| OpenSpan::start(SpanBuilder::from_name(name), &parent))?
}

/// A task that runs within the span of its caller.
pub fn carried<F: Future>(work: F) -> impl Future<Output = F::Output> {
    match tracer() {
        Some(_) => Either::Left(work.with_context(Context::current())),
        None => Either::Right(work),
    }
}

/// Blocking work that runs within the span of its caller.
pub fn carried_by_thread<T>(work: impl FnOnce() -> T) -> impl FnOnce() -> T {
    let context = tracer().map(|_| Context::current());
    move || {
        let _within = context.map(Context::attach);
        work()
    }
}

/// The current span as the row of a job keeps it: `traceparent` of W3C and, after a blank, `tracestate`.
pub fn for_the_row() -> Option<String> {
    tracer()?;
    let mut fields = std::collections::HashMap::new();
    TraceContextPropagator::new().inject_context(&Context::current(), &mut fields);
    let mut row = fields.remove("traceparent")?;
    if let Some(state) = fields.remove("tracestate").filter(|state| (1..=MAX_STATE).contains(&state.len())) {
        row = format!("{row} {state}");
    }
    Some(row)
}

/// The context of a row; an empty one if it has none, or one that is not valid.
fn of_the_row(row: Option<&str>) -> Context {
    let Some(row) = row else { return Context::new() };
    TraceContextPropagator::new().extract_with_context(&Context::new(), &Row(row))
}

struct Row<'a>(&'a str);

impl Extractor for Row<'_> {
    fn get(&self, key: &str) -> Option<&str> {
        let (parent, state) = self.0.split_once(' ').map_or((self.0, None), |(parent, state)| (parent, Some(state)));
        match key {
            "traceparent" => Some(parent),
            "tracestate" => state,
            _ => None,
        }
    }

    fn keys(&self) -> Vec<&str> {
        vec!["traceparent", "tracestate"]
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    const PARENT: &str = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01";

    #[test]
    fn a_row_has_parent_and_state() {
        for (row, state) in [(PARENT.to_owned(), ""), (format!("{PARENT} a=1,b=2"), "a=1,b=2")] {
            let context = of_the_row(Some(&row));
            let span = context.span();
            let span = span.span_context();
            assert_eq!(span.trace_id().to_string(), "4bf92f3577b34da6a3ce929d0e0e4736");
            assert!(span.is_remote() && span.is_sampled());
            assert_eq!(span.trace_state().header(), state);
        }
    }

    #[test]
    fn a_row_that_is_not_valid_begins_a_trace() {
        for row in [None, Some(""), Some("00-4bf9"), Some("ff-00000000000000000000000000000000-0-01")] {
            assert!(!of_the_row(row).has_active_span(), "{row:?}");
        }
    }

    #[test]
    fn without_a_collector_there_is_no_span() {
        assert!(request("GET", "/", String::new(), &HeaderMap::new()).is_none());
        assert_eq!(for_the_row(), None);
        let earlier = Instant::now() - Duration::from_secs(1);
        assert!(time_of(earlier) <= SystemTime::now() - Duration::from_secs(1));
    }
}
