//! `GET /v1/uploads/{id}`

use std::collections::BTreeMap;

use axum::{Json, extract::State};
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::{
    hold::unknown,
    metadata::Metadata,
    protocol::{job_url, url},
};
use crate::{
    contract::{JobKind, Problem},
    http::{
        extract::UploadId,
        problem::{ApiResult, problem},
        state::App,
    },
    store::uploads::{PartialUpload, UploadState},
};

/// Where an upload is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum UploadProgress {
    /// Bytes are missing, or all are here and the job is to be made.
    Receiving,
    /// The job was made.
    Complete,
    /// What arrived was refused, and is gone.
    Refused,
}

/// An upload that arrives in pieces.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ResumableUpload {
    /// Id; the job that it becomes has the same.
    #[schema(value_type = String, format = Uuid)]
    pub id: Uuid,
    /// Where it is.
    pub state: UploadProgress,
    /// Bytes on stable storage.
    pub offset: u64,
    /// Bytes in all.
    pub length: u64,
    /// What it becomes.
    pub purpose: JobKind,
    /// Name that the client gave; null when it gave none.
    pub filename: Option<String>,
    /// Everything that the client said about it.
    pub metadata: BTreeMap<String, String>,
    /// When it began.
    #[schema(value_type = String, format = DateTime)]
    pub created_at: Timestamp,
    /// When it goes unless something comes before. The job stays.
    #[schema(value_type = String, format = DateTime)]
    pub expires_at: Timestamp,
    /// The job that it became; null before.
    pub job: Option<String>,
    /// Why it was refused; null unless `state` is `refused`.
    pub error: Option<Problem>,
}

impl ResumableUpload {
    fn of(upload: &PartialUpload) -> ApiResult<Self> {
        let metadata = Metadata::parse(&upload.metadata)?;
        let (state, job, error) = match &upload.state {
            UploadState::Receiving => (UploadProgress::Receiving, None, None),
            UploadState::Complete(kind) => (UploadProgress::Complete, Some(job_url(upload.id, *kind)), None),
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

/// Read an upload
///
/// For people and scripts; disturbs nobody who writes to it. tus clients ask by HEAD.
#[utoipa::path(
    get,
    path = "/v1/uploads/{id}",
    operation_id = "get_upload",
    tag = "uploads",
    params(("id" = String, Path, description = "Id of the upload")),
    responses(
        (status = 200, description = "The upload", body = ResumableUpload),
        (status = 404, description = "`not_found`: no such upload, or its time is over"),
    )
)]
pub async fn get(State(app): State<App>, UploadId(id): UploadId) -> ApiResult<Json<ResumableUpload>> {
    let upload = app.rows.upload(id).await?.ok_or_else(|| unknown(id))?;
    Ok(Json(ResumableUpload::of(&upload)?))
}
