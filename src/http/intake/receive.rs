//! From a request to an order and a whole file on the disk.

use axum::{
    body::Body,
    http::{HeaderMap, header},
};

use super::{
    admission::{FORM_OVERHEAD, admit, waits_for_continue},
    body::{EndedEarly, WatchedBody},
    filename, multipart,
    order::{Fields, Order},
    quota::QuotaClaim,
    spool::{Spooled, spool},
};
use crate::{
    contract::Code,
    http::{
        auth::Caller,
        extract::json,
        problem::{ApiError, ApiResult},
        state::App,
    },
};

/// Kinds of body that are taken for a bare zip: what is right, and what tools send that do not know better. Not what a page of
/// any origin may send from a browser (`application/x-www-form-urlencoded`, `text/plain`).
const ZIP_TYPES: [&str; 5] = [
    "application/zip",
    "application/x-zip-compressed",
    "application/x-zip",
    "application/octet-stream",
    "binary/octet-stream",
];

/// Receives an upload, bare or in a form. Nothing of a bare body is read before the order is checked, so a client
/// that waits for `100 Continue` never sends a file for nothing.
///
/// # Errors
/// Whatever is wrong with order, admission or body; the spool file is gone then.
pub async fn receive<O: Order>(
    app: &App,
    caller: &Caller,
    headers: &HeaderMap,
    body: Body,
    fields: Fields,
    is_repeat: bool,
    quota: QuotaClaim,
) -> ApiResult<(O, Spooled)> {
    let kind = media_type(headers);
    let is_form = kind == "multipart/form-data";
    let max_bytes = app.policy.max_upload_bytes;
    let max_body = if is_form { max_bytes.saturating_add(FORM_OVERHEAD) } else { max_bytes };
    let body = WatchedBody::new(body, max_body, app.policy.body_idle_timeout, waits_for_continue(headers));
    if is_form {
        // what the URL says can be checked at once
        let is_addressed = O::is_addressed(&fields);
        let job_bytes = if is_addressed { O::read(app, &fields).await?.disk_need() } else { 0 };
        let reservation = admit(app, caller, headers, max_body, is_repeat, job_bytes, quota).await?;
        return multipart::receive(app, headers, body, fields, reservation).await;
    }
    if !kind.is_empty() && !ZIP_TYPES.contains(&kind.as_str()) {
        let kind: String = kind.chars().take(80).collect();
        let detail = match kind.as_str() {
            json::FORM => format!(
                "the body is '{kind}', as curl says of --data-binary when nobody tells it; add -H 'Content-Type: \
                 application/zip', or send the file with -T"
            ),
            _ => format!("the body is '{kind}'; send the zip as application/zip, or multipart/form-data"),
        };
        return Err(ApiError::new(Code::UnsupportedMediaType, detail));
    }
    let order = O::read(app, &fields).await?;
    let reservation = admit(app, caller, headers, max_body, is_repeat, order.disk_need(), quota).await?;
    let verdict = body.verdict();
    let file = spool(app, body, reservation, filename::of_request(headers), |EndedEarly| verdict.error()).await?;
    Ok((order, file))
}

fn media_type(headers: &HeaderMap) -> String {
    let text = headers.get(header::CONTENT_TYPE).and_then(|v| v.to_str().ok()).unwrap_or_default();
    text.split(';').next().unwrap_or_default().trim().to_ascii_lowercase()
}
