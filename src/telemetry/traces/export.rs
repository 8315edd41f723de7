//! Around the exporter of OTLP and the batches of the SDK: counts every span once, as exported or as lost, logs the
//! beginning and the end of a failure once, and bounds the number of spans that wait.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
    time::Duration,
};

use opentelemetry::Context;
use opentelemetry_sdk::{
    Resource,
    error::OTelSdkResult,
    trace::{Span, SpanData, SpanExporter, SpanProcessor},
};

use crate::telemetry::events;

/// Spans that may wait for the collector, about 1 KiB each. A stack has about 15.
pub(super) const QUEUE: usize = 4096;

/// Number of the spans that wait.
pub(super) type Waiting = Arc<AtomicUsize>;

/// An exporter that counts.
#[derive(Debug)]
pub(super) struct Counted<E> {
    inner: E,
    waiting: Waiting,
    is_failing: AtomicBool,
}

impl<E> Counted<E> {
    pub(super) fn new(inner: E, waiting: Waiting) -> Self {
        Self { inner, waiting, is_failing: AtomicBool::new(false) }
    }
}

impl<E: SpanExporter> SpanExporter for Counted<E> {
    async fn export(&self, batch: Vec<SpanData>) -> OTelSdkResult {
        let count = batch.len();
        let done = self.inner.export(batch).await;
        self.waiting.fetch_sub(count, Ordering::Relaxed);
        events::spans_left(done.is_ok(), count);
        let was_failing = self.is_failing.swap(done.is_err(), Ordering::Relaxed);
        match &done {
            Err(error) if !was_failing => {
                tracing::warn!(%error, "the collector of traces takes no spans; they are lost until it does");
            }
            Ok(()) if was_failing => tracing::info!("the collector of traces takes spans again"),
            _ => {}
        }
        done
    }

    fn shutdown_with_timeout(&self, timeout: Duration) -> OTelSdkResult {
        self.inner.shutdown_with_timeout(timeout)
    }

    fn set_resource(&mut self, resource: &Resource) {
        self.inner.set_resource(resource);
    }
}

/// A processor that drops spans while too many wait.
#[derive(Debug)]
pub(super) struct Bounded<P> {
    inner: P,
    waiting: Waiting,
}

impl<P> Bounded<P> {
    pub(super) fn new(inner: P, waiting: Waiting) -> Self {
        Self { inner, waiting }
    }
}

impl<P: SpanProcessor> SpanProcessor for Bounded<P> {
    fn on_start(&self, span: &mut Span, context: &Context) {
        self.inner.on_start(span, context);
    }

    fn on_end(&self, span: SpanData) {
        if self.waiting.fetch_add(1, Ordering::Relaxed) < QUEUE {
            self.inner.on_end(span);
        } else {
            self.waiting.fetch_sub(1, Ordering::Relaxed);
            events::spans_left(false, 1);
        }
    }

    fn force_flush(&self) -> OTelSdkResult {
        self.inner.force_flush()
    }

    fn shutdown_with_timeout(&self, timeout: Duration) -> OTelSdkResult {
        self.inner.shutdown_with_timeout(timeout)
    }

    fn set_resource(&mut self, resource: &Resource) {
        self.inner.set_resource(resource);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Mutex, mpsc};

    use opentelemetry::trace::{Span as _, Tracer, TracerProvider};
    use opentelemetry_sdk::{
        error::OTelSdkError,
        trace::{BatchConfigBuilder, BatchSpanProcessor, SdkTracerProvider},
    };

    use super::*;

    /// An exporter that answers nothing until the other end of the channel is gone, and then refuses every batch.
    #[derive(Debug)]
    struct Stuck(Mutex<mpsc::Receiver<()>>);

    impl SpanExporter for Stuck {
        async fn export(&self, _: Vec<SpanData>) -> OTelSdkResult {
            let _ = self.0.lock().expect("no test panics with it").recv();
            Err(OTelSdkError::InternalFailure("refused".into()))
        }
    }

    #[test]
    fn a_collector_that_hangs_bounds_what_waits_and_blocks_no_caller() {
        let (waiting, (gate, held)) = (Waiting::default(), mpsc::channel());
        let config = BatchConfigBuilder::default().with_max_queue_size(QUEUE).build();
        let exporter = Counted::new(Stuck(Mutex::new(held)), waiting.clone());
        let processor = Bounded::new(BatchSpanProcessor::new(exporter, config), waiting.clone());
        let provider = SdkTracerProvider::builder().with_span_processor(processor).build();
        let tracer = provider.tracer("test");
        // returns although no batch ends
        (0..3 * QUEUE).for_each(|_| tracer.start("span").end());
        assert_eq!(waiting.load(Ordering::Relaxed), QUEUE, "the others were dropped");
        drop(gate);
        provider.shutdown().expect("it ends, whatever became of the last batch");
        assert_eq!(waiting.load(Ordering::Relaxed), 0, "a batch that was refused is not kept");
    }
}
