//! Counts the requests in progress of each token.

use std::{
    pin::Pin,
    task::{Context, Poll},
};

use axum::{
    body::{Body, Bytes, HttpBody},
    response::Response,
};
use hyper::body::{Frame, SizeHint};
use uuid::Uuid;

use crate::http::state::token_sums::TokenSums;

/// A counted request. Dropping it ends the count.
#[derive(Debug)]
pub struct InProgress {
    counts: TokenSums,
    token: Uuid,
}

impl InProgress {
    /// Counts a request of a token; `None` when `most` are in progress already.
    pub fn begin(counts: &TokenSums, token: Uuid, most: usize) -> Option<Self> {
        let begins = counts.change(Some(token), |count| {
            let begins = *count < most as u64;
            *count += u64::from(begins);
            begins
        });
        begins.then(|| Self { counts: counts.clone(), token })
    }

    /// Counts the request until its answer is sent or the client is gone, so that event streams and downloads count.
    pub fn until_sent(self, response: Response) -> Response {
        response.map(|body| Body::new(Counted { body, _in_progress: self }))
    }
}

impl Drop for InProgress {
    fn drop(&mut self) {
        self.counts.change(Some(self.token), |count| *count -= 1);
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
