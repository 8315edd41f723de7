//! The HTTP connection to the bucket: hyper with rustls and ring, as everywhere else in the service.
//!
//! Each request has a time limit until the head of its answer, and each piece of an answer another. A request that
//! fails is repeated by `object_store`, within the limits that [`super::bucket`] sets.

use std::{error::Error, path::Path, sync::Arc, time::Duration};

use anyhow::Context;
use async_trait::async_trait;
use bytes::Bytes;
use http_body_util::{BodyExt, StreamBody};
use hyper::body::{Frame, Incoming};
use hyper_rustls::{HttpsConnector, HttpsConnectorBuilder};
use hyper_util::{
    client::legacy::{Client, connect::HttpConnector as TcpConnector},
    rt::{TokioExecutor, TokioTimer},
};
use object_store::{
    ClientOptions,
    client::{
        HttpClient, HttpConnector, HttpError, HttpErrorKind, HttpRequest, HttpRequestBody, HttpResponse,
        HttpResponseBody, HttpService,
    },
};
use tokio::time::timeout;
use tokio_rustls::rustls::{
    ClientConfig, RootCertStore,
    crypto::ring,
    pki_types::{CertificateDer, pem::PemObject},
};

/// Time until a connection exists.
const CONNECT: Duration = Duration::from_secs(5);
/// Time from the start of a request, whose body has a few MiB, to the head of the answer.
const ANSWER: Duration = Duration::from_secs(60);
/// Time between two pieces of an answer.
const IDLE: Duration = Duration::from_secs(30);
/// How long a connection is kept for the next request. Servers close theirs after about a minute.
const KEEP: Duration = Duration::from_secs(20);

/// Makes the HTTP client of a bucket.
#[derive(Debug)]
pub(super) struct Connector(Service);

#[derive(Debug, Clone)]
struct Service(Client<HttpsConnector<TcpConnector>, HttpRequestBody>);

impl Connector {
    /// A client that trusts the public certificate authorities, and those in `ca_file`.
    ///
    /// # Errors
    /// When the file has no certificate.
    pub(super) fn new(ca_file: Option<&Path>) -> anyhow::Result<Self> {
        let mut tcp = TcpConnector::new();
        tcp.set_connect_timeout(Some(CONNECT));
        tcp.set_nodelay(true);
        // that only https is used is decided by the URL of the server
        tcp.enforce_http(false);
        let https = HttpsConnectorBuilder::new().with_tls_config(tls(ca_file)?).https_or_http().enable_http1();
        let mut client = Client::builder(TokioExecutor::new());
        client.pool_timer(TokioTimer::new()).pool_idle_timeout(KEEP);
        Ok(Self(Service(client.build(https.wrap_connector(tcp)))))
    }
}

fn tls(ca_file: Option<&Path>) -> anyhow::Result<ClientConfig> {
    let mut roots = RootCertStore::from_iter(webpki_roots::TLS_SERVER_ROOTS.iter().cloned());
    if let Some(file) = ca_file {
        let what = || format!("storage_ca_file: cannot read a certificate in PEM from {}", file.display());
        let certificates: Vec<_> =
            CertificateDer::pem_file_iter(file).and_then(Iterator::collect::<Result<_, _>>).with_context(what)?;
        if certificates.is_empty() {
            anyhow::bail!(what());
        }
        for certificate in certificates {
            roots.add(certificate).with_context(what)?;
        }
    }
    let builder = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_safe_default_protocol_versions()?;
    Ok(builder.with_root_certificates(roots).with_no_client_auth())
}

impl HttpConnector for Connector {
    fn connect(&self, _options: &ClientOptions) -> object_store::Result<HttpClient> {
        Ok(HttpClient::new(self.0.clone()))
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
