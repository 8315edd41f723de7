//! `GET /stacks/{id}/tiles/{artifact}/{level}/{x}/{y}`: a part of a picture as PNG, at most 512 px a side. In place of
//! an artifact, `light-NAME` is a further light, and `slice-LIGHT-N` is slice N of a light (`front`, `back`, or the
//! name of a further one), warped to the reference slice, in the order of fusion from 0.
//!
//! The first tile of a picture decodes it, once, into a file with all levels ([`pyramid`]). The same cache that holds
//! converted pictures holds that file: concurrent requests wait for one decoding, pictures are decoded one at a time,
//! disk space is reserved first, and the files that were used longest ago are dropped.

use std::sync::Arc;

use axum::{
    extract::{Path, State},
    http::{HeaderMap, HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use uuid::Uuid;

use crate::{
    contract::{
        Code, JobKind,
        artifact::{Colours, StackArtifact, light_name},
        request::JobRequest,
    },
    http::{
        ApiError, ApiResult, App,
        artifacts::{download, outcome},
        background,
        extract::{etag, not_modified},
        job_resource::load,
        state::conversions::{
            conversion::{Conversion, Converted, Form, SliceRecipe},
            pyramid,
        },
    },
    jobs::SliceLight,
    store::Job,
};

/// Begins the name of a slice.
pub const SLICE: &str = "slice-";

/// Begins the name of a further light.
pub const LIGHT: &str = "light-";

/// A picture that has tiles.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Picture {
    /// The name of its file.
    Artifact(String, Colours),
    /// The name of a light, and the index in the order of fusion.
    Slice(String, usize),
}

impl Picture {
    fn of_name(name: &str) -> Option<Self> {
        if let Some(slice) = name.strip_prefix(SLICE) {
            let (light, index) = slice.rsplit_once('-')?;
            // one name per slice: no sign, no leading zeros
            let number = index.parse().ok().filter(|number: &usize| number.to_string() == index)?;
            return Some(Self::Slice(light.to_owned(), number));
        }
        if let Some(light) = name.strip_prefix(LIGHT) {
            return Some(Self::Artifact(light_name(light), Colours::Plain));
        }
        let (_, colours) = StackArtifact::of_name(name)?.layer()?;
        Some(Self::Artifact(name.to_owned(), colours))
    }

    /// The file with all levels, made at the first request.
    async fn pyramid(self, app: &App, job: &Job) -> ApiResult<Arc<Converted>> {
        match self {
            Self::Artifact(artifact, colours) => {
                let stored = outcome::artifact(job, &artifact)?;
                if app.conversions.kept(&stored.sha256, Form::Pyramid(colours)).is_none() {
                    // refuses a damaged file
                    drop(download::stored(app, job, stored, String::new()).await?);
                }
                app.conversions.get(&stored.key, &stored.sha256, Conversion::Pyramid(colours)).await
            }
            Self::Slice(name, index) => {
                let stack = job.id.to_string();
                let none = || ApiError::new(Code::NotFound, "there is no such slice");
                let shown = lights_shown(app, job).into_iter().find(|light| light.name == name && index < light.slices);
                let light = shown.ok_or_else(none)?.light;
                if let Some(kept) = app.conversions.kept(&stack, Form::Slice(light, index)) {
                    return Ok(kept);
                }
                let JobRequest::Stack(request) = &job.request else { return Err(none()) };
                let metadata = &app.store.metadata;
                let profile = metadata.profile_of_job(&job.rig, &job.lens, request.profile_revision).await?;
                let profile = profile.ok_or_else(none)?.input;
                let recipe = SliceRecipe { profile, options: request.options.clone(), slice: (light, index) };
                app.conversions.get(&request.upload.key, &stack, Conversion::Slice(Arc::new(recipe))).await
            }
        }
    }
}

/// A light whose slices can be shown.
#[derive(Debug)]
pub struct ShownLight<'a> {
    /// Its name in URLs.
    pub name: &'a str,
    /// Which light it is.
    pub light: SliceLight,
    /// Number of its slices, at least 1.
    pub slices: usize,
}

/// The lights whose slices can be shown: all as long as the zip is stored on this machine. Slices of a zip in a bucket
/// are not shown: each would fetch the directory of the zip and the slice from the bucket again.
pub fn lights_shown<'a>(app: &App, job: &'a Job) -> Vec<ShownLight<'a>> {
    let is_here = !job.upload_removed && app.store.blobs.is_local() && outcome::of_stack(job).is_ok();
    let Some(layout) = job.request.layout().filter(|_| is_here) else { return Vec::new() };
    let of = |name: &'a str, light: SliceLight, slices: &[String]| ShownLight { name, light, slices: slices.len() };
    let mut all = vec![of("front", SliceLight::Front, &layout.front), of("back", SliceLight::Back, &layout.back)];
    let further = layout.lights.iter().enumerate();
    all.extend(further.map(|(at, light)| of(&light.name, SliceLight::Further(at), &light.slices)));
    all.retain(|light| light.slices > 0);
    all
}

/// The endpoint.
///
/// # Errors
/// `not_found` for a picture or a tile that does not exist; `not_finished`, `no_result`; `insufficient_storage`.
pub async fn get(
    State(app): State<App>,
    Path((id, artifact, level, x, y)): Path<(String, String, String, String, String)>,
    headers: HeaderMap,
) -> ApiResult<Response> {
    let none = || ApiError::new(Code::NotFound, "there is no such part of a picture");
    let number = |text: &str| text.parse::<u32>().map_err(|_| none());
    let (level, x, y) = (number(&level)?, number(&x)?, number(&y)?);
    let id = Uuid::parse_str(&id).map_err(|_| none())?;
    let picture = Picture::of_name(&artifact).ok_or_else(none)?;
    let job = load(&app, id, JobKind::Stack).await?;
    let version = match &picture {
        Picture::Artifact(artifact, _) => &outcome::artifact(&job, artifact)?.sha256,
        Picture::Slice(..) => &artifact,
    };
    let tag = format!("{version}-tile-{}", env!("CARGO_PKG_VERSION"));
    let keep = HeaderValue::from_static("private, max-age=604800, immutable");
    let common = [(header::ETAG, etag(&tag)), (header::CACHE_CONTROL, keep)];
    if not_modified(&headers, &tag) {
        return Ok((StatusCode::NOT_MODIFIED, common).into_response());
    }
    let pyramid = picture.pyramid(&app, &job).await?;
    let _turn = app.tile_permits.acquire().await.map_err(ApiError::internal)?;
    let made = background::blocking(move || pyramid::tile(pyramid.path(), level, x, y)).await?;
    let png = made.map_err(ApiError::internal)?.ok_or_else(none)?;
    Ok((common, [(header::CONTENT_TYPE, "image/png")], png).into_response())
}
