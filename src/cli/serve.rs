//! `pinstack serve`: the API and the workers.

use std::{fs::Permissions, io::Write, net::SocketAddr, os::unix::fs::PermissionsExt, path::Path, sync::Arc};

use anyhow::Context;
use tokio::{net::TcpListener, task::JoinHandle};
use tokio_util::sync::CancellationToken;

use super::{
    access::{TokensRequired, tokens_required},
    files, logging, memory,
    process::{GRACE, StopSignals},
    store::{create, make_files_private},
    tls,
};
use crate::{
    http::{self, App},
    jobs::ScienceRunner,
    settings::{Flags, Policy, Settings},
    telemetry::{self, traces},
    worker::{Deps, Pool, maintenance},
};

/// Runs until SIGTERM or SIGINT; a second signal ends the process at once.
///
/// # Errors
/// When the configuration is invalid, the data folder cannot be used, or the address is in use.
pub fn run(flags: Flags) -> anyhow::Result<()> {
    let config = Settings::load(&flags)?;
    logging::start(&config.log, config.log_format)?;
    make_files_private();
    tokio::runtime::Runtime::new()?.block_on(async {
        let traces = config.collector().map(traces::start).transpose()?;
        let service = Service::start(&config).await?;
        let signals = StopSignals::listen()?;
        let scheme = if config.tls_cert.is_some() { "https" } else { "http" };
        logging::announce(config.log_format, &format!("listening on {scheme}://{}", service.address()));
        if let Some(file) = &config.port_file {
            write_port_file(file, service.address())?;
        }
        signals.end_by(stop(service, traces)).await
    })
}

/// Stops the service, then sends the last spans.
async fn stop(service: Service, traces: Option<traces::Export>) -> anyhow::Result<()> {
    let stopped = service.stop().await;
    if let Some(traces) = traces {
        traces.stop().await;
    }
    stopped
}

/// A running service: server, workers, maintenance.
pub struct Service {
    address: SocketAddr,
    shutdown: CancellationToken,
    server: JoinHandle<std::io::Result<()>>,
    pool: Pool,
    _maintenance: maintenance::Maintenance,
}

impl Service {
    /// Opens the store, starts the workers, and listens.
    ///
    /// # Errors
    /// When the data folder cannot be used or the address is in use.
    pub async fn start(config: &Settings) -> anyhow::Result<Self> {
        let tls = match (&config.tls_cert, &config.tls_key) {
            (Some(certificate), Some(key)) => Some(tls::acceptor(certificate, key)?),
            _ => None,
        };
        // before anything that is counted
        telemetry::recorder().map_err(anyhow::Error::msg)?;
        let store = create(config).await?;
        let listener = TcpListener::bind(&config.listen)
            .await
            .with_context(|| format!("listen: cannot listen on {}", config.listen))?;
        let address = listener.local_addr()?;

        let colmap = config.colmap();
        let required = tokens_required(config.auth, address.ip(), &*store.metadata).await?;
        let policy = Policy {
            auth_required: required == TokensRequired::Always,
            auth_once_there_are_tokens: required == TokensRequired::OnceThereAreTokens,
            listen: Some(address.ip()),
            max_connections: connections(config),
            hosts: hosts(config),
            reconstructs: colmap.is_some() || config.workers == 0 || config.database()?.is_some(),
            ..config.clone().into()
        };
        let app = App::new(store.clone(), policy);
        let shutdown = app.shutdown.clone();
        let worker = memory::within(config.worker());
        let science = ScienceRunner {
            archive_limits: app.policy.archive,
            memory: worker.memory_limit,
            colmap,
            ..ScienceRunner::default()
        };
        let (disk, health, runner) = (Arc::clone(&app.disk), Arc::clone(&app.health), Arc::new(science));
        let deps = Deps { store: store.clone(), disk, runner };
        let pool = Pool::start(deps, worker);
        if config.workers > 0 {
            health.watch_workers(pool.alive());
        }
        let maintenance = maintenance::start(store, maintenance::EVERY, config.retention());
        let server = tokio::spawn(http::serve_over(app, listener, tls));
        Ok(Self { address, shutdown, server, pool, _maintenance: maintenance })
    }

    /// The address that it listens on.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Shuts down: accepts nothing new, waits for requests and jobs, and returns unfinished jobs to the queue.
    ///
    /// # Errors
    /// When the server failed.
    pub async fn stop(self) -> anyhow::Result<()> {
        self.shutdown.cancel();
        let (served, ()) = tokio::join!(self.server, self.pool.shutdown(GRACE));
        Ok(served??)
    }
}

/// `max_connections`, lowered to what the limit of open files allows.
fn connections(config: &Settings) -> usize {
    let limit = files::raise_limit();
    let fit = files::fitting(config.max_connections, config.workers, limit);
    if fit < config.max_connections {
        let (wanted, limit) = (config.max_connections, limit.unwrap_or(u64::MAX));
        tracing::warn!(
            wanted,
            fit,
            limit,
            "max_connections is lowered: the process may not open more files (ulimit -n)"
        );
    }
    fit
}

/// The host names of the service: those of the setting, and the one in `listen`.
fn hosts(config: &Settings) -> Vec<String> {
    let listened = config.listen.rsplit_once(':').map(|(host, _)| host.to_owned());
    config.hosts.iter().cloned().chain(listened).collect()
}

/// Writes the address atomically, so that no reader sees half of it. The temporary file has a name of its own: two
/// servers may write `data.port-1` and `data.port-2` at the same time.
fn write_port_file(file: &Path, address: SocketAddr) -> anyhow::Result<()> {
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // a temporary file is for its owner alone otherwise; this one is for the program that waits for the server
    let readable = Permissions::from_mode(0o666);
    let write = || -> std::io::Result<()> {
        let mut new = tempfile::Builder::new().permissions(readable).tempfile_in(folder)?;
        writeln!(new, "{address}")?;
        new.persist(file)?;
        Ok(())
    };
    write().with_context(|| format!("port_file: cannot write {}", file.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn servers_that_start_at_once_write_a_port_file_each_and_touch_no_other_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let in_it = |name: &str| folder.path().join(name);
        std::fs::write(in_it("data.new"), "of another program").expect("a file");
        std::thread::scope(|threads| {
            for server in 1..5u16 {
                let file = in_it(&format!("data.port-{server}"));
                threads.spawn(move || {
                    for attempt in 0..200 {
                        let address = SocketAddr::from(([127, 0, 0, 1], 1000 * server + attempt));
                        write_port_file(&file, address).expect("written");
                        assert_eq!(std::fs::read_to_string(&file).expect("there"), format!("{address}\n"));
                    }
                });
            }
        });
        assert_eq!(std::fs::read_to_string(in_it("data.new")).expect("there"), "of another program");
        assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 5);
        let mode = std::fs::metadata(in_it("data.port-1")).expect("there").permissions().mode();
        assert_eq!(mode & 0o400, 0o400);
    }

    #[test]
    fn a_port_file_that_cannot_be_written_is_named() {
        let error = write_port_file(Path::new("/no/such/folder/port"), SocketAddr::from(([127, 0, 0, 1], 1)));
        let text = format!("{:#}", error.expect_err("there is no such folder"));
        assert!(text.starts_with("port_file: cannot write /no/such/folder/port: "), "{text}");
    }
}
