//! The body of a form on its way to the parser (multer), with a bound on what the parser buffers.
//!
//! The parser buffers all bytes before the first boundary and all headers of a part, without a limit. Here they are
//! counted:
//!
//! ```text
//! outside = bytes given to the parser - bytes that it returned as data of parts
//! ```
//!
//! While `outside` exceeds [`MAX_OUTSIDE`] and the parser makes no progress, it gets no more bytes. So it never buffers
//! more than that and one network chunk, and its search per arriving byte is bounded too.

use std::{
    pin::Pin,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
    task::{Context, Poll},
};

use bytes::Bytes;
use futures::{Stream, StreamExt};

use super::body::{EndReason, EndedEarly, WatchedBody};
use crate::contract::{Code, Fault};

/// Most bytes of a form outside the data of its parts: boundaries, headers, preamble and epilogue.
pub const MAX_OUTSIDE: u64 = 64 << 10;

/// The body of a form. Clones share one body: the parser reads through one, the receiver counts through another.
#[derive(Clone)]
pub struct FormBody(Arc<Shared>);

struct Shared {
    body: Mutex<WatchedBody>,
    end_reason: EndReason,
    /// Bytes given to the parser.
    given: AtomicU64,
    /// Bytes that it returned as data of parts.
    returned: AtomicU64,
    /// Counts parts that began and chunks of data that were returned.
    progress: AtomicU64,
    /// `progress + 1` when the parser last asked for more although `outside` was over the limit; 0 before.
    stuck_at: AtomicU64,
}

impl FormBody {
    /// Wraps a body.
    pub fn new(body: WatchedBody) -> Self {
        let end_reason = body.end_reason();
        Self(Arc::new(Shared {
            body: Mutex::new(body),
            end_reason,
            given: AtomicU64::default(),
            returned: AtomicU64::default(),
            progress: AtomicU64::default(),
            stuck_at: AtomicU64::default(),
        }))
    }

    /// Why the body ended early, if it did.
    pub fn end_reason(&self) -> &EndReason {
        &self.0.end_reason
    }

    /// A part began.
    pub fn part_began(&self) {
        self.0.progress.fetch_add(1, Ordering::Relaxed);
    }

    /// The parser returned `bytes` of the data of a part.
    pub fn data_came(&self, bytes: u64) {
        self.0.returned.fetch_add(bytes, Ordering::Relaxed);
        self.0.progress.fetch_add(1, Ordering::Relaxed);
    }

    /// Reads and discards what follows the last boundary.
    ///
    /// # Errors
    /// When that is too long, or the body ends early; [`Self::end_reason`] has the reason.
    pub async fn drain(&mut self) -> Result<(), EndedEarly> {
        while let Some(chunk) = self.next().await {
            chunk?;
            // bytes that the parser never sees do not count as progress
            if self.outside() > MAX_OUTSIDE {
                return Err(self.too_much());
            }
        }
        Ok(())
    }

    fn outside(&self) -> u64 {
        self.0.given.load(Ordering::Relaxed).saturating_sub(self.0.returned.load(Ordering::Relaxed))
    }

    fn too_much(&self) -> EndedEarly {
        let detail = format!(
            "the form has more than {MAX_OUTSIDE} bytes outside the data of its parts: its boundary does not appear, or \
             the headers of a part do not end; check that the boundary is the one in the Content-Type"
        );
        self.0.end_reason.set(Fault::new(Code::InvalidRequest, detail));
        EndedEarly
    }

    fn body(&self) -> MutexGuard<'_, WatchedBody> {
        self.0.body.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Stream for FormBody {
    type Item = Result<Bytes, EndedEarly>;

    fn poll_next(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        if self.outside() > MAX_OUTSIDE {
            // the parser asks for more before it parses what it has: let it parse once
            let progress = self.0.progress.load(Ordering::Relaxed) + 1;
            if self.0.stuck_at.swap(progress, Ordering::Relaxed) == progress {
                return Poll::Ready(Some(Err(self.too_much())));
            }
            cx.waker().wake_by_ref();
            return Poll::Pending;
        }
        let polled = self.body().poll_next_unpin(cx);
        if let Poll::Ready(Some(Ok(chunk))) = &polled {
            self.0.given.fetch_add(chunk.len() as u64, Ordering::Relaxed);
        }
        polled
    }
}
