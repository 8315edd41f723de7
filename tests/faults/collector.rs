//! A collector of traces for tests: it decodes and keeps what it receives, or answers nothing at all.

use std::sync::{Arc, Mutex};

use axum::{
    Router,
    body::Bytes,
    extract::State,
    http::{HeaderMap, StatusCode, header},
    routing::post,
};
use opentelemetry_proto::tonic::{
    collector::trace::v1::ExportTraceServiceRequest,
    common::v1::{KeyValue, any_value::Value},
    trace::v1::Span,
};
use prost::Message;
use tokio::net::TcpListener;

/// A span with the attributes of the process that made it.
#[derive(Debug, Clone)]
pub struct Received {
    pub span: Span,
    pub process: Vec<KeyValue>,
}

impl Received {
    /// A text or a number among the attributes.
    pub fn attribute(&self, key: &str) -> String {
        value_of(&self.span.attributes, key)
    }

    /// The same of its process.
    pub fn of_process(&self, key: &str) -> String {
        value_of(&self.process, key)
    }

    /// True when it lies within another.
    pub fn is_within(&self, other: &Self) -> bool {
        other.span.start_time_unix_nano <= self.span.start_time_unix_nano
            && self.span.end_time_unix_nano <= other.span.end_time_unix_nano
    }
}

fn value_of(attributes: &[KeyValue], key: &str) -> String {
    let found = attributes.iter().find(|attribute| attribute.key == key);
    match found.and_then(|attribute| attribute.value.as_ref()?.value.as_ref()) {
        Some(Value::StringValue(text)) => text.clone(),
        Some(Value::IntValue(number)) => number.to_string(),
        _ => String::new(),
    }
}

/// A running collector.
pub struct Collector {
    pub url: String,
    spans: Arc<Mutex<Vec<Received>>>,
}

impl Collector {
    /// One that takes every span.
    pub async fn start() -> Self {
        let spans = Arc::new(Mutex::new(Vec::new()));
        let router = Router::new().route("/v1/traces", post(receive)).with_state(Arc::clone(&spans));
        let (url, listener) = listen().await;
        tokio::spawn(async move { axum::serve(listener, router).await });
        Self { url, spans }
    }

    /// The spans so far.
    pub fn spans(&self) -> Vec<Received> {
        self.spans.lock().expect("no test panics with it").clone()
    }
}

async fn listen() -> (String, TcpListener) {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    (format!("http://{}", listener.local_addr().expect("an address")), listener)
}

async fn receive(State(spans): State<Arc<Mutex<Vec<Received>>>>, headers: HeaderMap, body: Bytes) -> StatusCode {
    assert_eq!(headers[header::CONTENT_TYPE], "application/x-protobuf");
    let request = ExportTraceServiceRequest::decode(body).expect("protobuf");
    let mut spans = spans.lock().expect("no test panics with it");
    for of_process in request.resource_spans {
        let process = of_process.resource.map(|resource| resource.attributes).unwrap_or_default();
        let all = of_process.scope_spans.into_iter().flat_map(|scope| scope.spans);
        spans.extend(all.map(|span| Received { span, process: process.clone() }));
    }
    StatusCode::OK
}

/// The address of a port at which nothing listens.
pub async fn nothing() -> String {
    listen().await.0
}

/// The address of a program that accepts connections and never answers.
pub async fn hanging() -> String {
    let (url, listener) = listen().await;
    tokio::spawn(async move {
        let mut held = Vec::new();
        while let Ok((connection, _)) = listener.accept().await {
            held.push(connection);
        }
    });
    url
}
