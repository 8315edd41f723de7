//! An upload in a `multipart/form-data` form: the parts `rig`, `lens`, `options` (JSON) and `stack` (the zip), in any
//! order.

use axum::{
    body::Body,
    extract::{
        FromRequest, Multipart, Request,
        multipart::{Field, MultipartError},
    },
    http::{HeaderMap, header},
};

use futures::TryStreamExt;

use super::{
    body::{EndedEarly, WatchedBody},
    fields::Fields,
    filename,
    form_body::FormBody,
    receivable::Receivable,
    request::IngestRequest,
    reservation::UploadReservation,
    spool::{SpooledZip, spool},
};
use crate::{
    contract::Code,
    http::{ApiError, ApiResult},
};

/// Most bytes of text in all parts that are not the file.
const MAX_TEXT: usize = 64 << 10;
/// Longest name of a part, bytes.
const MAX_NAME: usize = 100;
/// Most parts of a form.
const MAX_PARTS: usize = 64;
/// Part names under which clients send the file.
const FILE_PARTS: [&str; 2] = ["stack", "file"];

/// Receives a form. When rig and lens are known before the file begins, the submission is checked before the file is
/// received; in any case it is checked at the end, with all parts.
///
/// # Errors
/// `invalid_request` for a form that cannot be parsed or lacks the file; the rest as for a bare body.
pub(super) async fn receive<S: Receivable>(
    request: &IngestRequest<'_>,
    target: &S::Target,
    body: WatchedBody,
    mut fields: Fields,
    reservation: UploadReservation,
) -> ApiResult<(S, SpooledZip)> {
    let (app, caller, headers) = (request.app, request.caller, request.headers);
    let mut body = FormBody::new(body);
    let mut form = open(headers, body.clone()).await?;
    let mut reservation = Some(reservation);
    let mut file = None;
    let mut seen = Vec::new();
    let mut text_left = MAX_TEXT;
    while let Some(part) = form.next_field().await.map_err(|e| broken(&body, &e))? {
        body.part_began();
        let name = part.name().unwrap_or_default().to_owned();
        if name.len() > MAX_NAME {
            let detail =
                format!("the form has a part with a name of {} bytes; the limit is {MAX_NAME} bytes", name.len());
            return Err(ApiError::new(Code::InvalidRequest, detail));
        }
        if seen.contains(&name) {
            let detail = format!("the form has the part '{name}' twice; send each part once");
            return Err(ApiError::new(Code::InvalidRequest, detail));
        }
        if seen.len() >= MAX_PARTS {
            let detail = format!("the form has more than {MAX_PARTS} parts; send all slices in one zip");
            return Err(ApiError::new(Code::InvalidRequest, detail));
        }
        if FILE_PARTS.contains(&name.as_str()) {
            let Some(reservation) = reservation.take() else {
                return Err(ApiError::new(Code::InvalidRequest, "the form has two files; send one stack per request"));
            };
            if fields.name_profile() {
                S::read(app, caller, target, &fields).await?;
            }
            let filename = filename::of_headers(part.headers())?;
            let data = part.inspect_ok(|chunk| body.data_came(chunk.len() as u64));
            file = Some(spool(app, data, reservation, filename, |e| broken(&body, &e)).await?);
        } else if name == "options" {
            fields.options = Some(text(part, &body, &mut text_left).await?.into_bytes());
        } else if part.file_name().is_some() {
            let detail = format!(
                "the part '{name}' is a file; put all slices into one zip and send it in the part 'stack' \
                 (curl -F stack=@stack.zip)"
            );
            return Err(ApiError::new(Code::InvalidRequest, detail));
        } else {
            let value = text(part, &body, &mut text_left).await?;
            fields.add(&name, value)?;
        }
        seen.push(name);
    }
    body.drain().await.map_err(|EndedEarly| body.end_reason().error())?;
    let submission = S::read(app, caller, target, &fields).await?;
    match file {
        Some(file) => Ok((submission, file)),
        None => Err(ApiError::new(Code::InvalidRequest, "the form has no part 'stack'; send the zip in it")),
    }
}

async fn open(headers: &HeaderMap, body: FormBody) -> ApiResult<Multipart> {
    let mut request = Request::new(Body::from_stream(body));
    if let Some(kind) = headers.get(header::CONTENT_TYPE) {
        request.headers_mut().insert(header::CONTENT_TYPE, kind.clone());
    }
    // `WatchedBody` limits the length
    axum::extract::DefaultBodyLimit::disable().apply(&mut request);
    Multipart::from_request(request, &()).await.map_err(|_| {
        ApiError::new(Code::InvalidRequest, "the Content-Type of the form has no boundary; let your HTTP client set it")
    })
}

async fn text(mut part: Field<'_>, body: &FormBody, left: &mut usize) -> ApiResult<String> {
    let name = part.name().unwrap_or_default().to_owned();
    let mut bytes = Vec::new();
    while let Some(chunk) = part.chunk().await.map_err(|e| broken(body, &e))? {
        body.data_came(chunk.len() as u64);
        let Some(rest) = left.checked_sub(chunk.len()) else {
            let detail = format!(
                "the parts up to '{name}' have more than {MAX_TEXT} bytes of text; send the zip in the part 'stack'"
            );
            return Err(ApiError::new(Code::InvalidRequest, detail));
        };
        *left = rest;
        bytes.extend_from_slice(&chunk);
    }
    String::from_utf8(bytes)
        .map_err(|_| ApiError::new(Code::InvalidRequest, format!("the part '{name}' is not UTF-8 text")))
}

fn broken(body: &FormBody, error: &MultipartError) -> ApiError {
    body.end_reason().known().unwrap_or_else(|| {
        let detail = format!("the form cannot be read: {}", error.body_text());
        ApiError::new(Code::UploadIncomplete, detail)
    })
}
