//! `?redirect=true`: the client takes a stored file from the bucket itself, by a signed URL, and spares the service the
//! bytes.
//!
//! The client asks for it, because a redirect breaks what does not expect one: pages (their content policy forbids
//! other hosts), programs that do not follow redirects, and those that resume by the `ETag` of the service. The service
//! answers itself, as without the parameter, where the signed URL would not do:
//!
//! | request | reason |
//! |---|---|
//! | files are in a folder, or `storage_presigned_s` is 0 | there is no such URL |
//! | `HEAD` | the signature is for `GET` |
//! | a conversion (`Accept`) | the bucket has the stored file only |
//! | `If-Match`, `If-Range` | the bucket compares them with an `ETag` of its own |
//! | the copy of the client is current | 304, without a redirect |

use axum::{
    extract::FromRequestParts,
    http::{HeaderMap, HeaderValue, Method, StatusCode, header, request::Parts},
    response::{IntoResponse, Response},
};

use super::download::{Download, Source};
use crate::{
    http::{
        ApiError, ApiResult, App,
        extract::{not_modified, params},
    },
    store::blobs::SignedAnswer,
};

/// The parameter.
const REDIRECT: &str = "redirect";

/// Whether the client follows a redirect to the bucket: `GET` with `?redirect=true`.
#[derive(Debug, Clone, Copy)]
pub struct MayRedirect(bool);

impl<S: Send + Sync> FromRequestParts<S> for MayRedirect {
    type Rejection = ApiError;

    /// Other parameters are ignored, as everywhere on a file.
    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, ApiError> {
        let mut pairs = params::pairs(&parts.uri)?;
        pairs.retain(|(name, _)| name == REDIRECT);
        #[derive(serde::Deserialize)]
        struct Asked {
            #[serde(default)]
            redirect: bool,
        }
        let Asked { redirect } = params::typed(&pairs)?;
        Ok(Self(redirect && parts.method == Method::GET))
    }
}

impl MayRedirect {
    /// 307 to the bucket; `None` where the service must answer itself. `disposition` is the `Content-Disposition` of
    /// the file.
    ///
    /// # Errors
    /// When the key of the bucket cannot be read.
    pub async fn answer(
        self,
        app: &App,
        download: &Download,
        disposition: &HeaderValue,
        headers: &HeaderMap,
    ) -> ApiResult<Option<Response>> {
        let Some(valid) = app.policy.presigned.filter(|_| self.0) else { return Ok(None) };
        let is_compared = [header::IF_MATCH, header::IF_RANGE].iter().any(|name| headers.contains_key(name));
        if is_compared || not_modified(headers, &download.tag) {
            return Ok(None);
        }
        let Some(Source::Blob(blobs, key)) = download.content.as_ref().map(|content| &content.source) else {
            return Ok(None);
        };
        let shown = SignedAnswer {
            media_type: download.media_type.clone(),
            disposition: disposition.to_str().unwrap_or_default().to_owned(),
        };
        let Some(url) = blobs.signed_url(key, valid, &shown).await? else { return Ok(None) };
        let location = HeaderValue::from_str(&url).map_err(ApiError::internal)?;
        let headers = [
            (header::LOCATION, location),
            // the URL expires, and is a key to the file until then
            (header::CACHE_CONTROL, HeaderValue::from_static("no-store")),
        ];
        Ok(Some((StatusCode::TEMPORARY_REDIRECT, headers).into_response()))
    }
}
