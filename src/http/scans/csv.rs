//! `GET /v1/scans/{scan}/views.csv`

use axum::{
    extract::State,
    http::{HeaderValue, Uri, header},
    response::{IntoResponse, Response},
};
use serde::Deserialize;

use super::{ScanName, find, table::views};
use crate::{
    contract::Verdict,
    http::{
        ApiResult, App,
        artifacts::name::attachment,
        auth::Caller,
        extract::params,
        views::{ScanWithViews, scan::ScanView},
    },
};

/// A column: its name, and how it is written.
type Column = (&'static str, fn(&ScanView) -> String);

/// The columns.
const COLUMNS: [Column; 18] = [
    ("name", |view| view.name.clone()),
    ("label", |view| view.label.clone().unwrap_or_default()),
    ("pan_deg", |view| number(view.pan_deg)),
    ("tilt_deg", |view| number(view.tilt_deg)),
    ("stack", |view| view.stack.clone()),
    ("state", |view| view.state.as_str().to_owned()),
    ("verdict", |view| view.verdict.map(Verdict::as_str).unwrap_or_default().to_owned()),
    ("error", |view| view.error.as_ref().map(|problem| problem.detail.clone()).unwrap_or_default()),
    ("profile_revision", |view| view.profile_revision.to_string()),
    ("width_px", |view| view.image_size_px.map(|size| size[0].to_string()).unwrap_or_default()),
    ("height_px", |view| view.image_size_px.map(|size| size[1].to_string()).unwrap_or_default()),
    ("sharpness", |view| number(view.sharpness)),
    ("mask_area", |view| number(view.mask_area)),
    ("residual_px", |view| number(view.residual_px)),
    ("mean_level", |view| number(view.mean_level)),
    ("unfocused_fraction", |view| number(view.unfocused_fraction)),
    ("findings", |view| view.findings.join(" ")),
    ("outliers", |view| view.outliers.iter().map(|o| o.detail.as_str()).collect::<Vec<_>>().join(" ")),
];

/// How the table is written. A byte order mark is for a spreadsheet only: programs read it as part of the first name.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CsvParameters {
    #[serde(default)]
    bom: bool,
}

/// Get the views of a scan as CSV
///
/// One row per view with its state, verdict, metrics and outliers, as `GET /v1/scans/{scan}` shows them (RFC 4180,
/// UTF-8, decimal points). An empty field means unknown.
#[utoipa::path(
    get,
    path = "/v1/scans/{scan}/views.csv",
    operation_id = "get_scan_views_csv",
    tag = "scans",
    params(
        ("scan" = String, Path, description = "Name of the scan"),
        ("bom" = Option<bool>, Query, description = "Begin with a byte order mark, without which Excel does not read \
            the file as UTF-8; default false"),
    ),
    responses(
        (status = 200, description = "The table", body = String, content_type = "text/csv"),
        (status = 400, description = "`invalid_request`: an invalid name or parameter"),
        (status = 404, description = "`scan_not_found`"),
    )
)]
pub async fn csv(State(app): State<App>, caller: Caller, ScanName(name): ScanName, uri: Uri) -> ApiResult<Response> {
    let CsvParameters { bom } = params::from_uri(&uri)?;
    let scan = find(&app, &caller, &name).await?;
    let views = views(&app, &caller, &name).await?;
    let scan = ScanWithViews::tabulated(scan, views).await?;
    let mut text = if bom { "\u{feff}".to_owned() } else { String::new() };
    text += &line(COLUMNS.iter().map(|(name, _)| (*name).to_owned()));
    for view in &scan.views {
        text.push_str(&line(COLUMNS.iter().map(|(_, write)| write(view))));
    }
    let headers = [
        (header::CONTENT_TYPE, HeaderValue::from_static("text/csv; charset=utf-8")),
        (header::CONTENT_DISPOSITION, attachment(&format!("{name}_views.csv"))),
        (header::CACHE_CONTROL, HeaderValue::from_static("no-cache")),
    ];
    Ok((headers, text).into_response())
}

fn number(value: Option<f64>) -> String {
    value.map(|value| value.to_string()).unwrap_or_default()
}

fn line(fields: impl Iterator<Item = String>) -> String {
    let fields: Vec<String> = fields.map(|field| quoted(&field)).collect();
    fields.join(",") + "\r\n"
}

/// A field as RFC 4180 writes it. A spreadsheet would execute text that begins like a formula, so such text from a
/// client gets an apostrophe.
fn quoted(field: &str) -> String {
    let is_number = field.parse::<f64>().is_ok();
    let is_formula = !is_number && field.starts_with(['=', '+', '-', '@', '\t', '\r']);
    let field = if is_formula { format!("'{field}") } else { field.to_owned() };
    if field.contains([',', '"', '\n', '\r']) { format!("\"{}\"", field.replace('"', "\"\"")) } else { field }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_quoted_and_formulas_disarmed() {
        for (field, written) in [
            ("plain", "plain"),
            ("-6", "-6"),
            ("a,b", "\"a,b\""),
            ("say \"no\"", "\"say \"\"no\"\"\""),
            ("=HYPERLINK(1)", "'=HYPERLINK(1)"),
            ("-view", "'-view"),
        ] {
            assert_eq!(quoted(field), written);
        }
    }
}
