//! The service on a socket.

use std::{future::IntoFuture, time::Duration};

use tokio::{net::TcpListener, time::timeout};

use super::{router, state::App, system};

/// How long requests in progress may take once the server goes down.
const GRACE: Duration = Duration::from_secs(30);
/// How often the samples of the request times are put into their buckets: they pile up until then.
const UPKEEP: Duration = Duration::from_secs(5);

/// Serves until `app.shutdown` fires, then lets requests in progress end.
///
/// # Errors
/// When the socket fails.
pub async fn serve(app: App, listener: TcpListener) -> std::io::Result<()> {
    let shutdown = app.shutdown.clone();
    let upkeep = tokio::spawn(upkeep());
    let server = axum::serve(listener, router::service(app))
        .with_graceful_shutdown(shutdown.clone().cancelled_owned())
        .into_future();
    tokio::pin!(server);
    let served = tokio::select! {
        served = &mut server => served,
        () = shutdown.cancelled() => match timeout(GRACE, &mut server).await {
            Ok(served) => served,
            Err(_) => {
                tracing::warn!("requests were still in progress and are cut off");
                Ok(())
            }
        },
    };
    upkeep.abort();
    served
}

async fn upkeep() {
    let Ok(recorder) = system::metrics::recorder() else { return };
    loop {
        tokio::time::sleep(UPKEEP).await;
        recorder.run_upkeep();
    }
}
