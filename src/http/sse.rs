//! Server-sent events of a job.
//!
//! In: a job, and the `Last-Event-ID` of a client that reconnects. Out: the events since then, until the job ends.
//!
//! | event | data | sent |
//! |---|---|---|
//! | `state` | the job, as `GET` shows it | first, and when the state changes |
//! | `progress` | its progress | when the progress changes |
//!
//! The id of an event is the version of the job. Changes made by this process are seen at once, changes made by other
//! processes at the next poll.

use std::{convert::Infallible, sync::Arc, time::Duration};

use axum::{
    http::{HeaderMap, StatusCode},
    response::{
        IntoResponse, Response,
        sse::{Event, KeepAlive, Sse},
    },
};
use futures::{Stream, stream};
use tokio::sync::broadcast::Receiver;
use uuid::Uuid;

use crate::{
    contract::{JobState, Progress},
    http::{App, links, views::JobDocument},
    store::Job,
};

/// Interval of keep-alive comments: proxies close connections that are silent for about a minute.
const KEEP_ALIVE: Duration = Duration::from_secs(15);

/// The event stream of a job. A client that has seen the final version gets 204, which tells an `EventSource` not to
/// reconnect.
pub fn answer(app: &App, headers: &HeaderMap, job: Job) -> Response {
    let last_id = headers.get("last-event-id").and_then(|v| v.to_str().ok()).and_then(|v| v.parse::<i64>().ok());
    let is_current = last_id.is_some_and(|id| id >= job.version);
    if is_current && job.state.is_final() {
        return StatusCode::NO_CONTENT.into_response();
    }
    let last_sent = is_current.then_some(LastSent { version: job.version, state: job.state, progress: job.progress });
    let events = EventStream {
        app: app.clone(),
        id: job.id,
        changes: app.store.metadata.changes(),
        last_sent,
        queue: Vec::new(),
    };
    let sse = Sse::new(events.into_stream()).keep_alive(KeepAlive::new().interval(KEEP_ALIVE));
    // nginx would buffer the events
    ([("x-accel-buffering", "no")], sse).into_response()
}

/// The state of the job that the client knows.
struct LastSent {
    version: i64,
    state: JobState,
    progress: Progress,
}

struct EventStream {
    app: App,
    id: Uuid,
    changes: Receiver<Uuid>,
    last_sent: Option<LastSent>,
    /// Events of one change; the next to send is last.
    queue: Vec<Event>,
}

impl EventStream {
    fn into_stream(self) -> impl Stream<Item = Result<Event, Infallible>> {
        // the stream is polled when the handler has returned
        let prefix = links::prefix();
        stream::unfold(self, move |mut this| {
            links::within(Arc::clone(&prefix), async move {
                loop {
                    if let Some(event) = this.queue.pop() {
                        return Some((Ok(event), this));
                    }
                    if !this.poll_job().await {
                        return None;
                    }
                }
            })
        })
    }

    /// Reads the job and queues the events of a change, or waits for a change. False at the end of the stream.
    async fn poll_job(&mut self) -> bool {
        if self.last_sent.as_ref().is_some_and(|sent| sent.state.is_final()) || self.app.shutdown.is_cancelled() {
            return false;
        }
        // a failed read ends the stream: the client reconnects with Last-Event-ID
        let Ok(Some(job)) = self.app.store.metadata.job(self.id).await else { return false };
        if self.last_sent.as_ref().is_some_and(|sent| sent.version == job.version) {
            tokio::select! {
                () = self.app.watch.changed(&mut self.changes, self.id, job.version) => {}
                () = self.app.shutdown.cancelled() => {}
            }
            return true;
        }
        self.queue_change(&job);
        self.last_sent = Some(LastSent { version: job.version, state: job.state, progress: job.progress });
        true
    }

    fn queue_change(&mut self, job: &Job) {
        let new_state = self.last_sent.as_ref().is_none_or(|sent| sent.state != job.state);
        let new_progress = self.last_sent.as_ref().is_none_or(|sent| sent.progress != job.progress);
        let state = || Event::default().event("state").json_data(JobDocument::of(job));
        let progress = || Event::default().event("progress").json_data(&job.progress);
        let in_order = match (new_state, new_progress) {
            // a final state is the last event
            (true, true) if job.state.is_final() => vec![progress(), state()],
            (true, true) => vec![state(), progress()],
            (false, true) => vec![progress()],
            // the state, or another change that only the whole job shows, such as a request to cancel
            (_, false) => vec![state()],
        };
        let mut events: Vec<Event> = in_order.into_iter().filter_map(Result::ok).collect();
        // only the last event of a change carries the version: a client that lost the connection between the two gets
        // both again
        if let Some(last) = events.pop() {
            events.push(last.id(job.version.to_string()));
        }
        events.reverse();
        self.queue = events;
    }
}
