//! The body of an upload, watched: it may not be too long, nor fall silent.

use std::{
    pin::Pin,
    sync::{Arc, Mutex, PoisonError},
    task::{Context, Poll},
    time::Duration,
};

use axum::body::{Body, BodyDataStream};
use bytes::Bytes;
use futures::{Stream, StreamExt};
use tokio::time::{Instant, Sleep, sleep, timeout};

use crate::{
    contract::{Code, Fault},
    http::{background, problem::ApiError, waiting},
    telemetry::events::{self, WaitsOn},
};

/// A refusal sent while the client still sends would be lost in a connection reset, so a little more is read
/// and thrown away meanwhile.
const LINGER_BYTES: u64 = 64 << 20;
/// How long at most.
const LINGER_TIME: Duration = Duration::from_secs(5);

/// Why the body ended early. It passes through libraries that forget the reason, so the reason stays here.
#[derive(Debug, Clone, Default)]
pub struct Verdict(Arc<Mutex<Option<Fault>>>);

impl Verdict {
    /// Keeps the reason.
    pub fn set(&self, fault: Fault) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(fault);
    }

    /// The reason, or that the body broke off.
    pub fn error(&self) -> ApiError {
        let told = self.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
        told.unwrap_or_else(broken_off).into()
    }

    /// The reason, when there is one.
    pub fn known(&self) -> Option<ApiError> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone().map(ApiError::from)
    }
}

fn broken_off() -> Fault {
    Fault::new(Code::UploadIncomplete, "the upload broke off before its end; nothing was stored; send it again")
}

/// The body ended early; [`Verdict`] knows why.
#[derive(Debug, thiserror::Error)]
#[error("the body ended early")]
pub struct EndedEarly;

/// The body of an upload as a stream of chunks.
pub struct WatchedBody {
    /// `None` once it has ended.
    inner: Option<BodyDataStream>,
    /// True once the client was asked to send.
    polled: bool,
    waits_for_continue: bool,
    silence: Pin<Box<Sleep>>,
    /// Since when the next chunk is waited for.
    waits: Option<Instant>,
    idle_timeout: Duration,
    max_bytes: u64,
    seen: u64,
    verdict: Verdict,
}

impl WatchedBody {
    /// Watches a body. `waits_for_continue`: the client sends nothing before it hears `100 Continue`.
    pub fn new(body: Body, max_bytes: u64, idle_timeout: Duration, waits_for_continue: bool) -> Self {
        Self {
            inner: Some(body.into_data_stream()),
            polled: false,
            waits_for_continue,
            silence: Box::pin(sleep(idle_timeout)),
            waits: None,
            idle_timeout,
            max_bytes,
            seen: 0,
            verdict: Verdict::default(),
        }
    }

    /// Where the reason of an early end can be asked for.
    pub fn verdict(&self) -> Verdict {
        self.verdict.clone()
    }

    fn count(&mut self, chunk: &Bytes) -> Result<(), EndedEarly> {
        self.seen += chunk.len() as u64;
        events::received(chunk.len() as u64);
        if self.seen <= self.max_bytes {
            return Ok(());
        }
        self.verdict.set(too_large(self.max_bytes));
        Err(EndedEarly)
    }
}

/// The body is over the limit.
pub fn too_large(max_bytes: u64) -> Fault {
    let detail = format!("the upload is over the limit of {max_bytes} bytes; GET /v1/info shows every limit");
    Fault::new(Code::UploadTooLarge, detail)
}

impl Stream for WatchedBody {
    type Item = Result<Bytes, EndedEarly>;

    fn poll_next(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        let this = &mut *self;
        let Some(inner) = &mut this.inner else { return Poll::Ready(None) };
        if !this.polled {
            this.polled = true;
            this.silence.as_mut().reset(Instant::now() + this.idle_timeout);
        }
        let polled = inner.poll_next_unpin(cx);
        match (&polled, this.waits) {
            (Poll::Pending, None) => this.waits = Some(Instant::now()),
            (Poll::Ready(_), Some(since)) => {
                waiting::add(WaitsOn::Body, since.elapsed());
                this.waits = None;
            }
            _ => {}
        }
        match polled {
            Poll::Ready(Some(Ok(chunk))) => {
                this.silence.as_mut().reset(Instant::now() + this.idle_timeout);
                Poll::Ready(Some(this.count(&chunk).map(|()| chunk)))
            }
            Poll::Ready(Some(Err(_))) => {
                this.inner = None;
                this.verdict.set(broken_off());
                Poll::Ready(Some(Err(EndedEarly)))
            }
            Poll::Ready(None) => {
                this.inner = None;
                Poll::Ready(None)
            }
            Poll::Pending => {
                std::task::ready!(this.silence.as_mut().poll(cx));
                this.inner = None;
                let seconds = this.idle_timeout.as_secs_f64();
                let detail = format!("the upload sent nothing for {seconds} s and was given up; send it again");
                this.verdict.set(Fault::new(Code::UploadIncomplete, detail));
                Poll::Ready(Some(Err(EndedEarly)))
            }
        }
    }
}

impl Drop for WatchedBody {
    fn drop(&mut self) {
        if let Some(since) = self.waits {
            waiting::add(WaitsOn::Body, since.elapsed());
        }
        let Some(rest) = self.inner.take() else { return };
        let nothing_comes = self.waits_for_continue && !self.polled;
        if nothing_comes {
            return;
        }
        if tokio::runtime::Handle::try_current().is_ok() {
            background::spawn(timeout(LINGER_TIME, linger(rest)));
        }
    }
}

async fn linger(mut rest: BodyDataStream) {
    let mut thrown_away = 0;
    while let Some(Ok(chunk)) = rest.next().await {
        thrown_away += chunk.len() as u64;
        if thrown_away > LINGER_BYTES {
            return;
        }
    }
}
