//! The HTTP client of the connections that the service itself opens: to a bucket, to a collector of traces.
//!
//! hyper with rustls and ring, as everywhere else in the service. A library that brought its own client would bring a
//! second TLS, or replace that of every other client in the process.

use std::{path::Path, sync::Arc, time::Duration};

use anyhow::Context;
use hyper::body::Body;
use hyper_rustls::{HttpsConnector, HttpsConnectorBuilder};
use hyper_util::{
    client::legacy::{Client, connect::HttpConnector},
    rt::{TokioExecutor, TokioTimer},
};
use tokio_rustls::rustls::{
    ClientConfig, RootCertStore,
    crypto::ring,
    pki_types::{CertificateDer, pem::PemObject},
};

/// Time until a connection exists.
const CONNECT: Duration = Duration::from_secs(5);
/// How long a connection is kept for the next request. Servers close theirs after about a minute.
const KEEP: Duration = Duration::from_secs(20);

/// A client for requests with bodies of the type `B`. Its requests have no time limit.
pub type HttpsClient<B> = Client<HttpsConnector<HttpConnector>, B>;

/// A client that trusts the public certificate authorities, and those in `ca_file`, the value of the setting `setting`.
///
/// # Errors
/// When the file has no certificate.
pub fn client<B>(setting: &str, ca_file: Option<&Path>) -> anyhow::Result<HttpsClient<B>>
where
    B: Body + Send,
    B::Data: Send,
{
    let mut tcp = HttpConnector::new();
    tcp.set_connect_timeout(Some(CONNECT));
    tcp.set_nodelay(true);
    // that only https is used is decided by the URL of the server
    tcp.enforce_http(false);
    let https = HttpsConnectorBuilder::new().with_tls_config(tls(setting, ca_file)?).https_or_http().enable_http1();
    let mut client = Client::builder(TokioExecutor::new());
    client.pool_timer(TokioTimer::new()).pool_idle_timeout(KEEP);
    Ok(client.build(https.wrap_connector(tcp)))
}

fn tls(setting: &str, ca_file: Option<&Path>) -> anyhow::Result<ClientConfig> {
    let mut roots = RootCertStore::from_iter(webpki_roots::TLS_SERVER_ROOTS.iter().cloned());
    if let Some(file) = ca_file {
        let what = || format!("{setting}: cannot read a certificate in PEM from {}", file.display());
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
