//! Server-sent events of a job.

use std::{convert::Infallible, time::Duration};

use axum::{
    http::{HeaderMap, StatusCode},
    response::{
        IntoResponse, Response,
        sse::{Event, KeepAlive, Sse},
    },
};
use futures::{Stream, stream};
use serde::Serialize;
use tokio::sync::broadcast::Receiver;
use uuid::Uuid;

use super::wait::changed;
use crate::{
    contract::{JobState, Progress},
    http::state::App,
    store::Job,
};

/// Proxies cut connections that are silent for a minute or so.
const KEEP_ALIVE: Duration = Duration::from_secs(15);

/// The events of a job from now on: `state` (the whole job as its URL shows it) whenever the state changes,
/// `progress` whenever the progress does. The id of an event is the version of the job. A client that comes back
/// with `Last-Event-ID` is told only what is newer; when that is nothing because the job has ended, it gets 204,
/// which tells an `EventSource` to stay away.
pub fn answer<V: Serialize + 'static>(
    app: &App,
    headers: &HeaderMap,
    job: Job,
    view: fn(&Job) -> Option<V>,
) -> Response {
    let last_seen = headers.get("last-event-id").and_then(|v| v.to_str().ok()).and_then(|v| v.parse::<i64>().ok());
    let seen_whole = last_seen.is_some_and(|seen| seen >= job.version);
    if seen_whole && job.state.is_final() {
        return StatusCode::NO_CONTENT.into_response();
    }
    let told = seen_whole.then(|| Told { version: job.version, state: job.state, progress: job.progress.clone() });
    let teller = Teller { app: app.clone(), id: job.id, changes: app.rows.changes(), told, queue: Vec::new(), view };
    let sse = Sse::new(tell(teller)).keep_alive(KeepAlive::new().interval(KEEP_ALIVE));
    // nginx would collect events until its buffer is full
    ([("x-accel-buffering", "no")], sse).into_response()
}

/// What the client knows.
struct Told {
    version: i64,
    state: JobState,
    progress: Progress,
}

struct Teller<V> {
    app: App,
    id: Uuid,
    changes: Receiver<Uuid>,
    told: Option<Told>,
    /// Events of one change, the next one last.
    queue: Vec<Event>,
    view: fn(&Job) -> Option<V>,
}

fn tell<V: Serialize + 'static>(teller: Teller<V>) -> impl Stream<Item = Result<Event, Infallible>> {
    stream::unfold(teller, |mut teller| async move {
        loop {
            if let Some(event) = teller.queue.pop() {
                return Some((Ok(event), teller));
            }
            if !teller.look().await {
                return None;
            }
        }
    })
}

impl<V: Serialize> Teller<V> {
    /// Waits for the next change and queues its events. False when there is nothing more to tell.
    async fn look(&mut self) -> bool {
        if self.told.as_ref().is_some_and(|told| told.state.is_final()) || self.app.shutdown.is_cancelled() {
            return false;
        }
        // a failed read ends the stream: the client comes back with Last-Event-ID
        let Ok(Some(job)) = self.app.rows.job(self.id).await else { return false };
        if self.told.as_ref().is_some_and(|told| told.version == job.version) {
            tokio::select! {
                () = changed(&mut self.changes, self.id, self.app.policy.poll_interval) => {}
                () = self.app.shutdown.cancelled() => {}
            }
            return true;
        }
        self.queue_change(&job);
        self.told = Some(Told { version: job.version, state: job.state, progress: job.progress });
        true
    }

    fn queue_change(&mut self, job: &Job) {
        let new_state = self.told.as_ref().is_none_or(|told| told.state != job.state);
        let new_progress = self.told.as_ref().is_none_or(|told| told.progress != job.progress);
        let state = || Event::default().event("state").json_data((self.view)(job));
        let progress = || Event::default().event("progress").json_data(&job.progress);
        let in_order = match (new_state, new_progress) {
            // a final state is the last thing that is told
            (true, true) if job.state.is_final() => vec![progress(), state()],
            (true, true) => vec![state(), progress()],
            (false, true) => vec![progress()],
            // the state, or something that only the whole job tells: a wish to cancel, say
            (_, false) => vec![state()],
        };
        let mut events: Vec<Event> = in_order.into_iter().filter_map(Result::ok).collect();
        // the last event of a change carries the version: who lost the line between two is told both again
        if let Some(last) = events.pop() {
            events.push(last.id(job.version.to_string()));
        }
        events.reverse();
        self.queue = events;
    }
}
