//! `GET /v1/uploads`

use axum::{Json, extract::State, http::Uri};
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::metadata::Metadata;
use crate::{
    contract::UploadPurpose,
    http::{
        ApiResult, App,
        extract::{PageQuery, params},
    },
    store::{Skipped, uploads},
};

/// A resumable upload that is waiting for bytes, or for its job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OpenUpload {
    /// Id. `GET /v1/uploads/{id}` shows more, `DELETE /v1/uploads/{id}` deletes it.
    #[schema(value_type = String, format = Uuid)]
    pub id: Uuid,
    /// File name that the client gave; null when it gave none.
    pub filename: Option<String>,
    /// What it becomes.
    pub purpose: UploadPurpose,
    /// Rig of the profile.
    pub rig: Option<String>,
    /// Lens of the profile.
    pub lens: Option<String>,
    /// Bytes on stable storage.
    pub offset: u64,
    /// Size of the zip, bytes.
    pub length: u64,
    /// Name of the token that created it; null without authentication.
    pub token: Option<String>,
    /// When it was created.
    #[schema(value_type = String, format = DateTime)]
    pub created_at: Timestamp,
    /// When bytes last arrived; null when none have.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub last_byte_at: Option<Timestamp>,
    /// When it expires unless more bytes arrive.
    #[schema(value_type = String, format = DateTime)]
    pub expires_at: Timestamp,
}

/// A page of open uploads, newest first.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub struct OpenUploadList {
    /// At most `limit` items.
    pub items: Vec<OpenUpload>,
    /// Pass it as `cursor` to get the next page; null on the last page.
    pub next_cursor: Option<String>,
    /// Uploads that cannot be read and are omitted from `items`; absent when there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub skipped: Vec<Skipped>,
}

impl OpenUpload {
    fn of(open: uploads::OpenUpload) -> ApiResult<Self> {
        let uploads::OpenUpload { upload, token, last_byte_at } = open;
        let metadata = Metadata::parse(&upload.metadata)?;
        let named = |name: &str| metadata.0.get(name).cloned();
        Ok(Self {
            id: upload.id,
            filename: metadata.filename(),
            purpose: metadata.purpose()?,
            rig: named("rig"),
            lens: named("lens"),
            offset: upload.offset,
            length: upload.length,
            token,
            created_at: upload.created_at,
            last_byte_at,
            expires_at: upload.expires_at,
        })
    }
}

/// List open uploads
///
/// Resumable uploads of all tokens that are waiting for bytes or for their job, newest first. For operators: requires
/// the scope `admin`.
#[utoipa::path(
    get,
    path = "/v1/uploads",
    operation_id = "list_uploads",
    tag = "uploads",
    params(
        ("limit" = Option<u32>, Query, description = "Items per page, 1 to 500, default 50"),
        ("cursor" = Option<String>, Query, description = "`next_cursor` from the previous page"),
    ),
    responses(
        (status = 200, description = "A page of open uploads", body = OpenUploadList),
        (status = 400, description = "`invalid_request`: an unknown parameter, or a value outside its range"),
    )
)]
pub async fn list(State(app): State<App>, uri: Uri) -> ApiResult<Json<OpenUploadList>> {
    let mut pairs = params::pairs(&uri)?;
    let page = PageQuery::take(&mut pairs)?;
    params::refuse_rest(&pairs, "limit, cursor")?;
    let page = app.store.metadata.list_open_uploads(&page).await?;
    let (mut items, mut skipped) = (Vec::new(), page.skipped);
    for open in page.items {
        let id = open.upload.id;
        match OpenUpload::of(open) {
            Ok(item) => items.push(item),
            Err(error) => skipped.push(Skipped::unreadable(id.to_string(), &error.fault().detail)),
        }
    }
    Ok(Json(OpenUploadList { items, next_cursor: page.next_cursor, skipped }))
}
