//! `GET /v1/scans/{scan}/bundle`

use std::sync::Arc;

use axum::{
    extract::State,
    http::{HeaderMap, Uri},
    response::Response,
};
use jiff::Timestamp;
use serde::Deserialize;

use super::{
    ScanName,
    camera::ViewCamera,
    find,
    stored_zip::{EntryContent, StoredZip, ZipEntry},
    table::{View, ViewResult, views},
};
use crate::{
    contract::{Code, JobState, Name, Scan, artifact::FileFormat, outcome::Artifact, scan::PanDirection},
    http::{
        ApiError, ApiResult, App,
        artifacts::download::{Content, Download, Source},
        auth::Caller,
        background,
        extract::params,
        ingest::reservation::disk_full,
        views::scan::{listed, most_common},
    },
    store::digest::digests_of,
};
use pinstack_science::photogrammetry::bundle::{self, BundleScan, BundleView, Layout};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Query {
    layout: Layout,
    #[serde(default)]
    partial: bool,
}

/// Get the bundle of a scan for a reconstruction program
///
/// A zip with the images, separate masks named as that program wants them, the intrinsics of the common camera, poses
/// where every view has pan and tilt, and a `README.txt` with the exact commands. It is streamed, has a length and an
/// `ETag`, and can be resumed with `Range`.
///
/// All views must have succeeded and fit together: one size, crop and camera. `partial=true` leaves out views that
/// have no result.
#[utoipa::path(
    get,
    path = "/v1/scans/{scan}/bundle",
    operation_id = "get_scan_bundle",
    tag = "scans",
    params(
        ("scan" = String, Path, description = "Name of the scan"),
        ("layout" = inline(Layout), Query, description = "The program that the bundle is for", example = "colmap"),
        ("partial" = Option<bool>, Query, description = "`true`: without the views that have no result"),
        ("Range" = Option<String>, Header, description = "A part of the file, `bytes=0-1023`"),
        ("If-Range" = Option<String>, Header, description = "`ETag`: send the range only if the bundle is still the same"),
        ("If-None-Match" = Option<String>, Header, description = "`ETag` of the version that the client has"),
    ),
    responses(
        (status = 200, description = "The bundle", content((Vec<u8> = "application/zip")), headers(
            ("ETag" = String, description = "A digest of names and contents"),
            ("Content-Disposition" = String, description = "`{scan}_{layout}.zip`"))),
        (status = 206, description = "The part that `Range` requests", content((Vec<u8> = "application/zip"))),
        (status = 304, description = "The client has this version already"),
        (status = 400, description = "`invalid_request`: an invalid name, a missing or unknown layout, or a view whose label the program takes for that of a mask"),
        (status = 404, description = "`scan_not_found`; `not_found`: the scan has no views with results"),
        (status = 409, description = "`not_finished`: views are queued or running, or have failed"),
        (status = 412, description = "`precondition_failed`: `If-Match` names another version"),
        (status = 416, description = "`range_not_satisfiable`: the range begins after the end"),
        (status = 422, description = "`scan_mismatch`: views of another size, crop, profile revision or camera than most; each is named with its difference"),
    )
)]
pub async fn bundle(
    State(app): State<App>,
    caller: Caller,
    ScanName(name): ScanName,
    uri: Uri,
    headers: HeaderMap,
) -> ApiResult<Response> {
    let Query { layout, partial } = params::from_uri(&uri)?;
    let zip = zip_of(&app, &caller, &name, layout, partial).await?;
    let download = Download {
        tag: zip.tag().to_owned(),
        media_type: "application/zip".to_owned(),
        name: file_name(&name, layout),
        content: Some(Content { length: zip.length(), source: Source::Zip(Arc::clone(&app.store.blobs), zip) }),
    };
    download.answer(&headers).await
}

/// File name of a bundle.
pub fn file_name(scan: &Name, layout: Layout) -> String {
    format!("{scan}_{}.zip", layout.name())
}

/// The bundle of a scan.
///
/// # Errors
/// `scan_not_found`; `not_found` when no view has a result; `not_finished`; `scan_mismatch`; `internal` when a
/// result is missing or damaged.
pub async fn zip_of(app: &App, caller: &Caller, name: &Name, layout: Layout, partial: bool) -> ApiResult<StoredZip> {
    let scan = find(app, caller, name).await?;
    let views = views(app, caller, name).await?;
    let ready = ready(name, &views, partial)?;
    require_one_camera(name, &ready)?;
    let modified = ready.iter().map(|ready| ready.view.stack.created_at).max().unwrap_or(Timestamp::UNIX_EPOCH);
    let described = described(&scan, &ready);
    // the pairs of neighbours take the square of the number of views
    let entries = background::blocking(move || bundle::plan(layout, &described)).await??;
    let mut members = Vec::with_capacity(entries.len());
    for bundle::Entry { path, content } in entries {
        let artifact = |at: usize, of: fn(&Ready<'_>) -> Option<Artifact>| {
            let missing = || ApiError::internal(format!("the bundle refers to the file {path}, which no view has"));
            ready.get(at).and_then(of).ok_or_else(missing)
        };
        let content = match content {
            bundle::Content::Text(text) => EntryContent::Text(text.into()),
            bundle::Content::Image(at) => stored(app, artifact(at, |ready| Some(ready.image.clone()))?).await?,
            bundle::Content::Mask(at) => stored(app, artifact(at, |ready| ready.result.mask.clone())?).await?,
        };
        members.push(ZipEntry { path, content });
    }
    Ok(StoredZip::new(members, modified))
}

/// A view with a result.
pub struct Ready<'a> {
    /// The view.
    pub view: &'a View,
    /// Its results.
    pub result: &'a ViewResult,
    /// Its fused image.
    pub image: &'a Artifact,
}

/// The views with results.
///
/// # Errors
/// `not_finished` when others have none, unless `partial`; `not_found` when no view has one.
pub fn ready<'a>(name: &Name, views: &'a [View], partial: bool) -> ApiResult<Vec<Ready<'a>>> {
    let (mut ready, mut waiting, mut failed) = (Vec::new(), Vec::new(), Vec::new());
    for view in views {
        match (&view.stack.result, view.stack.state) {
            (Some(result), _) if result.image.is_some() => {
                ready.extend(result.image.as_ref().map(|image| Ready { view, result, image }));
            }
            (_, JobState::Queued | JobState::Running) => waiting.push(view.stem.clone()),
            _ => failed.push(view.stem.clone()),
        }
    }
    let is_complete = waiting.is_empty() && failed.is_empty();
    if !(partial || is_complete) {
        let part = |views: &[String], what: &str| match views.len() {
            0 => String::new(),
            n => format!("; {n} {what}: {}", listed(views)),
        };
        let detail = format!(
            "{} of {} views of the scan '{name}' have a result{}{}; wait, send the failed ones again, or ask with \
             partial=true for the views that have one",
            ready.len(),
            views.len(),
            part(&waiting, "are not finished"),
            part(&failed, "have failed"),
        );
        return Err(ApiError::new(Code::NotFinished, detail));
    }
    if ready.is_empty() {
        let detail = format!("the scan '{name}' has no view with a result; send its stacks first, and wait for them");
        return Err(ApiError::new(Code::NotFound, detail));
    }
    Ok(ready)
}

/// All images of a bundle are of one camera: one size, crop, profile, and so one set of intrinsics.
///
/// # Errors
/// `scan_mismatch` that names the others.
pub fn require_one_camera(scan: &Name, ready: &[Ready<'_>]) -> ApiResult<()> {
    let cameras: Vec<ViewCamera<'_>> = ready.iter().map(|ready| ViewCamera::of(ready.view, ready.result)).collect();
    let Some(usual) = most_common(cameras.iter().copied()) else { return Ok(()) };
    let others: Vec<String> = ready
        .iter()
        .zip(&cameras)
        .filter_map(|(ready, camera)| Some(format!("{} ({})", ready.view.stem, camera.difference(&usual)?)))
        .collect();
    if others.is_empty() {
        return Ok(());
    }
    let ([width, height], [x, y]) = (usual.size, usual.crop_offset);
    let detail = format!(
        "{} differ from the other views, which have {width} x {height} px at the offset {x},{y} of one profile revision: \
         a reconstruction needs one camera for all views; fuse the scan again with one crop and profile (POST \
         /v1/scans/{scan}/rerun with {{\"crop\": \"none\", \"profile_revision\": null}})",
        listed(&others)
    );
    Err(ApiError::new(Code::ScanMismatch, detail))
}

/// The scan as bundles are made from it.
pub fn described(scan: &Scan, ready: &[Ready<'_>]) -> BundleScan {
    let first = ready.first().map(|ready| &ready.result.image_info);
    let canvas = ready.first().map_or([1, 1], |ready| ready.view.stack.slice_size);
    let offset = first.map_or([0, 0], |info| info.crop_offset_px);
    let extension = |artifact: &Artifact| {
        FileFormat::of_media_type(&artifact.media_type).unwrap_or(FileFormat::Png).extension().to_owned()
    };
    BundleScan {
        name: scan.name.to_string(),
        width: first.map_or(0, |info| info.width),
        height: first.map_or(0, |info| info.height),
        intrinsics: first.and_then(|info| info.intrinsics),
        canvas_centre_px: [0, 1].map(|axis| (f64::from(canvas[axis]) - 1.0) / 2.0 - f64::from(offset[axis])),
        radius_mm: scan.input.radius_mm,
        pan_is_clockwise: scan.input.pan_direction == PanDirection::Clockwise,
        views: ready
            .iter()
            .map(|ready| BundleView {
                stem: ready.view.stem.clone(),
                extension: extension(ready.image),
                bit_depth: ready.result.image_info.bit_depth,
                has_mask: ready.result.mask.is_some(),
                angles: ready.view.angles(),
            })
            .collect(),
    }
}

/// A stored file as a member of the zip.
async fn stored(app: &App, artifact: Artifact) -> ApiResult<EntryContent> {
    let Artifact { key, bytes, sha256, crc32, name, .. } = artifact;
    let damaged = |what: &str| {
        tracing::error!(key, "a stored result {what}; `pinstack verify` lists all damaged results");
        let detail = format!(
            "the stored file of a {name} is damaged or was just deleted; fuse its stack again, and ask the operator to run \
             `pinstack verify`"
        );
        ApiError::new(Code::Internal, detail)
    };
    match app.store.blobs.head(&key).await? {
        None => return Err(damaged("is missing")),
        Some(blob) if blob.size != bytes => return Err(damaged("has another size than its row")),
        Some(_) => {}
    }
    let crc32 = match crc32 {
        Some(crc32) => crc32,
        // a result older than this member of its row: the file is read
        None => {
            let gone = || damaged("is missing");
            let _space = app.disk.reserve_copy(bytes).await?.granted().map_err(|state| disk_full(bytes, 0, &state))?;
            let file = app.store.blobs.fetch(&key, &app.store.workspace).await?.ok_or_else(gone)?;
            let read = background::blocking(move || digests_of(std::fs::File::open(file.path())?));
            read.await?.map_err(ApiError::internal)?.crc32
        }
    };
    Ok(EntryContent::Blob { key, bytes, crc32, sha256 })
}
