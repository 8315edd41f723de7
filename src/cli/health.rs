//! `pinstack health`: for the health check of a container, which has no curl.

use std::time::Duration;

use anyhow::{Context, bail};

/// How long the server may take to answer.
const PATIENCE: Duration = Duration::from_secs(5);

/// Flags of `pinstack health`.
#[derive(Debug, clap::Args)]
pub struct Flags {
    /// Base URL of the server [default: the address in PINSTACK_LISTEN, or http://127.0.0.1:8080]
    url: Option<String>,
}

/// Asks `GET /readyz`.
///
/// # Errors
/// When the server does not answer, or is not ready.
pub fn run(flags: &Flags) -> anyhow::Result<()> {
    let url = flags.url.clone().unwrap_or_else(|| listened_url(std::env::var("PINSTACK_LISTEN").ok().as_deref()));
    let url = format!("{}/readyz", url.trim_end_matches('/'));
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        // a proxy of the environment does not lead to this machine
        let client = reqwest::Client::builder().no_proxy().timeout(PATIENCE).build()?;
        let answer = client.get(&url).send().await.with_context(|| format!("{url} does not answer"))?;
        let status = answer.status();
        let body = answer.text().await.unwrap_or_default();
        println!("{body}");
        if !status.is_success() {
            bail!("{url} answers {status}");
        }
        Ok(())
    })
}

/// Where a server that listens on `listen` can be reached from this machine.
fn listened_url(listen: Option<&str>) -> String {
    let listen = listen.unwrap_or(super::config::DEFAULT_LISTEN);
    let reachable = listen.replace("0.0.0.0:", "127.0.0.1:").replace("[::]:", "[::1]:");
    format!("http://{reachable}")
}

#[cfg(test)]
mod tests {
    use super::listened_url;

    #[test]
    fn an_address_for_everybody_is_reached_on_this_machine() {
        assert_eq!(listened_url(None), "http://127.0.0.1:8080");
        assert_eq!(listened_url(Some("0.0.0.0:9000")), "http://127.0.0.1:9000");
        assert_eq!(listened_url(Some("[::]:9000")), "http://[::1]:9000");
    }
}
