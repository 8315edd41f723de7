//! The HTTP client of the export.
//!
//! The export runs on a thread of the SDK, outside of any runtime; the requests run as tasks of the runtime of the
//! process, and the thread waits for them.

use std::{path::Path, time::Duration};

use async_trait::async_trait;
use bytes::Bytes;
use http_body_util::{BodyExt, Full, Limited};
use opentelemetry_http::{HttpClient, HttpError, Request, Response};
use tokio::{runtime::Handle, time::timeout};

use crate::https::{self, HttpsClient};

/// Time from the start of a request to the end of its answer.
const ANSWER: Duration = Duration::from_secs(5);
/// Most bytes of an answer: a collector tells how many spans it refused.
const MAX_ANSWER: usize = 1 << 20;

/// Sends batches to the collector.
#[derive(Debug)]
pub(super) struct CollectorClient {
    client: HttpsClient<Full<Bytes>>,
    runtime: Handle,
}

impl CollectorClient {
    /// A client for the runtime of the caller.
    pub(super) fn new(ca_file: Option<&Path>) -> anyhow::Result<Self> {
        Ok(Self { client: https::client("otlp_ca_file", ca_file)?, runtime: Handle::try_current()? })
    }
}

#[async_trait]
impl HttpClient for CollectorClient {
    async fn send_bytes(&self, request: Request<Bytes>) -> Result<Response<Bytes>, HttpError> {
        let client = self.client.clone();
        let exchange = async move {
            let (head, body) = client.request(request.map(Full::new)).await?.into_parts();
            let body = Limited::new(body, MAX_ANSWER).collect().await?.to_bytes();
            Ok::<_, HttpError>(Response::from_parts(head, body))
        };
        // the limit is made within the task, because the thread of the SDK has no timer
        self.runtime.spawn(async move { timeout(ANSWER, exchange).await }).await??
    }
}
