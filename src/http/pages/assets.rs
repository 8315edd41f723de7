//! Style sheet, scripts and icon of the pages: `GET /web/{version}/{file}`.
//!
//! The version is a digest of all files. A page names the version that it was made with, so a browser may keep the file
//! for ever; after an update of the program the pages name other URLs. Modules import one another by relative URLs, so
//! the version holds for them too. A request for another version gets the current file, which is not kept.

use std::sync::LazyLock;

use axum::{
    extract::Path,
    http::{HeaderMap, HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use rust_embed::RustEmbed;
use sha2::{Digest, Sha256};

use crate::{
    contract::Code,
    http::{
        ApiError, ApiResult,
        extract::{etag, not_modified},
    },
};

#[derive(RustEmbed)]
#[folder = "src/http/pages/assets/"]
struct Assets;

/// Digest of all files: part of their URLs.
static VERSION: LazyLock<String> = LazyLock::new(|| {
    let mut names: Vec<_> = Assets::iter().collect();
    names.sort();
    let files = names.iter().filter_map(|name| Some((name, Assets::get(name)?)));
    let digest =
        files.fold(Sha256::new(), |digest, (name, file)| digest.chain_update(name.as_bytes()).chain_update(file.data));
    hex(&digest.finalize()[..6])
});

/// URL of an asset.
pub fn url(name: &str) -> String {
    link!("/web/{}/{name}", *VERSION)
}

/// The endpoint.
///
/// # Errors
/// `not_found`.
pub async fn get(Path((version, name)): Path<(String, String)>, headers: HeaderMap) -> ApiResult<Response> {
    let Some(file) = Assets::get(&name) else {
        return Err(ApiError::new(Code::NotFound, "there is no such file; reload the page"));
    };
    let tag = hex(&file.metadata.sha256_hash()[..12]);
    let cache = if version == *VERSION { "public, max-age=31536000, immutable" } else { "no-cache" };
    let common = [(header::ETAG, etag(&tag)), (header::CACHE_CONTROL, HeaderValue::from_static(cache))];
    if not_modified(&headers, &tag) {
        return Ok((StatusCode::NOT_MODIFIED, common).into_response());
    }
    Ok((common, [(header::CONTENT_TYPE, media_type(&name))], file.data.into_owned()).into_response())
}

fn media_type(name: &str) -> &'static str {
    match name.rsplit_once('.').map(|(_, extension)| extension) {
        Some("css") => "text/css; charset=utf-8",
        Some("js") => "text/javascript; charset=utf-8",
        Some("svg") => "image/svg+xml",
        _ => "application/octet-stream",
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
