//! The body of a form on its way to the parser (multer), which by itself holds whatever it cannot make sense of: all
//! bytes before the first boundary, and within the headers of a part. Here they are counted.
//!
//! ```text
//! outside = bytes given to the parser - bytes that it returned as data of parts
//! ```
//!
//! The parser gets no more bytes while `outside` is over [`MAX_OUTSIDE`] and it has made no progress with what it has.
//! So it never holds more than that and one chunk of the network, and never searches more for a byte that arrives.

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

use super::body::{EndedEarly, Verdict, WatchedBody};
use crate::contract::{Code, Fault};

/// Most bytes of a form outside the data of its parts: boundaries, headers, and what stands before and behind.
pub const MAX_OUTSIDE: u64 = 64 << 10;

/// The body of a form. Clones are one body: the parser reads by one, the receiver counts by another.
#[derive(Clone)]
pub struct FormBody(Arc<Shared>);

struct Shared {
    body: Mutex<WatchedBody>,
    verdict: Verdict,
    /// Given to the parser.
    given: AtomicU64,
    /// Returned by it as data of parts.
    returned: AtomicU64,
    /// Parts that began, and chunks of data.
    progress: AtomicU64,
    /// `progress` when the parser asked for more though it had too much; plus one. 0: it did not.
    stuck_at: AtomicU64,
}

impl FormBody {
    /// Counts a body.
    pub fn new(body: WatchedBody) -> Self {
        let verdict = body.verdict();
        Self(Arc::new(Shared {
            body: Mutex::new(body),
            verdict,
            given: AtomicU64::default(),
            returned: AtomicU64::default(),
            progress: AtomicU64::default(),
            stuck_at: AtomicU64::default(),
        }))
    }

    /// Why the body ended early, when it did.
    pub fn verdict(&self) -> &Verdict {
        &self.0.verdict
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

    /// Reads what stands behind the last boundary, and throws it away.
    ///
    /// # Errors
    /// When that is too long, or the body ends early; [`Self::verdict`] knows why.
    pub async fn drain(&mut self) -> Result<(), EndedEarly> {
        while let Some(chunk) = self.next().await {
            chunk?;
            // bytes that the parser never sees are no progress
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
            "the form holds more than {MAX_OUTSIDE} bytes outside the data of its parts: its boundary never comes, or the \
             headers of a part never end; is the boundary that of the Content-Type?"
        );
        self.0.verdict.set(Fault::new(Code::InvalidRequest, detail));
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
            // the parser asks for more before it looks at what it has: it may look once
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
