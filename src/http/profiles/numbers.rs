//! Bodies of `PUT /v1/profiles/{rig}/{lens}`: a JSON object, or matrices (a numpy file or a bare JSON list) with query
//! parameters for the rest.

use axum::http::{HeaderMap, Uri};
use serde::Deserialize;

use crate::{
    contract::Code,
    http::{
        ApiError, ApiResult,
        extract::{json, params},
        ingest::body::media_type,
    },
};
use pinstack_science::{
    archive::{npy, npz},
    types::{
        Homography, Warning,
        matrices::{self, Direction},
        profile::{CaptureMode, ProfileInput},
    },
};

/// The kind of body according to `Content-Type`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// JSON.
    Json,
    /// An `.npy` or `.npz`.
    Numpy,
    /// `application/octet-stream`: JSON if it begins like JSON, otherwise numpy.
    Bytes,
    /// No `Content-Type`: numpy if it begins like a numpy file, otherwise JSON.
    Unsaid,
}

/// The kind of body according to `Content-Type`.
///
/// # Errors
/// `unsupported_media_type` with the supported media types.
pub fn kind(headers: &HeaderMap) -> ApiResult<Kind> {
    let Some(kind) = media_type(headers) else { return Ok(Kind::Unsaid) };
    match kind.as_str() {
        "application/x-npy" | "application/x-npz" | "application/zip" => Ok(Kind::Numpy),
        "application/octet-stream" => Ok(Kind::Bytes),
        json::FORM => Err(ApiError::new(
            Code::UnsupportedMediaType,
            format!(
                "the body is '{}', the default of curl; send the file with -T, or add \
                 -H 'Content-Type: application/json' (or application/octet-stream for a numpy file)",
                json::FORM
            ),
        )),
        _ if json::require_json(headers).is_ok() => Ok(Kind::Json),
        _ => Err(ApiError::new(
            Code::UnsupportedMediaType,
            format!(
                "the body is '{kind}'; send application/json, or a numpy file as application/x-npy, application/x-npz or \
                 application/octet-stream"
            ),
        )),
    }
}

/// Parses the body and, if the body is matrices, the query.
///
/// # Errors
/// `invalid_profile` for numbers that cannot be a profile; `invalid_request` for parameters that are invalid or do not
/// apply to this kind of body, and for invalid JSON.
pub fn read(kind: Kind, bytes: Vec<u8>, uri: &Uri) -> ApiResult<(ProfileInput, Vec<Warning>)> {
    let first = json::without_mark(&bytes).iter().find(|byte| !byte.is_ascii_whitespace()).copied();
    let is_numpy = bytes.starts_with(npy::MAGIC) || bytes.starts_with(b"PK");
    let as_numpy = match kind {
        Kind::Json => false,
        Kind::Numpy => true,
        Kind::Bytes => !matches!(first, Some(b'{' | b'[')),
        Kind::Unsaid => is_numpy,
    };
    let (input, warnings) = if as_numpy {
        let parameters: Parameters = params::from_uri(uri)?;
        let matrices = npz::matrices(bytes, parameters.array.as_deref())?;
        parameters.profile(&matrices)?
    } else if first == Some(b'[') {
        let parameters: Parameters = params::from_uri(uri)?;
        if parameters.array.is_some() {
            return Err(ApiError::new(
                Code::InvalidRequest,
                "the parameter 'array' applies to .npz files only, but the body is a JSON list; omit it",
            ));
        }
        let matrices: Vec<Homography> = json::parse(&bytes, Code::InvalidProfile)?;
        parameters.profile(&matrices.iter().map(|h| h.0).collect::<Vec<_>>())?
    } else {
        if let Some((name, _)) = params::pairs(uri)?.first() {
            let name: String = name.chars().take(80).collect();
            let detail =
                format!("the parameter '{name}' is for bodies that are matrices; put it into the JSON object instead");
            return Err(ApiError::new(Code::InvalidRequest, detail));
        }
        (json::parse(&bytes, Code::InvalidProfile)?, Vec::new())
    };
    input.check()?;
    Ok((input, warnings))
}

/// What matrices do not contain.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Parameters {
    image_width: Option<u32>,
    image_height: Option<u32>,
    reference_index: Option<u32>,
    #[serde(default)]
    direction: Direction,
    array: Option<String>,
    pixel_pitch_mm: Option<f64>,
    capture_mode: Option<CaptureMode>,
    rail_positions_mm: Option<String>,
    rail_step_mm: Option<f64>,
    note: Option<String>,
}

impl Parameters {
    fn profile(self, given: &[[f64; 9]]) -> ApiResult<(ProfileInput, Vec<Warning>)> {
        let missing = |name: &str| {
            ApiError::new(
                Code::InvalidRequest,
                format!(
                    "{name} is missing: matrices do not contain the size of the slices; add ?image_width=...&image_height=..."
                ),
            )
        };
        let image_width = self.image_width.ok_or_else(|| missing("image_width"))?;
        let image_height = self.image_height.ok_or_else(|| missing("image_height"))?;
        let rail_positions_mm = self.rail(given.len())?;
        let based = matrices::rebase(given, self.direction, self.reference_index, image_width, image_height)?;
        let input = ProfileInput {
            image_width,
            image_height,
            reference_index: based.reference_index,
            homographies: based.homographies,
            rail_positions_mm,
            pixel_pitch_mm: self.pixel_pitch_mm,
            capture_mode: self.capture_mode,
            note: self.note,
            ..ProfileInput::default()
        };
        Ok((input, based.warnings))
    }

    fn rail(&self, count: usize) -> ApiResult<Option<Vec<f64>>> {
        let invalid = |detail: String| Err(ApiError::new(Code::InvalidRequest, detail));
        match (&self.rail_positions_mm, self.rail_step_mm) {
            (None, None) => Ok(None),
            (Some(_), Some(_)) => invalid("rail_positions_mm and rail_step_mm are both given; send one of them".into()),
            (None, Some(step)) if step != 0.0 && (-1000.0..=1000.0).contains(&step) => {
                Ok(Some((0_u32..).take(count).map(|i| f64::from(i) * step).collect()))
            }
            (None, Some(step)) => invalid(format!("rail_step_mm is {step}; it must be -1000 to 1000 and not 0")),
            (Some(text), None) => match text.split(',').map(|position| position.trim().parse()).collect() {
                Ok(positions) => Ok(Some(positions)),
                Err(_) => {
                    invalid("rail_positions_mm must be numbers separated by commas, one per slice: 0,0.5,1".into())
                }
            },
        }
    }
}
