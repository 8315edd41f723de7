//! The service on a socket: connections taken, limited, and let end.

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
    connections::{Reading, Seat, Slots, slots::RESERVE},
    router,
    state::App,
};
use crate::telemetry;

/// How long requests in progress may take once the server goes down.
const GRACE: Duration = Duration::from_secs(10);
/// Sockets beside those that have a slot: the reserve, and those of it that are on their way out.
pub const SPARE_SOCKETS: usize = 2 * RESERVE;
/// How often the samples of the request times are put into their buckets: they pile up until then.
const UPKEEP: Duration = Duration::from_secs(5);
/// Pause when no connection can be taken, because there are no file handles left, say.
const ACCEPT_PAUSE: Duration = Duration::from_millis(500);

/// Serves until `app.shutdown` fires, then lets requests in progress end.
///
/// # Errors
/// Never, at present: a connection that fails is not the server's failure.
pub async fn serve(app: App, listener: TcpListener) -> io::Result<()> {
    serve_over(app, listener, None).await
}

/// The same, over TLS when there is an acceptor.
///
/// # Errors
/// As [`serve`].
pub async fn serve_over(app: App, listener: TcpListener, tls: Option<TlsAcceptor>) -> io::Result<()> {
    let upkeep = tokio::spawn(upkeep());
    let connections = GracefulShutdown::new();
    accept_all(&app, &listener, tls, &connections).await;
    drop(listener);
    if timeout(GRACE, connections.shutdown()).await.is_err() {
        tracing::warn!("requests were still in progress and are cut off");
    }
    upkeep.abort();
    Ok(())
}

/// Takes connections until the server goes down. One over the limit waits without a slot, and when too many do, in the
/// kernel's queue.
async fn accept_all(app: &App, listener: &TcpListener, tls: Option<TlsAcceptor>, connections: &GracefulShutdown) {
    let router = router::service(app.clone());
    let slots = Slots::new(&app.policy, app.shutdown.clone());
    // those that give way are still there while they say so
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
                // answers are written whole: waiting for more only delays them
                if let Err(error) = stream.set_nodelay(true) {
                    tracing::debug!(%error, "TCP_NODELAY");
                }
                let stream = Reading::new(stream, app.policy.body_idle_timeout);
                tokio::spawn(connection.serve(stream, tls.clone()));
            }
            Err(error) if is_of_one_connection(&error) => {}
            Err(error) => {
                tracing::error!(%error, "cannot take a connection");
                sleep(ACCEPT_PAUSE).await;
            }
        }
    }
}

/// The client went away before it was taken: nothing is wrong here.
fn is_of_one_connection(error: &io::Error) -> bool {
    use io::ErrorKind::{ConnectionAborted, ConnectionRefused, ConnectionReset};
    matches!(error.kind(), ConnectionAborted | ConnectionRefused | ConnectionReset)
}

/// One connection; its slot is free again once it has ended.
struct Connection {
    router: Router,
    seat: Arc<Seat>,
    header_timeout: Duration,
    watcher: Watcher,
    _socket: OwnedSemaphorePermit,
}

impl Connection {
    async fn serve(self, stream: Reading<TcpStream>, tls: Option<TlsAcceptor>) {
        let seat = Arc::clone(&self.seat);
        tokio::select! {
            () = self.greet(stream, tls) => {}
            () = seat.gave_way() => tracing::debug!("a connection without a slot gave way to a newer one"),
        }
    }

    async fn greet(self, stream: Reading<TcpStream>, tls: Option<TlsAcceptor>) {
        let Some(tls) = tls else { return self.speak(stream).await };
        match timeout(self.header_timeout, tls.accept(stream)).await {
            Ok(Ok(stream)) => self.speak(stream).await,
            Ok(Err(error)) => tracing::debug!(%error, "no TLS connection came about"),
            Err(_) => tracing::debug!("a client was too slow with its TLS handshake"),
        }
    }

    async fn speak(self, stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static) {
        let (router, seat) = (self.router, self.seat);
        let service = service_fn(move |request: Request<Incoming>| {
            let mut request = request.map(Body::new);
            request.extensions_mut().insert(Arc::clone(&seat));
            router.clone().oneshot(request)
        });
        let connection = http1::Builder::new()
            .timer(TokioTimer::new())
            // a head that comes byte by byte, and a connection on which nothing is asked, do not hold a slot for ever
            .header_read_timeout(self.header_timeout)
            .serve_connection(TokioIo::new(stream), service);
        if let Err(error) = self.watcher.watch(connection).await {
            tracing::debug!(%error, "a connection broke");
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
