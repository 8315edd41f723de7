//! `GET /v1/targets/dots`

use axum::{
    http::{HeaderValue, Uri, header},
    response::{IntoResponse, Response},
};

use crate::http::{ApiResult, artifacts::name::disposition, extract::params};
use pinstack_science::optics::page::{PageFormat, TargetInput, TargetPage};

/// Get a dot target to print
///
/// A grid of dots at true scale, as PDF or SVG. Print it at 100 %. On A4 and Letter, measure the line below the dots;
/// on `paper=fit`, which has no line, measure the distance between the first and the last dot of a row: (columns - 1)
/// pitches. On a coded target dots of two sizes make every dot unique, so that the calibration cannot mistake a shift
/// by one pitch.
#[utoipa::path(
    get,
    path = "/v1/targets/dots",
    operation_id = "get_dot_target",
    tag = "optics",
    params(TargetInput),
    responses(
        (status = 200, description = "The page", content((Vec<u8> = "application/pdf"), (String = "image/svg+xml"))),
        (status = 400, description = "`invalid_request`: a parameter that is missing, unknown or outside its range, dots that do not fit on the page, or a PDF page that readers do not show"),
    )
)]
pub async fn dots(uri: Uri) -> ApiResult<Response> {
    let input: TargetInput = params::from_uri(&uri)?;
    let page = TargetPage::new(&input)?;
    let (kind, extension, body) = match input.format {
        PageFormat::Pdf => ("application/pdf", "pdf", page.pdf()),
        PageFormat::Svg => ("image/svg+xml", "svg", page.svg().into_bytes()),
    };
    let TargetInput { pitch_mm, columns, rows, .. } = input;
    let name = format!("dots_{columns}x{rows}_{pitch_mm}mm.{extension}");
    let headers =
        [(header::CONTENT_TYPE, HeaderValue::from_static(kind)), (header::CONTENT_DISPOSITION, disposition(&name))];
    Ok((headers, body).into_response())
}
