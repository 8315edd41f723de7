//! Which file format of the image the client wants.

use axum::http::{HeaderMap, header};

use crate::{
    http::problem::{ApiError, ApiResult},
    model::Code,
};

/// The formats that the image can be had in.
const FORMATS: [&str; 2] = ["image/png", "image/tiff"];

/// The format that suits the client best; between equals, the one that is stored.
///
/// # Errors
/// `not_acceptable` when neither suits.
pub fn choose(headers: &HeaderMap, stored: &str) -> ApiResult<&'static str> {
    let [png, tiff] = FORMATS;
    let stored = if stored == tiff { tiff } else { png };
    let values: Vec<&str> = headers.get_all(header::ACCEPT).iter().filter_map(|v| v.to_str().ok()).collect();
    if values.is_empty() {
        return Ok(stored);
    }
    let ranges: Vec<(String, f64)> = values.iter().flat_map(|v| v.split(',')).filter_map(media_range).collect();
    let mut best = (stored, quality(&ranges, stored));
    for format in FORMATS {
        let quality = quality(&ranges, format);
        if quality > best.1 {
            best = (format, quality);
        }
    }
    if best.1 > 0.0 {
        return Ok(best.0);
    }
    Err(ApiError::new(Code::NotAcceptable, "the image can be had as image/png or image/tiff"))
}

fn media_range(text: &str) -> Option<(String, f64)> {
    let mut parts = text.split(';');
    let range = parts.next()?.trim().to_ascii_lowercase();
    let quality = parts.find_map(|p| p.trim().strip_prefix("q=")?.trim().parse::<f64>().ok()).unwrap_or(1.0);
    (!range.is_empty()).then_some((range, quality))
}

/// The most specific range decides.
fn quality(ranges: &[(String, f64)], format: &str) -> f64 {
    let of = |wanted: &str| ranges.iter().find(|(range, _)| range == wanted).map(|(_, q)| *q);
    of(format).or_else(|| of("image/*")).or_else(|| of("*/*")).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    fn chosen(accept: &'static str) -> Option<&'static str> {
        let headers = HeaderMap::from_iter([(header::ACCEPT, HeaderValue::from_static(accept))]);
        choose(&headers, "image/png").ok()
    }

    #[test]
    fn the_stored_format_is_kept_unless_another_is_wanted_more() {
        assert_eq!(chosen("*/*"), Some("image/png"));
        assert_eq!(chosen("image/tiff"), Some("image/tiff"));
        assert_eq!(chosen("image/tiff;q=0.5, image/png;q=0.9"), Some("image/png"));
        assert_eq!(chosen("image/avif,image/webp,image/*,*/*;q=0.8"), Some("image/png"));
        assert_eq!(chosen("image/png;q=0, image/*"), Some("image/tiff"));
        assert_eq!(chosen("text/html"), None);
    }
}
