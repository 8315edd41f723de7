//! `GET /readyz`

use axum::{Json, extract::State, http::StatusCode};
use serde::Serialize;
use utoipa::ToSchema;

use crate::http::state::App;

/// Whether the service can take work.
#[derive(Serialize, ToSchema)]
pub struct Readiness {
    /// True when every check holds.
    ready: bool,
    /// The checks.
    checks: Checks,
}

/// Every check.
#[derive(Serialize, ToSchema)]
pub struct Checks {
    /// The database answers.
    database: Check,
    /// Files can be written and moved into place.
    blobs: Check,
    /// There is room on the disk.
    disk: DiskCheck,
    /// The server is not going down.
    running: Check,
}

/// One check.
#[derive(Serialize, ToSchema)]
pub struct Check {
    /// Holds.
    ok: bool,
}

/// Room on the disk.
#[derive(Serialize, ToSchema)]
pub struct DiskCheck {
    /// More is free than must stay free.
    ok: bool,
    /// Bytes that can still be written; null when that cannot be told.
    free_bytes: Option<u64>,
    /// Bytes that uploads, jobs and conversions in progress have reserved and not written yet.
    reserved_bytes: u64,
    /// Bytes that must stay free.
    min_free_bytes: u64,
}

/// What was found when somebody last looked.
#[derive(Debug, Clone, Copy)]
pub struct Look {
    database: bool,
    blobs: bool,
    has_room: bool,
    free_bytes: Option<u64>,
}

/// Able to take work?
///
/// Looks at the database, the blob store and the room on the disk, at most once a second.
#[utoipa::path(
    get,
    path = "/readyz",
    operation_id = "get_readiness",
    tag = "service",
    responses(
        (status = 200, description = "Ready", body = Readiness),
        (status = 503, description = "Not ready; the checks say why", body = Readiness),
    )
)]
pub async fn readyz(State(app): State<App>) -> (StatusCode, Json<Readiness>) {
    let Look { database, blobs, has_room, free_bytes } = app.readiness.get(async || look(&app).await).await;
    let checks = Checks {
        database: Check { ok: database },
        blobs: Check { ok: blobs },
        disk: DiskCheck {
            ok: has_room,
            free_bytes,
            reserved_bytes: app.disk.reserved(),
            min_free_bytes: app.policy.min_free_bytes,
        },
        running: Check { ok: !app.shutdown.is_cancelled() },
    };
    let ready = checks.database.ok && checks.blobs.ok && checks.disk.ok && checks.running.ok;
    let status = if ready { StatusCode::OK } else { StatusCode::SERVICE_UNAVAILABLE };
    (status, Json(Readiness { ready, checks }))
}

/// It writes a file, so it must not be had at any rate that a client likes.
async fn look(app: &App) -> Look {
    let disk = app.disk.state().await.ok();
    Look {
        database: app.store.metadata.healthy().await,
        blobs: is_writable(app).await,
        has_room: disk.is_some_and(|disk| disk.available() > 0),
        free_bytes: disk.map(|disk| disk.free),
    }
}

async fn is_writable(app: &App) -> bool {
    app.store.blobs.probe().await.inspect_err(|error| tracing::error!(?error, "files cannot be stored")).is_ok()
}
