//! `GET /v1/info`

use axum::{Json, extract::State};
use serde::Serialize;
use utoipa::ToSchema;
use uuid::Uuid;

use crate::{
    contract::options::StackOptions,
    http::{ApiResult, App, extract::prefer::MAX_WAIT_S},
};
use pinstack_science::types::profile::MAX_SLICES;

/// The service: version, limits, formats, defaults.
#[derive(Serialize, ToSchema)]
pub struct Info {
    /// `pinstack`.
    name: &'static str,
    /// Version of the program.
    version: &'static str,
    /// Identity of the service. It is the same at every address and for every process of the service, and after a
    /// restart or a restore from a backup.
    id: Uuid,
    /// Limits.
    limits: LimitsInfo,
    /// Formats.
    formats: FormatsInfo,
    /// Default options of a stack.
    defaults: StackOptions,
    /// Jobs that this process runs at the same time; 0 when other processes run them.
    workers: usize,
}

/// Limits of the service.
#[derive(Serialize, ToSchema)]
pub struct LimitsInfo {
    /// Largest upload, bytes.
    max_upload_bytes: u64,
    /// Largest upload with all views of a scan, bytes.
    max_scan_bytes: u64,
    /// Largest number of slices of a stack.
    max_slices: usize,
    /// Largest number of members of a zip.
    max_archive_members: usize,
    /// Largest unpacked member of a zip, bytes.
    max_member_bytes: u64,
    /// Largest unpacked size of all images of a zip together, bytes.
    max_unpacked_bytes: u64,
    /// Largest number of pixels of a slice.
    max_pixels: u64,
    /// Largest number of queued jobs.
    queue_limit: u64,
    /// Timeout of a request body from which no data arrives, seconds.
    body_idle_timeout_s: f64,
    /// Time after which a resumable upload without new data expires, seconds.
    upload_keep_s: u64,
    /// Longest `Prefer: wait`, seconds.
    max_wait_s: u64,
}

/// Formats that the service reads and writes.
#[derive(Serialize, ToSchema)]
pub struct FormatsInfo {
    /// Media types of uploads.
    uploads: [&'static str; 3],
    /// Media types of slices.
    slices: [&'static str; 3],
    /// Bits per sample of a slice.
    bit_depths: [u8; 2],
    /// Media types of the image of a stack.
    images: [&'static str; 3],
}

/// Read limits and defaults
///
/// The version of the service, its limits, the formats that it reads and writes, and the default of every option.
#[utoipa::path(get, path = "/v1/info", operation_id = "get_info", tag = "service", responses((status = 200, description = "Version, limits, formats, defaults", body = Info)))]
pub async fn info(State(app): State<App>) -> ApiResult<Json<Info>> {
    let policy = &app.policy;
    let archive = &policy.archive;
    Ok(Json(Info {
        name: env!("CARGO_PKG_NAME"),
        version: env!("CARGO_PKG_VERSION"),
        id: app.store.metadata.service_id().await?,
        limits: LimitsInfo {
            max_upload_bytes: policy.max_upload_bytes,
            max_scan_bytes: policy.max_scan_bytes,
            max_slices: MAX_SLICES,
            max_archive_members: archive.max_members,
            max_member_bytes: archive.max_member_bytes,
            max_unpacked_bytes: archive.max_total_bytes,
            max_pixels: archive.image.max_pixels,
            queue_limit: policy.queue_limit,
            body_idle_timeout_s: policy.body_idle_timeout.as_secs_f64(),
            upload_keep_s: policy.upload_keep.as_secs(),
            max_wait_s: MAX_WAIT_S,
        },
        formats: FormatsInfo {
            uploads: ["application/zip", "multipart/form-data", "application/offset+octet-stream"],
            slices: ["image/jpeg", "image/png", "image/tiff"],
            bit_depths: [8, 16],
            images: ["image/png", "image/tiff", "image/jpeg"],
        },
        defaults: StackOptions::default(),
        workers: policy.workers,
    }))
}
