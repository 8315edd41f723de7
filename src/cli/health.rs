//! `pinstack health`: the health check of a container, which has no curl.

use std::{path::PathBuf, time::Duration};

use anyhow::{Context, bail};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
    time::timeout,
};
use tokio_rustls::rustls::pki_types::ServerName;

use super::{output::say, tls};

/// Timeout of the check.
const TIMEOUT: Duration = Duration::from_secs(5);

/// Flags of `pinstack health`.
#[derive(Debug, clap::Args)]
pub struct Flags {
    /// Base URL of the server [default: the address in PINSTACK_LISTEN, or http://127.0.0.1:8080]
    url: Option<String>,
    /// The certificate that a TLS server must present [env: PINSTACK_TLS_CERT]
    #[arg(long, value_name = "FILE", env = "PINSTACK_TLS_CERT", hide_env = true)]
    tls_cert: Option<PathBuf>,
}

/// Requests `GET /readyz`.
///
/// # Errors
/// When the server does not answer, or is not ready.
pub fn run(flags: &Flags) -> anyhow::Result<()> {
    let url = flags.url.clone().unwrap_or_else(|| listened_url(std::env::var("PINSTACK_LISTEN").ok().as_deref()));
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    if let Some(certificate) = &flags.tls_cert {
        let address = url.split_once("://").map_or(url.as_str(), |(_, address)| address).trim_end_matches('/');
        let asked = runtime.block_on(async { timeout(TIMEOUT, ask_by_tls(address, certificate)).await });
        return asked.with_context(|| format!("https://{address} does not answer"))?;
    }
    let url = format!("{}/readyz", url.trim_end_matches('/'));
    runtime.block_on(async {
        // no proxy from the environment: the server is on this machine
        let client = reqwest::Client::builder().no_proxy().timeout(TIMEOUT).build()?;
        let answer = client.get(&url).send().await.with_context(|| format!("{url} does not answer"))?;
        let status = answer.status();
        let body = answer.text().await.unwrap_or_default();
        say(&body);
        if !status.is_success() {
            bail!("{url} answers {status}");
        }
        Ok(())
    })
}

/// The same over TLS.
async fn ask_by_tls(address: &str, certificate: &std::path::Path) -> anyhow::Result<()> {
    let connector = tls::pinned_connector(certificate)?;
    let stream = TcpStream::connect(address).await.with_context(|| format!("https://{address} does not answer"))?;
    let name = ServerName::from(stream.peer_addr()?.ip());
    let mut stream = connector
        .connect(name, stream)
        .await
        .with_context(|| format!("https://{address} does not present the certificate {}", certificate.display()))?;
    let request = format!("GET /readyz HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).await?;
    stream.flush().await?;
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).await?;
    let answer = String::from_utf8_lossy(&answer);
    let (head, body) = answer.split_once("\r\n\r\n").unwrap_or((&answer, ""));
    say(body);
    let status = head.split_whitespace().nth(1).unwrap_or("without a status");
    if status != "200" {
        bail!("https://{address}/readyz answers {status}");
    }
    Ok(())
}

/// The URL at which this machine reaches a server that listens on `listen`.
fn listened_url(listen: Option<&str>) -> String {
    let listen = listen.unwrap_or(crate::settings::DEFAULT_LISTEN);
    let reachable = listen.replace("0.0.0.0:", "127.0.0.1:").replace("[::]:", "[::1]:");
    format!("http://{reachable}")
}

#[cfg(test)]
mod tests {
    use super::listened_url;

    #[test]
    fn a_wildcard_address_is_reached_at_the_loopback_address() {
        assert_eq!(listened_url(None), "http://127.0.0.1:8080");
        assert_eq!(listened_url(Some("0.0.0.0:9000")), "http://127.0.0.1:9000");
        assert_eq!(listened_url(Some("[::]:9000")), "http://[::1]:9000");
    }
}
