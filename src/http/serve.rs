//! The server: accepts connections, limits them, and shuts down gracefully.

use std::{io, sync::Arc, time::Duration};

use axum::{Router, body::Body};
use hyper::{Request, body::Incoming, server::conn::http1, service::service_fn};
use hyper_util::{
    rt::{TokioIo, TokioTimer},
    server::graceful::{GracefulShutdown, Watcher},
};
use tokio::{
    io::{AsyncRead, AsyncWrite},
    net::{TcpListener, TcpStream},
    sync::{OwnedSemaphorePermit, Semaphore},
    time::{sleep, timeout},
};
use tokio_rustls::TlsAcceptor;
use tower::ServiceExt;

use super::{
    App,
    connections::{Seat, Slots, WriteTimeout, slots::RESERVE},
    reconstructions::auto,
    router,
    session::OverTls,
};
use crate::{supervision::supervised, telemetry};

/// How long requests in progress may take after the shutdown begins.
const GRACE: Duration = Duration::from_secs(10);
/// Sockets besides those with a slot: the reserve, and as many that are being closed.
pub const SPARE_SOCKETS: usize = 2 * RESERVE;
/// How often the samples of the histograms are moved to their buckets; they accumulate in memory until then.
const UPKEEP: Duration = Duration::from_secs(5);
/// Pause when no connection can be accepted, for example because no file descriptors are left.
const ACCEPT_PAUSE: Duration = Duration::from_millis(500);

/// Serves until `app.shutdown` fires, then waits for requests in progress.
///
/// # Errors
/// None at present: the failure of a connection is not a failure of the server.
pub async fn serve(app: App, listener: TcpListener) -> io::Result<()> {
    serve_over(app, listener, None).await
}

/// As [`serve`], over TLS if there is an acceptor.
///
/// # Errors
/// As [`serve`].
pub async fn serve_over(app: App, listener: TcpListener, tls: Option<TlsAcceptor>) -> io::Result<()> {
    #[expect(clippy::disallowed_methods, reason = "it belongs to no request")]
    let upkeep = tokio::spawn(supervised("upkeep of the metrics", upkeep));
    #[expect(clippy::disallowed_methods, reason = "it belongs to no request")]
    let auto = tokio::spawn(supervised("reconstructions without a request", {
        let app = app.clone();
        move || auto::watch(app.clone())
    }));
    let connections = GracefulShutdown::new();
    supervised("accept loop", || accept_all(&app, &listener, tls.clone(), &connections)).await;
    drop(listener);
    if timeout(GRACE, connections.shutdown()).await.is_err() {
        tracing::warn!("requests still in progress are aborted");
    }
    upkeep.abort();
    auto.abort();
    Ok(())
}

/// Accepts connections until the shutdown. A connection over the limit waits without a slot. Beyond the reserve for
/// those, connections wait in the queue of the kernel.
async fn accept_all(app: &App, listener: &TcpListener, tls: Option<TlsAcceptor>, connections: &GracefulShutdown) {
    let router = router::service(app.clone());
    let slots = Slots::new(&app.policy, app.shutdown.clone());
    // evicted connections still have a socket while they send their last answer
    let sockets = Arc::new(Semaphore::new(app.policy.max_connections + SPARE_SOCKETS));
    let next = async || {
        let socket = Arc::clone(&sockets).acquire_owned().await.map_err(io::Error::other)?;
        let (stream, peer) = listener.accept().await?;
        Ok::<_, io::Error>((stream, peer, socket))
    };
    loop {
        let accepted = tokio::select! {
            () = app.shutdown.cancelled() => return,
            accepted = next() => accepted,
        };
        match accepted {
            Ok((stream, peer, socket)) => {
                let connection = Connection {
                    router: router.clone(),
                    seat: slots.seat(peer.ip()),
                    header_timeout: app.policy.header_timeout,
                    watcher: connections.watcher(),
                    _socket: socket,
                };
                // answers are written whole, so Nagle's algorithm would only delay them
                if let Err(error) = stream.set_nodelay(true) {
                    tracing::debug!(%error, "TCP_NODELAY");
                }
                let stream = WriteTimeout::new(stream, app.policy.body_idle_timeout);
                #[expect(clippy::disallowed_methods, reason = "no request has arrived on it")]
                tokio::spawn(connection.serve(stream, tls.clone()));
            }
            Err(error) if is_of_one_connection(&error) => {}
            Err(error) => {
                tracing::error!(%error, "cannot accept a connection");
                sleep(ACCEPT_PAUSE).await;
            }
        }
    }
}

/// True when the client closed the connection before it was accepted. That is not an error of the server.
fn is_of_one_connection(error: &io::Error) -> bool {
    use io::ErrorKind::{ConnectionAborted, ConnectionRefused, ConnectionReset};
    matches!(error.kind(), ConnectionAborted | ConnectionRefused | ConnectionReset)
}

/// One connection. Its slot is released when it ends.
struct Connection {
    router: Router,
    seat: Arc<Seat>,
    header_timeout: Duration,
    watcher: Watcher,
    _socket: OwnedSemaphorePermit,
}

impl Connection {
    async fn serve(self, stream: WriteTimeout<TcpStream>, tls: Option<TlsAcceptor>) {
        let seat = Arc::clone(&self.seat);
        tokio::select! {
            () = self.greet(stream, tls) => {}
            () = seat.was_evicted() => tracing::debug!("a connection without a slot was closed in favour of a newer one"),
        }
    }

    async fn greet(self, stream: WriteTimeout<TcpStream>, tls: Option<TlsAcceptor>) {
        let Some(tls) = tls else { return self.speak(stream, None).await };
        match timeout(self.header_timeout, tls.accept(stream)).await {
            Ok(Ok(stream)) => self.speak(stream, Some(OverTls)).await,
            Ok(Err(error)) => tracing::debug!(%error, "TLS handshake failed"),
            Err(_) => tracing::debug!("TLS handshake timed out"),
        }
    }

    async fn speak(self, stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static, tls: Option<OverTls>) {
        let (router, seat) = (self.router, self.seat);
        let service = service_fn(move |request: Request<Incoming>| {
            let mut request = request.map(Body::new);
            request.extensions_mut().insert(Arc::clone(&seat));
            if let Some(tls) = tls {
                request.extensions_mut().insert(tls);
            }
            router.clone().oneshot(request)
        });
        let connection = http1::Builder::new()
            .timer(TokioTimer::new())
            // ends connections that send a head byte by byte or stay idle, which would hold a slot
            .header_read_timeout(self.header_timeout)
            .serve_connection(TokioIo::new(stream), service);
        if let Err(error) = self.watcher.watch(connection).await {
            tracing::debug!(%error, "a connection failed");
        }
    }
}

async fn upkeep() {
    let Ok(recorder) = telemetry::recorder() else { return };
    loop {
        sleep(UPKEEP).await;
        recorder.run_upkeep();
    }
}
