//! The body of a request with a length limit and an idle timeout.

use std::{
    pin::Pin,
    sync::{Arc, Mutex, PoisonError},
    task::{Context, Poll},
    time::Duration,
};

use axum::{
    body::{Body, BodyDataStream},
    http::{HeaderMap, header},
};
use bytes::Bytes;
use futures::{Stream, StreamExt};
use tokio::time::{Instant, Sleep, sleep, timeout};

use crate::{
    contract::{Code, Fault},
    http::{ApiError, background, wait_times},
    telemetry::events::{self, WaitsOn},
};

/// How much is read and discarded after a refusal. Without this, a client that is still sending would see a connection
/// reset instead of the response.
#[derive(Debug, Clone, Copy)]
struct Linger {
    bytes: u64,
    time: Duration,
}

/// Discarding ends when nothing arrives for this time: a proxy may wait for the end of the connection instead.
const LINGER_IDLE: Duration = Duration::from_secs(5);

impl Linger {
    /// Clients read the response while they send; some proxies (Apache) read it only after the whole body. Only
    /// requests of trusted proxies still have the header here: the layer `request_id` removes it from others.
    fn for_sender(headers: &HeaderMap) -> Self {
        if headers.contains_key("x-forwarded-for") {
            Self { bytes: 2 << 30, time: Duration::from_secs(2 * 60) }
        } else {
            Self { bytes: 64 << 20, time: Duration::from_secs(5) }
        }
    }

    fn discard(self, rest: BodyDataStream) {
        if tokio::runtime::Handle::try_current().is_ok() {
            background::spawn(timeout(self.time, linger(rest, self.bytes)));
        }
    }
}

/// True when the client waits for `100 Continue` before it sends the body.
fn waits_for_continue(headers: &HeaderMap) -> bool {
    headers.get(header::EXPECT).is_some_and(|v| v.as_bytes().eq_ignore_ascii_case(b"100-continue"))
}

/// The `Content-Length` of a request, bytes.
pub fn content_length(headers: &HeaderMap) -> Option<u64> {
    headers.get(header::CONTENT_LENGTH)?.to_str().ok()?.parse().ok()
}

/// The media type of the body, in lower case and without parameters; `None` without a `Content-Type`.
pub fn media_type(headers: &HeaderMap) -> Option<String> {
    let text = headers.get(header::CONTENT_TYPE)?.to_str().unwrap_or_default();
    Some(text.split(';').next().unwrap_or_default().trim().to_ascii_lowercase())
}

/// Reads some of the body of a refused request and discards it. Otherwise a client that still sends would see a
/// connection reset and not the answer. A client that waits for `100 Continue` sends nothing.
pub fn discard(headers: &HeaderMap, body: Body) {
    if !waits_for_continue(headers) {
        Linger::for_sender(headers).discard(body.into_data_stream());
    }
}

/// Why a body ended early. The libraries that the body passes through drop the reason, so it is kept here.
#[derive(Debug, Clone, Default)]
pub struct EndReason(Arc<Mutex<Option<Fault>>>);

impl EndReason {
    /// Sets the reason.
    pub fn set(&self, fault: Fault) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(fault);
    }

    /// The reason; when none was set, that the connection was closed before the end of the body.
    pub fn error(&self) -> ApiError {
        let reason = self.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
        reason.unwrap_or_else(broken_off).into()
    }

    /// The reason, if one was set.
    pub fn known(&self) -> Option<ApiError> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone().map(ApiError::from)
    }
}

fn broken_off() -> Fault {
    Fault::new(Code::UploadIncomplete, "the upload ended before its last byte; nothing was stored; send it again")
}

/// The body ended early; [`EndReason`] has the reason.
#[derive(Debug, thiserror::Error)]
#[error("the body ended early")]
pub struct EndedEarly;

/// The body of a request as a stream of chunks.
pub struct WatchedBody {
    /// `None` once it has ended.
    inner: Option<BodyDataStream>,
    /// True once the first chunk was asked for, which sends `100 Continue`.
    polled: bool,
    /// The client sends nothing before it receives `100 Continue`.
    waits_for_continue: bool,
    linger: Linger,
    /// Ends when nothing arrived for `idle_timeout`.
    silence: Pin<Box<Sleep>>,
    /// When waiting for the next chunk began.
    waits: Option<Instant>,
    idle_timeout: Duration,
    max_bytes: u64,
    seen: u64,
    end_reason: EndReason,
}

impl WatchedBody {
    /// Limits `body` to `max_bytes` in all and `idle_timeout` between chunks.
    pub fn new(body: Body, headers: &HeaderMap, max_bytes: u64, idle_timeout: Duration) -> Self {
        Self {
            inner: Some(body.into_data_stream()),
            polled: false,
            waits_for_continue: waits_for_continue(headers),
            linger: Linger::for_sender(headers),
            silence: Box::pin(sleep(idle_timeout)),
            waits: None,
            idle_timeout,
            max_bytes,
            seen: 0,
            end_reason: EndReason::default(),
        }
    }

    /// Where the reason of an early end is kept.
    pub fn end_reason(&self) -> EndReason {
        self.end_reason.clone()
    }

    fn count(&mut self, chunk: &Bytes) -> Result<(), EndedEarly> {
        self.seen += chunk.len() as u64;
        events::received(chunk.len() as u64);
        if self.seen <= self.max_bytes {
            return Ok(());
        }
        self.end_reason.set(too_large(self.max_bytes));
        Err(EndedEarly)
    }
}

/// The error for a body over the limit.
pub fn too_large(max_bytes: u64) -> Fault {
    let detail = format!("the upload is larger than the limit of {max_bytes} bytes; GET /v1/info shows all limits");
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
                wait_times::add(WaitsOn::Body, since.elapsed());
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
                this.end_reason.set(broken_off());
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
                let detail = format!("the upload timed out: nothing arrived for {seconds} s; send it again");
                this.end_reason.set(Fault::new(Code::UploadIncomplete, detail));
                Poll::Ready(Some(Err(EndedEarly)))
            }
        }
    }
}

impl Drop for WatchedBody {
    fn drop(&mut self) {
        if let Some(since) = self.waits {
            wait_times::add(WaitsOn::Body, since.elapsed());
        }
        let Some(rest) = self.inner.take() else { return };
        let sends_nothing = self.waits_for_continue && !self.polled;
        if sends_nothing {
            return;
        }
        self.linger.discard(rest);
    }
}

async fn linger(mut rest: BodyDataStream, most: u64) {
    let mut discarded = 0;
    while let Ok(Some(Ok(chunk))) = timeout(LINGER_IDLE, rest.next()).await {
        discarded += chunk.len() as u64;
        if discarded > most {
            return;
        }
    }
}
