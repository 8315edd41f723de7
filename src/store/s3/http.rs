//! The HTTP connection to the bucket: the client of [`crate::https`].
//!
//! Each request has a time limit until the head of its answer, and each piece of an answer another. A request that
//! fails is repeated by `object_store`, within the limits that [`super::bucket`] sets.

use std::{error::Error, path::Path, time::Duration};

use async_trait::async_trait;
use bytes::Bytes;
use http_body_util::{BodyExt, StreamBody};
use hyper::body::{Frame, Incoming};
use object_store::{
    ClientOptions,
    client::{
        HttpClient, HttpConnector, HttpError, HttpErrorKind, HttpRequest, HttpRequestBody, HttpResponse,
        HttpResponseBody, HttpService,
    },
};
use tokio::time::timeout;

use crate::https::{self, HttpsClient};

/// Time from the start of a request, whose body has a few MiB, to the head of the answer.
const ANSWER: Duration = Duration::from_secs(60);
/// Time between two pieces of an answer.
const IDLE: Duration = Duration::from_secs(30);

/// Makes the HTTP client of a bucket.
#[derive(Debug)]
pub(super) struct Connector(Service);

#[derive(Debug, Clone)]
struct Service(HttpsClient<HttpRequestBody>);

impl Connector {
    /// A client that trusts the public certificate authorities, and those in `ca_file`.
    pub(super) fn new(ca_file: Option<&Path>) -> anyhow::Result<Self> {
        Ok(Self(Service(https::client("storage_ca_file", ca_file)?)))
    }
}

impl Connector {
    /// The client itself.
    pub(super) fn client(&self) -> HttpClient {
        HttpClient::new(self.0.clone())
    }
}

impl HttpConnector for Connector {
    fn connect(&self, _options: &ClientOptions) -> object_store::Result<HttpClient> {
        Ok(self.client())
    }
}

#[async_trait]
impl HttpService for Service {
    async fn call(&self, request: HttpRequest) -> Result<HttpResponse, HttpError> {
        let answer = timeout(ANSWER, self.0.request(request)).await;
        let answer = answer.map_err(|late| HttpError::new(HttpErrorKind::Timeout, late))?;
        let (head, body) = answer.map_err(|error| HttpError::new(kind(&error), error))?.into_parts();
        Ok(HttpResponse::from_parts(head, HttpResponseBody::new(StreamBody::new(frames(body)))))
    }
}

/// The pieces of an answer, each within its time limit.
fn frames(body: Incoming) -> impl futures::Stream<Item = Result<Frame<Bytes>, HttpError>> {
    futures::stream::try_unfold(body, async |mut body| {
        let next = timeout(IDLE, body.frame()).await;
        let next = next.map_err(|late| HttpError::new(HttpErrorKind::Timeout, late))?;
        let frame = next.transpose().map_err(|error| HttpError::new(HttpErrorKind::Interrupted, error))?;
        Ok(frame.map(|frame| (frame, body)))
    })
}

/// What a failed request means for whether it can be repeated.
fn kind(error: &hyper_util::client::legacy::Error) -> HttpErrorKind {
    if error.is_connect() {
        return HttpErrorKind::Connect;
    }
    let mut cause = error.source();
    while let Some(error) = cause {
        if let Some(error) = error.downcast_ref::<hyper::Error>()
            && (error.is_canceled() || error.is_closed() || error.is_incomplete_message())
        {
            return HttpErrorKind::Request;
        }
        if error.is::<std::io::Error>() {
            return HttpErrorKind::Interrupted;
        }
        cause = error.source();
    }
    HttpErrorKind::Unknown
}
