//! Requests in progress by token.

use std::{
    collections::HashMap,
    pin::Pin,
    sync::{Arc, Mutex, PoisonError},
    task::{Context, Poll},
};

use axum::{
    body::{Body, Bytes, HttpBody},
    response::Response,
};
use hyper::body::{Frame, SizeHint};
use uuid::Uuid;

/// How many requests of each token are in progress.
#[derive(Debug, Clone, Default)]
pub struct Tally(Arc<Mutex<HashMap<Uuid, usize>>>);

impl Tally {
    /// Counts a request of a token; `None` when it has `most` already.
    pub fn enter(&self, token: Uuid, most: usize) -> Option<InProgress> {
        let mut counts = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let count = counts.entry(token).or_default();
        if *count >= most {
            return None;
        }
        *count += 1;
        Some(InProgress { tally: self.clone(), token })
    }
}

/// A request that is counted until this is dropped.
#[derive(Debug)]
pub struct InProgress {
    tally: Tally,
    token: Uuid,
}

impl InProgress {
    /// The request lasts until its answer has left or its client is gone: event streams and downloads count.
    pub fn until_left(self, response: Response) -> Response {
        response.map(|body| Body::new(Counted { body, _in_progress: self }))
    }
}

impl Drop for InProgress {
    fn drop(&mut self) {
        let mut counts = self.tally.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(count) = counts.get_mut(&self.token) {
            *count -= 1;
            if *count == 0 {
                counts.remove(&self.token);
            }
        }
    }
}

struct Counted {
    body: Body,
    _in_progress: InProgress,
}

impl HttpBody for Counted {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        Pin::new(&mut self.body).poll_frame(cx)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}
