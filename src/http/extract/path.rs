//! Path parameters.

use std::collections::HashMap;

use axum::{
    extract::{FromRequestParts, Path},
    http::request::Parts,
};
use uuid::Uuid;

use crate::{
    contract::{Code, Name},
    http::{ApiError, log},
};

/// `{rig}` and `{lens}`.
#[derive(Debug, Clone)]
pub struct ProfileKey {
    /// The rig.
    pub rig: Name,
    /// The lens.
    pub lens: Name,
}

impl<S: Send + Sync> FromRequestParts<S> for ProfileKey {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        let segments = segments(parts, state).await?;
        Ok(Self { rig: name_segment(&segments, "rig")?, lens: name_segment(&segments, "lens")? })
    }
}

/// `{id}` of a job. Text that is not a UUID is not found.
#[derive(Debug, Clone, Copy)]
pub struct JobId(pub Uuid);

impl<S: Send + Sync> FromRequestParts<S> for JobId {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        Ok(Self(id(parts, state, "id", "job").await?))
    }
}

/// `{id}` of an upload.
#[derive(Debug, Clone, Copy)]
pub struct UploadId(pub Uuid);

impl<S: Send + Sync> FromRequestParts<S> for UploadId {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        Ok(Self(id(parts, state, "id", "upload").await?))
    }
}

/// `{note}`: the id of a note.
#[derive(Debug, Clone, Copy)]
pub struct NoteId(pub Uuid);

impl<S: Send + Sync> FromRequestParts<S> for NoteId {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        Ok(Self(id(parts, state, "note", "note").await?))
    }
}

/// `{name}` of a further light, as the client wrote it.
#[derive(Debug, Clone)]
pub struct LightName(pub String);

impl<S: Send + Sync> FromRequestParts<S> for LightName {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        Ok(Self(segments(parts, state).await?.remove("name").unwrap_or_default()))
    }
}

async fn id<S: Send + Sync>(parts: &mut Parts, state: &S, segment: &str, what: &'static str) -> Result<Uuid, ApiError> {
    // invalid UTF-8 is not an id either
    let segments = segments(parts, state).await.unwrap_or_default();
    let text = segments.get(segment).map(String::as_str).unwrap_or_default();
    let id = Uuid::parse_str(text)
        .map_err(|_| ApiError::new(Code::NotFound, format!("there is no {what} '{}'", shortened(text))))?;
    log::note(what, id);
    Ok(id)
}

async fn segments<S: Send + Sync>(parts: &mut Parts, state: &S) -> Result<HashMap<String, String>, ApiError> {
    match Path::from_request_parts(parts, state).await {
        Ok(Path(segments)) => Ok(segments),
        Err(_) => Err(ApiError::new(Code::InvalidRequest, "the URL is not valid UTF-8")),
    }
}

/// A checked name in a path.
///
/// # Errors
/// `invalid_request`.
pub async fn named_segment<S: Send + Sync>(parts: &mut Parts, state: &S, what: &'static str) -> Result<Name, ApiError> {
    name_segment(&segments(parts, state).await?, what)
}

fn name_segment(segments: &HashMap<String, String>, what: &'static str) -> Result<Name, ApiError> {
    let text = segments.get(what).cloned().unwrap_or_default();
    name(what, text)
}

/// A checked name of a rig, lens or scan. The log lines of the request have it.
pub fn name(what: &str, text: String) -> Result<Name, ApiError> {
    let name = Name::new(text).map_err(|error| ApiError::new(Code::InvalidRequest, format!("{what}: {error}")))?;
    log::note(what, &name);
    Ok(name)
}

fn shortened(text: &str) -> String {
    text.chars().take(80).collect()
}
