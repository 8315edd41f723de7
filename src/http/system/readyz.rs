//! `GET /readyz`

use axum::{Json, extract::State, http::StatusCode};
use serde::Serialize;
use utoipa::ToSchema;

use crate::http::{App, state::health::Health};

/// Whether the service can accept work.
#[derive(Serialize, ToSchema)]
pub struct Readiness {
    /// True when every check passes.
    ready: bool,
    /// The checks.
    checks: Checks,
}

/// The checks.
#[derive(Serialize, ToSchema)]
pub struct Checks {
    /// The database answers, and rows can be written.
    database: Check,
    /// Files can be written and renamed.
    blobs: Check,
    /// There is free disk space.
    disk: DiskCheck,
    /// A worker is alive, or this process has none (`workers = 0`).
    workers: Check,
    /// The server is not shutting down.
    running: Check,
}

/// One check.
#[derive(Serialize, ToSchema)]
pub struct Check {
    /// Whether the check passes.
    ok: bool,
}

/// Disk space.
#[derive(Serialize, ToSchema)]
pub struct DiskCheck {
    /// More is free than must stay free.
    ok: bool,
    /// Bytes that can still be written; null when unknown.
    free_bytes: Option<u64>,
    /// Bytes that uploads, jobs and conversions in progress have reserved and not written yet.
    reserved_bytes: u64,
    /// Bytes that must stay free.
    min_free_bytes: u64,
}

/// Readiness check
///
/// Checks the database, the blob store, the free disk space and the workers, at most once a second.
#[utoipa::path(
    get,
    path = "/readyz",
    operation_id = "get_readiness",
    tag = "service",
    responses(
        (status = 200, description = "Ready", body = Readiness),
        (status = 503, description = "Not ready; see the checks that fail", body = Readiness),
    )
)]
pub async fn readyz(State(app): State<App>) -> (StatusCode, Json<Readiness>) {
    let Health { database, blobs, workers, has_room, free_bytes } = app.health.last().await;
    let checks = Checks {
        database: Check { ok: database },
        blobs: Check { ok: blobs },
        disk: DiskCheck {
            ok: has_room,
            free_bytes,
            reserved_bytes: app.disk.reserved(),
            min_free_bytes: app.policy.min_free_bytes,
        },
        workers: Check { ok: workers },
        running: Check { ok: !app.shutdown.is_cancelled() },
    };
    let ready = checks.database.ok && checks.blobs.ok && checks.disk.ok && workers && checks.running.ok;
    let status = if ready { StatusCode::OK } else { StatusCode::SERVICE_UNAVAILABLE };
    (status, Json(Readiness { ready, checks }))
}
