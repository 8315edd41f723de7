//! `GET /v1/profiles/{rig}/{lens}/export`

use axum::{
    extract::State,
    http::{HeaderMap, HeaderValue, StatusCode, Uri, header},
    response::{IntoResponse, Response},
};
use serde::Deserialize;
use utoipa::ToSchema;

use super::{file::ProfileFile, find};
use crate::{
    contract::profile::Profile,
    http::{
        ApiError, ApiResult, App,
        extract::{ProfileKey, etag, not_modified, params},
    },
};
use pinstack_science::{
    archive::{npy, npz},
    types::lateral_colour::LateralColour,
};

/// Format of the file.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ExportFormat {
    /// The complete profile, for `.../import`.
    #[default]
    Json,
    /// The arrays, for numpy.
    Npz,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Parameters {
    revision: Option<u32>,
    #[serde(default)]
    format: ExportFormat,
}

/// Export a profile
///
/// `json`: the complete profile with a checksum, to archive or to import on another server. `npz`: arrays for numpy,
/// namely `homographies` (N, 3, 3), `gains` (N), `image_size` (width, height), `reference_index`, and
/// `rail_positions_mm` (N) if they are known.
#[utoipa::path(
    get,
    path = "/v1/profiles/{rig}/{lens}/export",
    operation_id = "export_profile",
    tag = "profiles",
    params(
        ("rig" = String, Path, description = "Name of the rig"),
        ("lens" = String, Path, description = "Name of the lens"),
        ("revision" = Option<u32>, Query, description = "Revision; default: the current one"),
        ("format" = inline(Option<ExportFormat>), Query, description = "`json` (default) or `npz`"),
        ("If-None-Match" = Option<String>, Header, description = "`ETag` of the copy that the client has"),
    ),
    responses(
        (status = 200, description = "The file", content((ProfileFile = "application/json"), (Vec<u8> = "application/x-npz")), headers(
            ("ETag" = String, description = "The revision number"), ("Content-Disposition" = String, description = "A file name made from rig, lens and revision"))),
        (status = 304, description = "The copy of the client is current"),
        (status = 400, description = "`invalid_request`: an invalid name or parameter"),
        (status = 404, description = "`profile_not_found`"),
    )
)]
pub async fn export(State(app): State<App>, key: ProfileKey, uri: Uri, headers: HeaderMap) -> ApiResult<Response> {
    let Parameters { revision, format } = params::from_uri(&uri)?;
    let profile = find(&app, &key.rig, &key.lens, revision).await?;
    let tag = profile.revision.to_string();
    let common = [(header::ETAG, etag(&tag)), (header::CACHE_CONTROL, HeaderValue::from_static("no-cache"))];
    if not_modified(&headers, &tag) {
        return Ok((StatusCode::NOT_MODIFIED, common).into_response());
    }
    let name = format!("{}_{}_r{}", profile.rig, profile.lens, profile.revision);
    let (extension, media_type, bytes) = match format {
        ExportFormat::Json => ("json", "application/json", as_json(profile)?),
        ExportFormat::Npz => ("npz", "application/x-npz", as_npz(&profile)?),
    };
    // names contain no characters that need escaping
    let disposition = format!("attachment; filename=\"{name}.{extension}\"");
    let kind = [(header::CONTENT_TYPE, media_type.to_owned()), (header::CONTENT_DISPOSITION, disposition)];
    Ok((common, kind, bytes).into_response())
}

fn as_json(profile: Profile) -> ApiResult<Vec<u8>> {
    let file = ProfileFile::of(profile).map_err(ApiError::internal)?;
    let mut bytes = serde_json::to_vec_pretty(&file).map_err(ApiError::internal)?;
    bytes.push(b'\n');
    Ok(bytes)
}

fn as_npz(profile: &Profile) -> ApiResult<Vec<u8>> {
    let input = &profile.input;
    let count = input.homographies.len();
    let mut arrays = vec![
        (npz::HOMOGRAPHIES, npy::of_floats(&[count, 3, 3], input.homographies.iter().flat_map(|h| h.0))),
        ("gains", npy::of_floats(&[count], (0..count).map(|i| input.gain(i)))),
        ("image_size", npy::of_integers(&[2], [input.image_width.into(), input.image_height.into()])),
        ("reference_index", npy::of_integers(&[], [input.reference_index.into()])),
    ];
    if let Some(rail) = &input.rail_positions_mm {
        arrays.push(("rail_positions_mm", npy::of_floats(&[rail.len()], rail.iter().copied())));
    }
    if let Some(lens) = &input.distortion {
        let numbers = [lens.centre_px[0], lens.centre_px[1], lens.k1, lens.k2, lens.radius_px];
        arrays.push(("distortion", npy::of_floats(&[5], numbers)));
    }
    if let Some(LateralColour { red, blue }) = &input.lateral_colour {
        let numbers = [red, blue].into_iter().flat_map(|of| [of.scale, of.shift_px[0], of.shift_px[1]]);
        arrays.push(("lateral_colour", npy::of_floats(&[2, 3], numbers)));
    }
    npz::packed(arrays).map_err(ApiError::internal)
}
