//! JSON bodies.

use axum::{body::Body, http::HeaderMap};
use futures::StreamExt;
use serde::de::DeserializeOwned;

use super::json_sentence::{sentence, shortened};
use crate::{
    contract::{Code, Fault},
    http::{
        ApiError, App,
        ingest::body::{EndedEarly, WatchedBody, content_length, media_type},
    },
};
use pinstack_science::types::error::ErrorLocation;

/// Largest JSON body: a profile of 1000 slices has about 200 kB, exported with everything 1 MB.
const MAX_JSON_BYTES: u64 = 4 << 20;
/// Initial size of the buffer at most, whatever the Content-Length.
const FIRST_BYTES: usize = 64 << 10;

/// Largest number of values in a JSON body. An exported profile of 1000 slices has 40,000.
const MAX_JSON_VALUES: usize = 1 << 16;

/// Reads a whole body of at most 4 MiB, with the idle timeout of uploads.
///
/// # Errors
/// `upload_too_large` over the limit; `upload_incomplete` when the body ends early or times out.
pub async fn read(app: &App, headers: &HeaderMap, body: Body) -> Result<Vec<u8>, ApiError> {
    let too_large = || {
        ApiError::new(
            Code::UploadTooLarge,
            format!(
                "the body is too large: a JSON body may have at most {MAX_JSON_BYTES} bytes; check that this is the right file"
            ),
        )
    };
    let announced = content_length(headers).unwrap_or(0);
    let mut body = WatchedBody::new(body, headers, MAX_JSON_BYTES, app.policy.body_idle_timeout);
    if announced > MAX_JSON_BYTES {
        return Err(too_large());
    }
    let end_reason = body.end_reason();
    let mut whole = Vec::with_capacity(usize::try_from(announced).unwrap_or(0).min(FIRST_BYTES));
    while let Some(chunk) = body.next().await {
        match chunk {
            Ok(chunk) => whole.extend_from_slice(&chunk),
            Err(EndedEarly) => {
                let error = end_reason.error();
                return Err(if error.fault().code == Code::UploadTooLarge { too_large() } else { error });
            }
        }
    }
    Ok(whole)
}

/// The default Content-Type of curl's `-d` and `--data-binary`, and one that pages of any origin may send from a
/// browser without a preflight request.
pub const FORM: &str = "application/x-www-form-urlencoded";

/// Checks the `Content-Type`. A missing one means JSON.
///
/// # Errors
/// `unsupported_media_type`.
pub fn require_json(headers: &HeaderMap) -> Result<(), ApiError> {
    let Some(kind) = media_type(headers) else { return Ok(()) };
    let is_json = kind == "application/json" || (kind.starts_with("application/") && kind.ends_with("+json"));
    if is_json {
        return Ok(());
    }
    let kind: String = kind.chars().take(80).collect();
    let detail = match kind.as_str() {
        FORM => {
            format!("the body is '{FORM}', which is the default of curl; add -H 'Content-Type: application/json'")
        }
        _ => format!("the body is '{kind}'; send application/json"),
    };
    Err(ApiError::new(Code::UnsupportedMediaType, detail))
}

/// The text without the byte order mark that PowerShell and Notepad put before UTF-8 (RFC 8259, 8.1, allows parsers to
/// ignore it).
pub fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes)
}

/// Parses JSON into a type.
///
/// # Errors
/// `invalid_request` for text that is not JSON; the code `shape` for JSON of another structure, with its JSON pointer.
pub fn parse<T: DeserializeOwned>(bytes: &[u8], shape: Code) -> Result<T, Fault> {
    let bytes = without_mark(bytes);
    if matches!(bytes, [0xFF, 0xFE, ..] | [0xFE, 0xFF, ..] | [_, 0, ..] | [0, _, ..]) {
        return Err(Fault::new(Code::InvalidRequest, "the body is UTF-16 text; save it as UTF-8"));
    }
    // a parsed value takes 16 times the memory of its text "0,"
    let values = bytes.iter().filter(|byte| matches!(byte, b',' | b'[' | b'{')).count();
    if values > MAX_JSON_VALUES {
        let detail = format!(
            "the JSON has more than {MAX_JSON_VALUES} values; an exported profile of 1000 slices has about 40000, a scan of \
             400 views 32000 names; check that this is the right file"
        );
        return Err(Fault::new(shape, detail));
    }
    let mut reader = serde_json::Deserializer::from_slice(bytes);
    let parsed = serde_path_to_error::deserialize(&mut reader);
    let error = match parsed {
        Ok(value) => match reader.end() {
            Ok(()) => return Ok(value),
            Err(error) => {
                return Err(Fault::new(
                    Code::InvalidRequest,
                    format!("there is text after the end of the JSON: {error}"),
                ));
            }
        },
        Err(error) => error,
    };
    let pointer = pointer(error.path());
    let inner = error.into_inner();
    if inner.is_data() {
        let (detail, pointer) = sentence(&inner.to_string(), &pointer);
        let place = ErrorLocation { detail: detail.clone(), pointer: Some(pointer), ..ErrorLocation::default() };
        return Err(Fault::new(shape, detail).at(place));
    }
    // Python writes NaN and Infinity into JSON, and 1e999 overflows: invalid numbers rather than invalid JSON
    if is_at_not_finite(bytes, &inner) || inner.to_string().contains("out of range") {
        let place = if pointer.is_empty() { String::new() } else { format!("{pointer}: ") };
        let detail = format!("{place}a number is not finite ({inner})");
        let place = ErrorLocation { detail: detail.clone(), pointer: Some(pointer), ..ErrorLocation::default() };
        return Err(Fault::new(shape, detail).at(place));
    }
    Err(Fault::new(Code::InvalidRequest, format!("the body is not JSON: {inner}")))
}

/// Whether the parser stopped at `NaN`, `Infinity`, or after the sign of `-Infinity`.
fn is_at_not_finite(bytes: &[u8], error: &serde_json::Error) -> bool {
    // line and column, counted in bytes from 1, are those of the last byte that was read
    let line = bytes.split(|byte| *byte == b'\n').nth(error.line().saturating_sub(1)).unwrap_or_default();
    let rest = line.get(error.column().saturating_sub(1)..).unwrap_or_default();
    ["NaN", "Infinity"].iter().any(|word| rest.starts_with(word.as_bytes()))
}

/// The path as a JSON pointer (RFC 6901). Of a long name only the beginning is in it.
fn pointer(path: &serde_path_to_error::Path) -> String {
    use serde_path_to_error::Segment;
    path.iter()
        .filter_map(|segment| match segment {
            Segment::Seq { index } => Some(format!("/{index}")),
            Segment::Map { key } => Some(format!("/{}", shortened(key).replace('~', "~0").replace('/', "~1"))),
            Segment::Enum { variant } => Some(format!("/{variant}")),
            Segment::Unknown => None,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinstack_science::types::profile::ProfileInput;

    fn fault(text: &str) -> Fault {
        parse::<ProfileInput>(text.as_bytes(), Code::InvalidProfile).expect_err("the test sends something wrong")
    }

    #[test]
    fn a_wrong_structure_is_reported_with_its_pointer() {
        let short = r#"{"image_width":64,"image_height":64,"reference_index":0,"homographies":[[1,0,0,0,1,0,0,0]]}"#;
        let told = fault(short);
        assert_eq!(told.code, Code::InvalidProfile);
        assert!(told.locations[0].pointer.as_deref().is_some_and(|p| p.starts_with("/homographies/0")), "{told:?}");
    }

    #[test]
    fn a_number_that_is_not_finite_is_an_invalid_profile_and_broken_json_is_not() {
        let nan = r#"{"image_width":64,"image_height":64,"reference_index":0,"homographies":[[NaN,0,0,0,1,0,0,0,1]]}"#;
        assert_eq!(fault(nan).code, Code::InvalidProfile);
        let huge =
            r#"{"image_width":64,"image_height":64,"reference_index":0,"homographies":[[1e999,0,0,0,1,0,0,0,1]]}"#;
        assert_eq!(fault(huge).code, Code::InvalidProfile);
        assert_eq!(fault("{\"image_width\":").code, Code::InvalidRequest);
        for number in ["NaN", "Infinity", "-Infinity"] {
            let text = format!("{{\"note\": \"käfer\",\n \"homographies\": [[0,\n{number}]]}}");
            let told = fault(&text);
            assert_eq!(told.code, Code::InvalidProfile, "{text}");
            assert!(told.detail.starts_with("/homographies/0"), "{told:?}");
            assert!(told.detail.contains("a number is not finite"), "{told:?}");
        }
    }

    #[test]
    fn broken_json_with_the_word_of_a_number_that_is_not_finite_is_broken_json() {
        for text in [
            r#"{"note": "NaN", "image_width": }"#,
            r#"{"note": "to Infinity", "image_width": 64"#,
            "{\"note\": \"Infinity\",\n \"image_width\" 64}",
        ] {
            let told = fault(text);
            assert_eq!(told.code, Code::InvalidRequest, "{text}");
            assert!(told.detail.starts_with("the body is not JSON"), "{told:?}");
        }
    }

    #[test]
    fn json_with_a_byte_order_mark_is_read_and_utf_16_is_named() {
        let whole = |text: &str| parse::<Vec<u8>>(text.as_bytes(), Code::InvalidRequest);
        assert_eq!(whole("\u{feff}[1, 2]"), Ok(vec![1, 2]));
        let utf16 = |order: fn(u16) -> [u8; 2]| "[1]".encode_utf16().flat_map(order).collect::<Vec<u8>>();
        for bytes in
            [utf16(u16::to_le_bytes), utf16(u16::to_be_bytes), [&[0xFF, 0xFE][..], &utf16(u16::to_le_bytes)].concat()]
        {
            let told = parse::<Vec<u8>>(&bytes, Code::InvalidRequest).expect_err("not UTF-8");
            assert_eq!(
                (told.code, told.detail.as_str()),
                (Code::InvalidRequest, "the body is UTF-16 text; save it as UTF-8")
            );
        }
    }

    #[test]
    fn more_values_than_any_profile_has_are_refused_unread() {
        let many = format!("[{}0]", "0,".repeat(1 << 16));
        assert!(fault(&many).detail.starts_with("the JSON has more than 65536 values"));
    }
}
