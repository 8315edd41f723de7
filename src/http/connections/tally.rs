//! Counts the requests in progress of each token.

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

/// Number of requests in progress by token.
#[derive(Debug, Clone, Default)]
pub struct Tally(Arc<Mutex<HashMap<Uuid, usize>>>);

impl Tally {
    /// Counts a request of a token; `None` when `most` are in progress already.
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

/// A counted request. Dropping it ends the count.
#[derive(Debug)]
pub struct InProgress {
    tally: Tally,
    token: Uuid,
}

impl InProgress {
    /// Counts the request until its answer is sent or the client is gone, so that event streams and downloads count.
    pub fn until_sent(self, response: Response) -> Response {
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
