//! The collector of traces: reachable, with headers that it accepts.

use super::finding::Finding;
use crate::{settings::Settings, telemetry::traces};

/// What the collector says; `None` without one. A collector that is away is no problem: the service works without it.
pub(super) async fn finding(config: &Settings) -> Option<Finding> {
    let collector = config.collector()?;
    let place = collector.endpoint;
    Some(match traces::inspect(collector).await {
        Ok(()) => Finding::ok("traces", format!("{place}: it takes spans")),
        Err(error) => Finding::warning(
            "traces",
            format!(
                "{place}: it takes no spans: {error:#}; check the address (OTLP over HTTP, often port 4318), the \
                 certificate and OTEL_EXPORTER_OTLP_HEADERS; the service works without it, and loses its traces"
            ),
        ),
    })
}
