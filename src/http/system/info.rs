//! `GET /v1/info`

use axum::{Json, extract::State};
use serde::Serialize;
use utoipa::ToSchema;

use crate::{
    contract::options::StackOptions,
    http::{extract::prefer::MAX_WAIT_S, state::App},
};
use pinstack_science::types::profile::MAX_SLICES;

/// The service: version, limits, formats, defaults.
#[derive(Serialize, ToSchema)]
pub struct Info {
    /// `pinstack`.
    name: &'static str,
    /// Version of the program.
    version: &'static str,
    /// What is taken on.
    limits: LimitsInfo,
    /// What can be read and written.
    formats: FormatsInfo,
    /// What a stack gets that asks for nothing.
    defaults: StackOptions,
    /// Jobs that this process works on at a time; 0 when others work.
    workers: usize,
}

/// What is taken on.
#[derive(Serialize, ToSchema)]
pub struct LimitsInfo {
    /// Largest upload, bytes.
    max_upload_bytes: u64,
    /// Most slices of a stack.
    max_slices: usize,
    /// Most members of a zip.
    max_archive_members: usize,
    /// Most bytes of one member, unpacked.
    max_member_bytes: u64,
    /// Most bytes of all pictures of a zip, unpacked.
    max_unpacked_bytes: u64,
    /// Most pixels of a slice.
    max_pixels: u64,
    /// Most jobs that may wait.
    queue_limit: u64,
    /// An upload that sends nothing for this long is given up, seconds.
    body_idle_timeout_s: f64,
    /// A resumable upload waits for its next piece so long, seconds.
    upload_keep_s: u64,
    /// Longest `Prefer: wait`, seconds.
    max_wait_s: u64,
}

/// What can be read and written.
#[derive(Serialize, ToSchema)]
pub struct FormatsInfo {
    /// Kinds of upload.
    uploads: [&'static str; 3],
    /// Kinds of slice.
    slices: [&'static str; 3],
    /// Bits per sample of a slice.
    bit_depths: [u8; 2],
    /// Kinds of image that come out.
    images: [&'static str; 3],
}

/// Read limits and defaults
///
/// The version of the service, the limits it sets, the formats it reads and writes, and the default of every option.
#[utoipa::path(get, path = "/v1/info", operation_id = "get_info", tag = "service", responses((status = 200, description = "Version, limits, formats, defaults", body = Info)))]
pub async fn info(State(app): State<App>) -> Json<Info> {
    let policy = &app.policy;
    let archive = &policy.archive;
    Json(Info {
        name: env!("CARGO_PKG_NAME"),
        version: env!("CARGO_PKG_VERSION"),
        limits: LimitsInfo {
            max_upload_bytes: policy.max_upload_bytes,
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
    })
}
