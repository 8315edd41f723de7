//! `GET /stacks/{id}/thumbnail`: the picture of a stack in a list, a JPEG of a few kB, made of the preview when it is
//! first asked for. The newest are kept in memory. Its URL contains its digest, so browsers keep it too.

use std::{
    collections::{HashMap, VecDeque},
    sync::{Mutex, PoisonError},
};

use axum::{
    extract::State,
    http::{HeaderMap, HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use bytes::Bytes;
use maud::{Markup, html};
use tokio::sync::Semaphore;
use uuid::Uuid;

use crate::{
    contract::{JobKind, artifact::StackArtifact, outcome::Artifact},
    http::{
        artifacts::{download, outcome},
        background,
        extract::{
            JobId,
            conditional::{etag, not_modified},
        },
        job_resource::load,
        problem::{ApiError, ApiResult},
        state::App,
    },
    store::Job,
};
use pinstack_science::imaging::{codec, thumbnail};

/// Longest side, px: twice what the list shows, for dense screens.
const MAX_SIDE: usize = 200;
/// Quality of the JPEG.
const QUALITY: u8 = 80;
/// Most thumbnails in memory, of about 6 kB each.
const KEPT: usize = 512;
/// Thumbnails that are made at a time.
const AT_A_TIME: usize = 2;
/// A preview has fewer pixels than this.
const MAX_PIXELS: u64 = 4_000_000;

/// The thumbnails in memory.
#[derive(Debug)]
pub struct Thumbnails {
    kept: Mutex<(HashMap<String, Bytes>, VecDeque<String>)>,
    turn: Semaphore,
}

impl Default for Thumbnails {
    fn default() -> Self {
        Self { kept: Mutex::default(), turn: Semaphore::new(AT_A_TIME) }
    }
}

impl Thumbnails {
    fn kept(&self, digest: &str) -> Option<Bytes> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner).0.get(digest).cloned()
    }

    fn keep(&self, digest: &str, jpeg: &Bytes) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let (by_digest, order) = &mut *kept;
        if by_digest.insert(digest.to_owned(), jpeg.clone()).is_none() {
            order.push_back(digest.to_owned());
        }
        while order.len() > KEPT {
            order.pop_front().map(|oldest| by_digest.remove(&oldest));
        }
    }

    async fn get(&self, app: &App, job: &Job, preview: &Artifact) -> ApiResult<Bytes> {
        if let Some(jpeg) = self.kept(&preview.sha256) {
            return Ok(jpeg);
        }
        let _turn = self.turn.acquire().await.map_err(ApiError::internal)?;
        if let Some(jpeg) = self.kept(&preview.sha256) {
            return Ok(jpeg);
        }
        let stored = download::stored(app, job, preview, String::new()).await?;
        let Some(content) = stored.content else { return Err(ApiError::internal("a preview has no bytes")) };
        let bytes = content.bytes().await?;
        let made = background::spawn_blocking(move || made(&bytes)).await.map_err(ApiError::internal)??;
        self.keep(&preview.sha256, &made);
        Ok(made)
    }
}

fn made(preview: &[u8]) -> ApiResult<Bytes> {
    let limits = codec::Limits { max_pixels: MAX_PIXELS, ..codec::Limits::default() };
    let raster = codec::decode_rgba(preview, &limits).map_err(|error| ApiError::internal(format!("{error:?}")))?;
    let small = match raster.channels {
        4 => thumbnail::flattened(&raster, MAX_SIDE),
        _ => thumbnail::sampled(&raster, MAX_SIDE),
    };
    Ok(codec::encode_jpeg(&small, QUALITY).into())
}

/// The endpoint.
///
/// # Errors
/// `not_found`; `not_finished` and `no_result` without a preview.
pub async fn get(State(app): State<App>, JobId(id): JobId, headers: HeaderMap) -> ApiResult<Response> {
    let job = load(&app, id, JobKind::Stack).await?;
    let preview = outcome::artifact(&job, StackArtifact::Preview.name())?;
    let tag = format!("{}-thumbnail", preview.sha256);
    let keep = HeaderValue::from_static("private, max-age=604800, immutable");
    let common = [(header::ETAG, etag(&tag)), (header::CACHE_CONTROL, keep)];
    if not_modified(&headers, &tag) {
        return Ok((StatusCode::NOT_MODIFIED, common).into_response());
    }
    let jpeg = app.thumbnails.get(&app, &job, preview).await?;
    Ok((common, [(header::CONTENT_TYPE, "image/jpeg")], jpeg).into_response())
}

/// URL of the thumbnail of a stack; `digest` is that of its preview.
pub fn url(id: Uuid, digest: &str) -> String {
    format!("/stacks/{id}/thumbnail?v={}", digest.get(..12).unwrap_or(digest))
}

/// The picture of a stack in a list, or a sign for its absence. The name beside it says what it is.
pub fn picture(job: &Job) -> Markup {
    let artifacts = job.outcome.as_ref().map(|outcome| outcome.artifacts()).unwrap_or_default();
    let preview = artifacts.iter().find(|artifact| artifact.name == StackArtifact::Preview.name());
    html! {
        span.thumb {
            @match preview {
                Some(preview) => { img src=(url(job.id, &preview.sha256)) alt="" loading="lazy" width="96" height="68"; }
                None => { span.soft aria-hidden="true" { @if job.state.is_final() { "–" } @else { "…" } } }
            }
        }
    }
}
