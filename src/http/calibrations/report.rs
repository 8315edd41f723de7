//! `GET /v1/calibrations/{id}/report`

use axum::{
    Json,
    extract::State,
    http::{HeaderMap, HeaderValue, Uri, header},
    response::{IntoResponse, Response},
};
use serde::Deserialize;

use crate::{
    contract::{Code, JobKind, artifact::REPORT, outcome::Artifact, request::JobRequest},
    http::{
        ApiError, ApiResult, App,
        artifacts::{accept::MediaRanges, download, outcome},
        background,
        extract::{JobId, params},
        job_resource::load,
        pages::{
            self,
            calibration_report::{self, Subject, SubjectProfile},
        },
        profiles::drift,
        views::calibration::ReportView,
    },
    store::Job,
};
use pinstack_science::types::report::Drift;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Parameters {
    format: Option<Form>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Form {
    Html,
    Json,
}

/// Get the report of a calibration
///
/// An HTML page for the operator of the rig: verdict, findings, residuals of the dots, measurements of each slice, and
/// the drift since the previous revision. With `Accept: application/json` or `?format=json`, the same as data.
#[utoipa::path(
    get,
    path = "/v1/calibrations/{id}/report",
    operation_id = "get_calibration_report",
    tag = "calibrations",
    params(
        ("id" = String, Path, description = "Id of the calibration"),
        ("format" = Option<String>, Query, description = "`html` or `json`; overrides `Accept`"),
        ("Accept" = Option<String>, Header, description = "`text/html`, the default, or `application/json`"),
    ),
    responses(
        (status = 200, description = "The report", content(
            (String = "text/html"),
            (ReportView = "application/json"),
        )),
        (status = 400, description = "`invalid_request`: `format` is neither `html` nor `json`"),
        (status = 404, description = "`not_found`; `no_result`: the calibration failed, was cancelled, or has no stored report"),
        (status = 406, description = "`not_acceptable`: `Accept` names neither HTML nor JSON"),
        (status = 409, description = "`not_finished`: the calibration is queued or running"),
    )
)]
pub async fn report(State(app): State<App>, JobId(id): JobId, uri: Uri, headers: HeaderMap) -> ApiResult<Response> {
    let Parameters { format } = params::from_uri(&uri)?;
    let form = match format {
        Some(form) => form,
        None => accepted(&headers)?,
    };
    let job = load(&app, id, JobKind::Calibration).await?;
    let (artifact, revision) = stored(&job)?;
    let bytes = download::bytes(&app, &job, artifact).await?;
    let drift = drift_since_previous(&app, &job, revision).await?;
    // rendering thousands of dots takes long: not on the threads that serve other requests
    let mut response = background::blocking(move || answer(form, &job, revision, &bytes, drift)).await??;
    let headers = response.headers_mut();
    headers.insert(header::VARY, HeaderValue::from_static("accept"));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("private, no-cache"));
    Ok(response)
}

/// The stored report of a calibration, and the number of the revision that it made, if it made one.
fn stored(job: &Job) -> ApiResult<(&Artifact, Option<u32>)> {
    let outcome = outcome::of_calibration(job)?;
    let artifact = outcome.artifacts.iter().find(|artifact| artifact.name == REPORT);
    let missing = || {
        let detail = "this calibration has no stored report, because it is older than reports; send the target stack again to \
                      get one";
        ApiError::new(Code::NoResult, detail)
    };
    Ok((artifact.ok_or_else(missing)?, outcome.profile_revision))
}

/// The drift from the previous revision to the one that the job made, even if that was deleted meanwhile.
async fn drift_since_previous(app: &App, job: &Job, revision: Option<u32>) -> ApiResult<Option<Drift>> {
    let Some(revision) = revision else { return Ok(None) };
    let Some(own) = app.store.metadata.profile_of_job(&job.rig, &job.lens, revision).await? else { return Ok(None) };
    let before = drift::before(app, &job.rig, &job.lens, revision).await?;
    Ok(before.map(|before| drift::between(&before, &own)))
}

fn answer(form: Form, job: &Job, revision: Option<u32>, bytes: &[u8], drift: Option<Drift>) -> ApiResult<Response> {
    let report = serde_json::from_slice(bytes).map_err(ApiError::internal)?;
    if form == Form::Json {
        return Ok(Json(ReportView { report, drift }).into_response());
    }
    let note = match &job.request {
        JobRequest::Calibration(request) => request.options.note.as_deref(),
        JobRequest::Stack(_) | JobRequest::Reconstruction(_) => None,
    };
    let ended = job.finished_at.unwrap_or(job.created_at);
    let measured = ended.strftime("%Y-%m-%d %H:%M UTC").to_string();
    let profile = SubjectProfile::Stored { rig: job.rig.as_str(), lens: job.lens.as_str(), revision };
    let subject = Subject { profile, measured: &measured, note };
    let html = calibration_report::page(&subject, &report, drift.as_ref());
    Ok(pages::answer(html, calibration_report::STYLE))
}

/// The format that the client prefers; HTML on a tie.
fn accepted(headers: &HeaderMap) -> ApiResult<Form> {
    let ranges = MediaRanges::of(headers);
    if ranges.is_empty() {
        return Ok(Form::Html);
    }
    let html = ranges.quality(["text/html", "text/*", "*/*"]);
    let json = ranges.quality(["application/json", "application/*", "*/*"]);
    match (html, json) {
        (html, json) if html > 0.0 && html >= json => Ok(Form::Html),
        (_, json) if json > 0.0 => Ok(Form::Json),
        _ => Err(ApiError::new(
            Code::NotAcceptable,
            "the report is available as text/html and application/json; name one of them in Accept",
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn form(accept: &'static str) -> Option<Form> {
        accepted(&HeaderMap::from_iter([(header::ACCEPT, HeaderValue::from_static(accept))])).ok()
    }

    #[test]
    fn the_page_is_sent_unless_json_is_preferred() {
        assert_eq!(accepted(&HeaderMap::new()).ok(), Some(Form::Html));
        assert_eq!(form("*/*"), Some(Form::Html));
        assert_eq!(form("text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8"), Some(Form::Html));
        assert_eq!(form("application/json"), Some(Form::Json));
        assert_eq!(form("application/json, */*;q=0.5"), Some(Form::Json));
        assert_eq!(form("text/html;q=0, */*"), Some(Form::Json));
        assert_eq!(form("image/png"), None);
    }
}
