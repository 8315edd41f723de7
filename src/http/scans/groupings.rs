//! `POST /v1/groupings`

use axum::{
    Json,
    body::Body,
    extract::State,
    http::{HeaderMap, Uri},
};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use crate::{
    contract::{Code, Fault},
    http::{
        ApiResult, App,
        extract::{json, params},
        ingest::submission::scan::NameRules,
    },
};
use pinstack_science::archive::scan::{NameGrouping, group_names};

/// Names of files that are to be grouped.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NamesInput {
    /// Names of all files below a folder, relative to it, with `/` or `\` between folders. Pictures, and whatever else
    /// is there. At most 60,000.
    pub names: Vec<String>,
    /// The content of the `manifest.json` among them, if there is one.
    #[serde(default)]
    #[schema(value_type = Option<Object>)]
    pub manifest: Option<Value>,
}

/// Group file names into views
///
/// Shows which files are the slices of which view, in which light and order, before any of them is sent. The rules are
/// those of `POST /v1/scans/{scan}/archive`: folders, words for the lights in six languages, focus steps, pan and tilt
/// in names, `manifest.json`. Nothing is stored.
///
/// A view that cannot be sent as it is has a `problem`; the others are grouped all the same, so this also works for a
/// folder that is still being filled.
#[utoipa::path(
    post,
    path = "/v1/groupings",
    operation_id = "group_names",
    tag = "scans",
    params(NameRules),
    request_body(content = NamesInput, example = json!({ "names": [
        "bee/pan000_tilt15/front/1.jpg", "bee/pan000_tilt15/front/2.jpg",
        "bee/pan000_tilt15/back/1.jpg", "bee/pan000_tilt15/back/2.jpg", "bee/notes.txt"
    ] })),
    responses(
        (status = 200, description = "The views", body = NameGrouping),
        (status = 400, description = "`invalid_request`: not JSON of this structure, or an invalid parameter; `upload_incomplete`: the connection closed or timed out"),
        (status = 413, description = "`upload_too_large`: the body exceeds 4 MiB; group the folders one by one"),
        (status = 415, description = "`unsupported_media_type`: not JSON"),
        (status = 422, description = "`invalid_archive`: names that are absolute, the same, too long or point outside of their folder; a manifest that does not match"),
    )
)]
pub async fn group(State(app): State<App>, uri: Uri, headers: HeaderMap, body: Body) -> ApiResult<Json<NameGrouping>> {
    json::require_json(&headers)?;
    let rules = params::from_uri::<NameRules>(&uri)?.rules()?;
    let body = json::read(&app, &headers, body).await?;
    let grouped = app.inspect(move || -> Result<NameGrouping, Fault> {
        let NamesInput { names, manifest } = json::parse(&body, Code::InvalidRequest)?;
        let manifest = manifest.map(|manifest| manifest.to_string());
        Ok(group_names(&names, manifest.as_deref().map(str::as_bytes), &rules)?)
    });
    Ok(Json(grouped.await??))
}
