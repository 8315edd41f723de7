//! From the body of a request to a checked submission and a complete zip in a spool file.

use axum::body::Body;

use super::{
    admission::{FORM_OVERHEAD, admit},
    body::{EndedEarly, WatchedBody, content_length, media_type},
    fields::Fields,
    filename, multipart,
    receivable::Receivable,
    request::IngestRequest,
    spool::{SpooledZip, spool},
};
use crate::{
    contract::Code,
    http::{ApiError, ApiResult, extract::json},
    telemetry::traces,
};

/// Media types that are accepted for a bare zip: the right one, and those that common tools send instead. Types that a
/// web page of any origin may send without a preflight (`application/x-www-form-urlencoded`, `text/plain`) are not
/// accepted.
const ZIP_TYPES: [&str; 5] = [
    "application/zip",
    "application/x-zip-compressed",
    "application/x-zip",
    "application/octet-stream",
    "binary/octet-stream",
];

impl IngestRequest<'_> {
    /// Checks the submission, then receives its zip, as the whole body or as a part of a form. Nothing of a bare body
    /// is read before the submission is checked and admitted, so a client that sends `Expect: 100-continue` never sends
    /// a file in vain.
    ///
    /// # Errors
    /// What [`Receivable::read`] and [`admit`] refuse; `unsupported_media_type`; `upload_too_large`;
    /// `upload_incomplete`. The spool file is removed in that case.
    pub async fn receive<S: Receivable>(
        &self,
        target: &S::Target,
        fields: Fields,
        body: Body,
    ) -> ApiResult<(S, SpooledZip)> {
        traces::section("receive upload", receive(self, target, fields, body)).await
    }
}

async fn receive<S: Receivable>(
    request: &IngestRequest<'_>,
    target: &S::Target,
    fields: Fields,
    body: Body,
) -> ApiResult<(S, SpooledZip)> {
    let (app, caller, headers) = (request.app, request.caller, request.headers);
    let announced = content_length(headers).unwrap_or(0);
    let media_type = media_type(headers).unwrap_or_default();
    let is_form = media_type == "multipart/form-data";
    let max_bytes = S::max_bytes(app);
    let max_body = if is_form { max_bytes.saturating_add(FORM_OVERHEAD) } else { max_bytes };
    let body = WatchedBody::new(body, headers, max_body, app.policy.body_idle_timeout);
    if is_form {
        // what the URL contains can be checked now, what the form contains only when it arrives
        let job_bytes = match fields.name_profile() {
            true => S::read(app, caller, target, &fields).await?.disk_need(announced),
            false => 0,
        };
        let reservation = admit(request, max_body, job_bytes).await?;
        return multipart::receive(request, target, body, fields, reservation).await;
    }
    require_zip(&media_type)?;
    let submission = S::read(app, caller, target, &fields).await?;
    let reservation = admit(request, max_body, submission.disk_need(announced)).await?;
    let end_reason = body.end_reason();
    let zip = spool(app, body, reservation, filename::of_headers(headers)?, |EndedEarly| end_reason.error()).await?;
    Ok((submission, zip))
}

fn require_zip(media_type: &str) -> ApiResult<()> {
    if media_type.is_empty() || ZIP_TYPES.contains(&media_type) {
        return Ok(());
    }
    let shown: String = media_type.chars().take(80).collect();
    let detail = match shown.as_str() {
        json::FORM => format!(
            "the body is '{shown}', the default of curl --data-binary; add -H 'Content-Type: application/zip', or send \
             the file with -T"
        ),
        _ => format!("the body is '{shown}'; send the zip as application/zip, or in a multipart/form-data form"),
    };
    Err(ApiError::new(Code::UnsupportedMediaType, detail))
}
