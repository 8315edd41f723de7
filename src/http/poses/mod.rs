//! Reports on camera poses: `POST /v1/poses`, and for the views of a scan `POST /v1/scans/{scan}/poses`.
//!
//! Nothing is stored. The file is received into scratch, so that memory does not grow with the number of clients, and
//! few are read at a time.

pub mod create;

use axum::{
    Json,
    body::Body,
    http::{HeaderMap, HeaderValue, Uri, header},
    response::{IntoResponse, Response},
};
use serde::Deserialize;
use tokio::sync::Semaphore;
use utoipa::{IntoParams, ToSchema};

use super::{
    ApiError, ApiResult, App,
    auth::Caller,
    background,
    extract::params,
    ingest::{
        body::{EndedEarly, WatchedBody, content_length},
        quota::QuotaClaim,
        reservation::UploadReservation,
        spool::spool,
    },
    pages::{self, pose_report},
};
use crate::{
    contract::{Code, Fault, scan::MAX_VIEWS},
    store::SpoolFile,
};
use pinstack_science::photogrammetry::poses::{
    self, Commanded, Distance, KnownScale, MAX_FOCAL_PX, PoseFormat, PoseOptions, PoseReport,
};
use pinstack_science::types::error::ErrorLocation;

/// Largest file. COLMAP's `images.txt` has all points: 400 views with 3000 points each have 40 MB.
pub const MAX_BYTES: u64 = 128 << 20;
/// Largest known length, mm.
const MAX_MM: f64 = 100_000.0;
/// Files that are read at a time.
static READERS: Semaphore = Semaphore::const_new(2);

/// The query of both calls.
#[derive(Debug, Clone, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct PoseQuery {
    /// Format of the file; found from its content if absent.
    #[param(inline)]
    pub file_format: Option<PoseFormat>,
    /// Format of the answer.
    #[param(inline)]
    #[serde(default)]
    pub format: ReportFormat,
    /// How many views were to be registered. For a scan, the default is its number of views.
    #[param(minimum = 1, maximum = 10_000)]
    pub expected: Option<u32>,
    /// Known distance from the centre of the turntable to the centre of projection, mm: gives the report its scale.
    #[param(exclusive_minimum = 0.0, maximum = 100_000.0)]
    pub radius_mm: Option<f64>,
    /// One of two views whose distance is known. With `pair_to` and `pair_mm`: gives the report its scale.
    pub pair_from: Option<String>,
    /// The other.
    pub pair_to: Option<String>,
    /// The distance between them, mm.
    #[param(exclusive_minimum = 0.0, maximum = 100_000.0)]
    pub pair_mm: Option<f64>,
    /// A point of the object in the coordinates of the file, `x,y,z`. With `length_to` and `length_mm`: a known length,
    /// which checks scale and focal length.
    #[param(value_type = Option<String>)]
    pub length_from: Option<Vec<f64>>,
    /// Another point of the object, `x,y,z`.
    #[param(value_type = Option<String>)]
    pub length_to: Option<Vec<f64>>,
    /// The distance between them on the object, mm.
    #[param(exclusive_minimum = 0.0, maximum = 100_000.0)]
    pub length_mm: Option<f64>,
    /// Focal length that the program found, px, instead of that of the file. For a scan it is compared with the
    /// principal distance of its profile.
    #[param(exclusive_minimum = 0.0, maximum = 100_000_000.0)]
    pub focal_px: Option<f64>,
    /// Its standard deviation, px.
    #[param(exclusive_minimum = 0.0, maximum = 100_000_000.0)]
    pub focal_sigma_px: Option<f64>,
}

/// Format of a pose report.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReportFormat {
    /// Data.
    #[default]
    Json,
    /// A table to read.
    Text,
    /// A table for a paper.
    Latex,
    /// A page with a drawing of the sphere and the residuals.
    Html,
}

impl PoseQuery {
    /// Parses the query of a URL.
    ///
    /// # Errors
    /// `invalid_request` that names the parameter.
    pub fn of(uri: &Uri) -> ApiResult<Self> {
        let query: Self = params::from_uri(uri)?;
        for (name, value, most) in [
            ("radius_mm", query.radius_mm, MAX_MM),
            ("pair_mm", query.pair_mm, MAX_MM),
            ("length_mm", query.length_mm, MAX_MM),
            ("focal_px", query.focal_px, MAX_FOCAL_PX),
            ("focal_sigma_px", query.focal_sigma_px, MAX_FOCAL_PX),
        ] {
            if value.is_some_and(|value| !(value > 0.0 && value <= most)) {
                return Err(outside(name, &format!("{name} must be greater than 0 and at most {most}")));
            }
        }
        if query.focal_sigma_px.is_some() && query.focal_px.is_none() {
            return Err(outside("focal_sigma_px", "focal_sigma_px needs focal_px: give both, or neither"));
        }
        if query.expected.is_some_and(|views| !(1..=MAX_VIEWS).contains(&views)) {
            return Err(outside("expected", &format!("expected must be 1 to {MAX_VIEWS}")));
        }
        Ok(query)
    }
}

fn outside(name: &str, detail: &str) -> ApiError {
    let place = ErrorLocation { detail: detail.to_owned(), pointer: Some(name.to_owned()), ..ErrorLocation::default() };
    Fault::new(Code::InvalidRequest, detail).at(place).into()
}

/// What is known of the views that the poses should be of.
#[derive(Debug, Clone, Default)]
pub struct KnownViews {
    /// Names, with the commanded angles where they are known.
    pub commanded: Vec<Commanded>,
    /// Number of views.
    pub expected: Option<u32>,
    /// The commanded radius, mm.
    pub radius_mm: Option<f64>,
    /// The principal distance of the camera.
    pub principal_distance: Option<Distance>,
}

/// Receives a file of poses, and answers with the report on them.
///
/// # Errors
/// `invalid_poses` for a file that holds no poses, `upload_too_large` over 128 MiB, `insufficient_storage`.
pub async fn report(
    app: &App,
    caller: &Caller,
    query: PoseQuery,
    headers: &HeaderMap,
    body: Body,
    known: KnownViews,
) -> ApiResult<Response> {
    let scale = scale(&query, known.radius_mm)?;
    let known_length = known_length(&query)?;
    let format = query.format;
    let options = PoseOptions {
        expected: query.expected.or(known.expected),
        scale,
        focal_length: query.focal_px.map(|px| Distance { px, sigma_px: query.focal_sigma_px }),
        principal_distance: known.principal_distance,
        known_length,
        commanded: known.commanded,
    };
    let file = receive(app, caller, headers, body).await?;
    let reader = READERS.acquire().await.map_err(ApiError::internal)?;
    let work = background::blocking_with((reader, file), move |(_, file)| -> ApiResult<Response> {
        let bytes = std::fs::read(file.path()).map_err(ApiError::internal)?;
        let report = poses::report(&poses::read(&bytes, query.file_format)?, &options)?;
        Ok(written(&report, format))
    });
    work.await?
}

/// Receives the file into scratch.
async fn receive(app: &App, caller: &Caller, headers: &HeaderMap, body: Body) -> ApiResult<SpoolFile> {
    let length = content_length(headers);
    if length.is_some_and(|length| length > MAX_BYTES) {
        return Err(too_large());
    }
    let body = WatchedBody::new(body, headers, MAX_BYTES, app.policy.body_idle_timeout);
    let end_reason = body.end_reason();
    let reservation = UploadReservation::admit(app, caller.id(), length, 0, QuotaClaim::default()).await?;
    let file = spool(app, body, reservation, None, |EndedEarly| {
        let error = end_reason.error();
        if error.fault().code == Code::UploadTooLarge { too_large() } else { error }
    });
    Ok(file.await?.file)
}

fn too_large() -> ApiError {
    let detail = format!(
        "a file of poses has at most {} MiB; send COLMAP's images.bin, or export the poses without the points",
        MAX_BYTES >> 20
    );
    ApiError::new(Code::UploadTooLarge, detail)
}

/// The scale that the query or the scan gives.
fn scale(query: &PoseQuery, of_scan: Option<f64>) -> ApiResult<Option<KnownScale>> {
    let PoseQuery { radius_mm, pair_from, pair_to, pair_mm, .. } = query;
    match (radius_mm, (pair_from, pair_to, pair_mm)) {
        (Some(_), (None, None, None)) => Ok(radius_mm.map(|mm| KnownScale::Radius { mm })),
        (None, (Some(from), Some(to), Some(mm))) => {
            Ok(Some(KnownScale::Pair { from: from.clone(), to: to.clone(), mm: *mm }))
        }
        (None, (None, None, None)) => Ok(of_scan.map(|mm| KnownScale::Radius { mm })),
        (Some(_), _) => Err(invalid("radius_mm and a pair give the scale twice; give one of them")),
        (None, _) => Err(invalid("a known distance needs pair_from, pair_to and pair_mm; one of them is missing")),
    }
}

/// The known length of the object that the query gives.
fn known_length(query: &PoseQuery) -> ApiResult<Option<([[f64; 3]; 2], f64)>> {
    let point = |name: &str, point: &[f64]| match *point {
        [x, y, z] if [x, y, z].iter().all(|value| value.abs() < 1e12) => Ok([x, y, z]),
        _ => Err(outside(name, &format!("{name} must be three numbers, x,y,z, below 1e12"))),
    };
    match (&query.length_from, &query.length_to, query.length_mm) {
        (Some(from), Some(to), Some(mm)) => Ok(Some(([point("length_from", from)?, point("length_to", to)?], mm))),
        (None, None, None) => Ok(None),
        _ => Err(invalid("a known length needs length_from, length_to and length_mm; one of them is missing")),
    }
}

fn invalid(detail: &str) -> ApiError {
    ApiError::new(Code::InvalidRequest, detail)
}

/// The report in the format that was asked for.
pub fn written(report: &PoseReport, format: ReportFormat) -> Response {
    let text = |kind: &'static str, text: String| {
        ([(header::CONTENT_TYPE, HeaderValue::from_static(kind))], text).into_response()
    };
    match format {
        ReportFormat::Json => Json(report).into_response(),
        ReportFormat::Text => text("text/plain; charset=utf-8", report.text()),
        ReportFormat::Latex => text("application/x-latex", report.latex()),
        ReportFormat::Html => pages::answer(pose_report::page(report), pose_report::STYLE),
    }
}
