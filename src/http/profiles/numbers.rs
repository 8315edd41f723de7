//! Bodies of `PUT /v1/profiles/{rig}/{lens}`: a JSON object, or matrices (numpy files, a bare JSON list) with query
//! parameters for what matrices do not say.

use axum::http::{HeaderMap, Uri, header};
use serde::Deserialize;

use crate::{
    contract::Code,
    http::{
        extract::{json, params},
        problem::{ApiError, ApiResult},
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

/// What the `Content-Type` says about the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// JSON.
    Json,
    /// An `.npy` or `.npz`.
    Numpy,
    /// Bytes: the first ones tell.
    Bytes,
    /// Nothing: the first bytes tell, else it is JSON.
    Unsaid,
}

/// The kind of body by its `Content-Type`.
///
/// # Errors
/// `unsupported_media_type` with the kinds that are understood.
pub fn kind(headers: &HeaderMap) -> ApiResult<Kind> {
    let Some(value) = headers.get(header::CONTENT_TYPE) else { return Ok(Kind::Unsaid) };
    let text = value.to_str().unwrap_or_default();
    let kind = text.split(';').next().unwrap_or_default().trim().to_ascii_lowercase();
    match kind.as_str() {
        "application/x-npy" | "application/x-npz" | "application/zip" => Ok(Kind::Numpy),
        "application/octet-stream" => Ok(Kind::Bytes),
        json::FORM => Err(ApiError::new(
            Code::UnsupportedMediaType,
            format!(
                "the body is '{}', as curl says when nobody tells it; send the file with -T, or add \
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

/// Reads the body, and the query where the body is matrices.
///
/// # Errors
/// `invalid_profile` for numbers that cannot be a profile, `invalid_request` for parameters that break their rules or do
/// not belong to this body, and for what is no JSON.
pub fn read(kind: Kind, bytes: Vec<u8>, uri: &Uri) -> ApiResult<(ProfileInput, Vec<Warning>)> {
    let first = bytes.iter().find(|byte| !byte.is_ascii_whitespace()).copied();
    let is_numpy = bytes.starts_with(npy::MAGIC) || bytes.starts_with(b"PK");
    let as_numpy = match kind {
        Kind::Json => false,
        Kind::Numpy => true,
        Kind::Bytes => !matches!(first, Some(b'{' | b'[')),
        Kind::Unsaid => is_numpy,
    };
    let (input, warnings) = if as_numpy {
        let told: Parameters = params::from_uri(uri)?;
        let matrices = npz::matrices(bytes, told.array.as_deref())?;
        told.profile(&matrices)?
    } else if first == Some(b'[') {
        let told: Parameters = params::from_uri(uri)?;
        if told.array.is_some() {
            return Err(ApiError::new(Code::InvalidRequest, "'array' chooses in an .npz; the body is a JSON list"));
        }
        let matrices: Vec<Homography> = json::parse(&bytes, Code::InvalidProfile)?;
        told.profile(&matrices.iter().map(|h| h.0).collect::<Vec<_>>())?
    } else {
        if let Some((name, _)) = params::pairs(uri)?.first() {
            let name: String = name.chars().take(80).collect();
            let detail =
                format!("the parameter '{name}' is for bodies that are matrices; a JSON object says it itself");
            return Err(ApiError::new(Code::InvalidRequest, detail));
        }
        (json::parse(&bytes, Code::InvalidProfile)?, Vec::new())
    };
    input.check()?;
    Ok((input, warnings))
}

/// What matrices do not say by themselves.
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
                    "{name} is missing: matrices do not tell how large the slices are; add ?image_width=...&image_height=..."
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
            (Some(_), Some(_)) => invalid("rail_positions_mm and rail_step_mm are both given; give one of them".into()),
            (None, Some(step)) if step != 0.0 && (-1000.0..=1000.0).contains(&step) => {
                Ok(Some((0_u32..).take(count).map(|i| f64::from(i) * step).collect()))
            }
            (None, Some(step)) => invalid(format!("rail_step_mm is {step}; it must be -1000 to 1000 and not 0")),
            (Some(text), None) => match text.split(',').map(|position| position.trim().parse()).collect() {
                Ok(positions) => Ok(Some(positions)),
                Err(_) => {
                    invalid("rail_positions_mm must be numbers with commas between, one per slice: 0,0.5,1".into())
                }
            },
        }
    }
}
