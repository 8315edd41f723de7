//! The collector of traces: starts the export at the start of the process, and ends it at the shutdown.

use std::{path::Path, sync::OnceLock, time::Duration};

use anyhow::{Context, anyhow};
use opentelemetry::{InstrumentationScope, Key, KeyValue, trace::TracerProvider};
use opentelemetry_otlp::{Protocol, SpanExporter, WithExportConfig, WithHttpConfig};
use opentelemetry_sdk::{
    Resource,
    trace::{BatchConfigBuilder, BatchSpanProcessor, SdkTracer, SdkTracerProvider, SpanExporter as _},
};
use uuid::Uuid;

use super::{
    client::CollectorClient,
    export::{Bounded, Counted, QUEUE, Waiting},
};

/// How long a batch may take, with its repetitions.
const BATCH: Duration = Duration::from_secs(10);
/// How long the last batches may take at a shutdown.
const LAST: Duration = Duration::from_secs(3);

static TRACER: OnceLock<SdkTracer> = OnceLock::new();

/// Where spans are sent to.
#[derive(Debug, Clone, Copy)]
pub struct Collector<'a> {
    /// URL of a receiver of OTLP over HTTP, without `/v1/traces`.
    pub endpoint: &'a str,
    /// Certificates to trust besides those of public authorities.
    pub ca_file: Option<&'a Path>,
}

/// The running export. Spans are lost when it is dropped without [`Export::stop`].
#[must_use]
pub struct Export(SdkTracerProvider);

impl Export {
    /// Sends what waits, for a few seconds at most, and ends the export.
    pub async fn stop(self) {
        let last = tokio::task::spawn_blocking(move || self.0.shutdown_with_timeout(LAST));
        match last.await {
            Ok(Ok(())) => {}
            Ok(Err(error)) => tracing::warn!(%error, "the last spans of traces could not be exported"),
            Err(error) => tracing::warn!(%error, "the export of traces panicked"),
        }
    }
}

/// Starts the export, once per process, within the runtime that sends the spans. Samplers, headers, names and batches
/// follow the environment variables of OpenTelemetry (`OTEL_TRACES_SAMPLER`, `OTEL_EXPORTER_OTLP_HEADERS`,
/// `OTEL_RESOURCE_ATTRIBUTES`, `OTEL_BSP_SCHEDULE_DELAY`).
///
/// # Errors
/// When the address or the file of certificates cannot be used, or a variable has an invalid value.
pub fn start(collector: Collector<'_>) -> anyhow::Result<Export> {
    let waiting = Waiting::default();
    let exporter = Counted::new(exporter(collector)?, waiting.clone());
    // the queue of the SDK never overflows: what is beyond its length is dropped, and counted, before it
    let config = BatchConfigBuilder::default().with_max_queue_size(QUEUE).build();
    let processor = Bounded::new(BatchSpanProcessor::new(exporter, config), waiting);
    let provider = SdkTracerProvider::builder().with_resource(resource()).with_span_processor(processor).build();
    let scope = InstrumentationScope::builder("pinstack").with_version(env!("CARGO_PKG_VERSION")).build();
    TRACER.set(provider.tracer_with_scope(scope)).map_err(|_| anyhow!("traces are exported already"))?;
    Ok(Export(provider))
}

/// Sends a batch without spans, as a test of address, certificate and headers.
///
/// # Errors
/// When the collector does not take it.
pub async fn inspect(collector: Collector<'_>) -> anyhow::Result<()> {
    Ok(exporter(collector)?.export(Vec::new()).await?)
}

/// The tracer, if spans are exported.
pub(super) fn tracer() -> Option<&'static SdkTracer> {
    TRACER.get()
}

fn exporter(Collector { endpoint, ca_file }: Collector<'_>) -> anyhow::Result<SpanExporter> {
    let endpoint = format!("{}/v1/traces", endpoint.trim_end_matches('/'));
    let exporter = SpanExporter::builder()
        .with_http()
        .with_http_client(CollectorClient::new(ca_file)?)
        .with_protocol(Protocol::HttpBinary)
        .with_endpoint(endpoint)
        .with_timeout(BATCH);
    exporter.build().context("otlp_endpoint: cannot export traces")
}

/// What the spans of this process have in common. `OTEL_SERVICE_NAME` and `OTEL_RESOURCE_ATTRIBUTES` take precedence.
fn resource() -> Resource {
    let named = Resource::builder().build();
    let is_set = |key: &'static str| named.get(&Key::from_static_str(key)).is_some();
    let unnamed = named.get(&Key::from_static_str("service.name"));
    let is_unnamed = unnamed.is_none_or(|name| name.as_str().starts_with("unknown_service"));
    let host = rustix::system::uname().nodename().to_string_lossy().into_owned();
    let ours = [
        ("service.version", env!("CARGO_PKG_VERSION").to_owned()),
        ("service.instance.id", Uuid::now_v7().to_string()),
        ("host.name", host),
    ];
    let ours = ours.into_iter().filter(|(key, _)| !is_set(key)).map(|(key, value)| KeyValue::new(key, value));
    let builder = Resource::builder().with_attributes(ours);
    if is_unnamed { builder.with_service_name("pinstack").build() } else { builder.build() }
}
