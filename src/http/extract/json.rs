//! JSON bodies.

use axum::{
    body::Body,
    http::{HeaderMap, header},
};
use http_body_util::{BodyExt, Limited};
use serde::de::DeserializeOwned;

use crate::{
    http::problem::ApiError,
    model::{Code, Fault, error::FaultPlace},
};

/// Largest JSON body: a profile of 1000 slices has about 200 kB, exported with everything 1 MB.
const MAX_JSON_BYTES: usize = 4 << 20;

/// Reads a whole JSON body, or another one of the size of a profile.
///
/// # Errors
/// `upload_too_large` over the limit, `upload_incomplete` when it breaks off.
pub async fn read(body: Body) -> Result<Vec<u8>, ApiError> {
    match Limited::new(body, MAX_JSON_BYTES).collect().await {
        Ok(whole) => Ok(whole.to_bytes().to_vec()),
        Err(error) if error.is::<http_body_util::LengthLimitError>() => {
            Err(ApiError::new(Code::UploadTooLarge, format!("this body has at most {MAX_JSON_BYTES} bytes")))
        }
        Err(_) => Err(ApiError::new(Code::UploadIncomplete, "the body broke off before its end")),
    }
}

/// Checks the `Content-Type`; none at all and curl's default for `--data` are taken for JSON.
///
/// # Errors
/// `unsupported_media_type`.
pub fn require_json(headers: &HeaderMap) -> Result<(), ApiError> {
    let Some(value) = headers.get(header::CONTENT_TYPE) else { return Ok(()) };
    let text = value.to_str().unwrap_or_default();
    let kind = text.split(';').next().unwrap_or_default().trim().to_ascii_lowercase();
    let is_json = kind == "application/json" || (kind.starts_with("application/") && kind.ends_with("+json"));
    if is_json || kind == "application/x-www-form-urlencoded" {
        return Ok(());
    }
    let detail = format!("the body is '{kind}'; send application/json");
    Err(ApiError::new(Code::UnsupportedMediaType, detail))
}

/// Reads JSON into a type. Text that is no JSON is `invalid_request`; JSON of the wrong shape is `shape`.
///
/// # Errors
/// A fault with the JSON pointer of the place.
pub fn parse<T: DeserializeOwned>(bytes: &[u8], shape: Code) -> Result<T, Fault> {
    let mut reader = serde_json::Deserializer::from_slice(bytes);
    let parsed = serde_path_to_error::deserialize(&mut reader);
    let error = match parsed {
        Ok(value) => match reader.end() {
            Ok(()) => return Ok(value),
            Err(error) => return Err(Fault::new(Code::InvalidRequest, format!("the JSON does not end: {error}"))),
        },
        Err(error) => error,
    };
    let pointer = pointer(error.path());
    let inner = error.into_inner();
    if inner.is_data() {
        let detail = if pointer.is_empty() { inner.to_string() } else { format!("{pointer}: {inner}") };
        let place = FaultPlace { detail: detail.clone(), pointer: Some(pointer), ..FaultPlace::default() };
        return Err(Fault::new(shape, detail).at(place));
    }
    // Python writes NaN and Infinity into JSON, and 1e999 overflows: numbers that cannot be, not broken JSON
    let text = String::from_utf8_lossy(bytes);
    let not_finite = ["NaN", "Infinity"].iter().any(|word| text.contains(word));
    if not_finite || inner.to_string().contains("out of range") {
        let detail = format!("{pointer}: a number is not finite ({inner})");
        let place = FaultPlace { detail: detail.clone(), pointer: Some(pointer), ..FaultPlace::default() };
        return Err(Fault::new(shape, detail).at(place));
    }
    Err(Fault::new(Code::InvalidRequest, format!("the body is not JSON: {inner}")))
}

/// The path as a JSON pointer (RFC 6901).
fn pointer(path: &serde_path_to_error::Path) -> String {
    use serde_path_to_error::Segment;
    path.iter()
        .filter_map(|segment| match segment {
            Segment::Seq { index } => Some(format!("/{index}")),
            Segment::Map { key } => Some(format!("/{}", key.replace('~', "~0").replace('/', "~1"))),
            Segment::Enum { variant } => Some(format!("/{variant}")),
            Segment::Unknown => None,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::profile::ProfileInput;

    fn fault(text: &str) -> Fault {
        parse::<ProfileInput>(text.as_bytes(), Code::InvalidProfile).expect_err("the test sends something wrong")
    }

    #[test]
    fn a_wrong_shape_is_told_with_its_pointer() {
        let short = r#"{"image_width":64,"image_height":64,"reference_index":0,"homographies":[[1,0,0,0,1,0,0,0]]}"#;
        let told = fault(short);
        assert_eq!(told.code, Code::InvalidProfile);
        assert!(told.places[0].pointer.as_deref().is_some_and(|p| p.starts_with("/homographies/0")), "{told:?}");
    }

    #[test]
    fn a_number_that_is_not_finite_is_an_invalid_profile_and_broken_json_is_not() {
        let nan = r#"{"image_width":64,"image_height":64,"reference_index":0,"homographies":[[NaN,0,0,0,1,0,0,0,1]]}"#;
        assert_eq!(fault(nan).code, Code::InvalidProfile);
        let huge =
            r#"{"image_width":64,"image_height":64,"reference_index":0,"homographies":[[1e999,0,0,0,1,0,0,0,1]]}"#;
        assert_eq!(fault(huge).code, Code::InvalidProfile);
        assert_eq!(fault("{\"image_width\":").code, Code::InvalidRequest);
    }
}
