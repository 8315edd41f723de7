//! `GET /v1/uploads/{id}`

use std::collections::BTreeMap;

use axum::{Json, extract::State};
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::{
    lock::not_found,
    metadata::Metadata,
    protocol::{job_url, url},
};
use crate::{
    contract::{Problem, UploadPurpose},
    http::{
        App,
        extract::UploadId,
        problem::{ApiResult, problem},
    },
    store::uploads::{PartialUpload, UploadState},
};

/// State of an upload.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum UploadProgress {
    /// Bytes are missing, or all bytes are stored and the job is not made yet.
    Receiving,
    /// The job was made.
    Complete,
    /// The zip was refused and deleted.
    Refused,
}

/// A resumable upload.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ResumableUpload {
    /// Id. The job that is made from it has the same id; the stacks of a scan have other ids.
    #[schema(value_type = String, format = Uuid)]
    pub id: Uuid,
    /// State of the upload.
    pub state: UploadProgress,
    /// Bytes on stable storage.
    pub offset: u64,
    /// Size of the zip, bytes.
    pub length: u64,
    /// What it becomes.
    pub purpose: UploadPurpose,
    /// File name that the client gave; null when it gave none.
    pub filename: Option<String>,
    /// The decoded `Upload-Metadata`.
    pub metadata: BTreeMap<String, String>,
    /// When it was created.
    #[schema(value_type = String, format = DateTime)]
    pub created_at: Timestamp,
    /// When it expires unless more bytes arrive. The job does not expire with it.
    #[schema(value_type = String, format = DateTime)]
    pub expires_at: Timestamp,
    /// URL of the job, or of the scan, that was made from it; null before.
    pub job: Option<String>,
    /// Why it was refused; null unless `state` is `refused`.
    pub error: Option<Problem>,
}

impl ResumableUpload {
    fn of(upload: &PartialUpload) -> ApiResult<Self> {
        let metadata = Metadata::parse(&upload.metadata)?;
        let (state, job, error) = match &upload.state {
            UploadState::Receiving => (UploadProgress::Receiving, None, None),
            UploadState::Complete(_) => (UploadProgress::Complete, job_url(upload), None),
            UploadState::Refused(fault) => (UploadProgress::Refused, None, Some(problem(fault, Some(url(upload.id))))),
        };
        Ok(Self {
            id: upload.id,
            state,
            offset: upload.offset,
            length: upload.length,
            purpose: metadata.purpose()?,
            filename: metadata.filename(),
            metadata: metadata.0,
            created_at: upload.created_at,
            expires_at: upload.expires_at,
            job,
            error,
        })
    }
}

/// Get an upload
///
/// For people and scripts. It does not interrupt a request that writes to the upload. tus clients use `HEAD`.
#[utoipa::path(
    get,
    path = "/v1/uploads/{id}",
    operation_id = "get_upload",
    tag = "uploads",
    params(("id" = String, Path, description = "Id of the upload")),
    responses(
        (status = 200, description = "The upload", body = ResumableUpload),
        (status = 404, description = "`not_found`: no such upload, or it has expired"),
    )
)]
pub async fn get(State(app): State<App>, UploadId(id): UploadId) -> ApiResult<Json<ResumableUpload>> {
    let upload = app.store.metadata.upload(id).await?.ok_or_else(|| not_found(id))?;
    Ok(Json(ResumableUpload::of(&upload)?))
}
