//! Which file format of a picture the client wants.

use axum::http::{HeaderMap, header};

/// Formats that a picture can be had in, besides the one that is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Formats {
    /// PNG, TIFF and JPEG: pictures for the eye.
    All,
    /// PNG and TIFF: numbers that a JPEG would change.
    Lossless,
    /// The stored one alone.
    Stored,
}

impl Formats {
    fn media_types(self) -> &'static [&'static str] {
        match self {
            Self::All => &["image/png", "image/tiff", "image/jpeg"],
            Self::Lossless => &["image/png", "image/tiff"],
            Self::Stored => &[],
        }
    }
}

/// The format that suits the client best; none for the stored one, which wins between equals and where nothing that can be
/// had is acceptable. RFC 9110, section 12.4.1, allows that: generated clients ask for `application/json` or
/// `application/octet-stream` and can read any file.
pub fn choose(headers: &HeaderMap, formats: Formats, stored: &str) -> Option<&'static str> {
    let values = headers.get_all(header::ACCEPT).iter().filter_map(|v| v.to_str().ok());
    let ranges: Vec<(String, f64)> = values.flat_map(|v| v.split(',')).filter_map(media_range).collect();
    let mut best = (None, quality(&ranges, stored));
    for &format in formats.media_types().iter().filter(|format| **format != stored) {
        let quality = quality(&ranges, format);
        if quality > best.1 {
            best = (Some(format), quality);
        }
    }
    best.0
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

    fn chosen(accept: &'static str, formats: Formats) -> Option<&'static str> {
        let headers = HeaderMap::from_iter([(header::ACCEPT, HeaderValue::from_static(accept))]);
        choose(&headers, formats, "image/png")
    }

    #[test]
    fn the_stored_format_is_kept_unless_another_is_wanted_more() {
        let all = |accept| chosen(accept, Formats::All);
        assert_eq!(choose(&HeaderMap::new(), Formats::All, "image/png"), None);
        assert_eq!(all("*/*"), None);
        assert_eq!(all("image/tiff"), Some("image/tiff"));
        assert_eq!(all("image/jpeg"), Some("image/jpeg"));
        assert_eq!(all("image/tiff;q=0.5, image/png;q=0.9"), None);
        assert_eq!(all("image/avif,image/webp,image/*,*/*;q=0.8"), None);
        assert_eq!(all("image/png;q=0, image/*"), Some("image/tiff"));
    }

    #[test]
    fn who_accepts_nothing_that_there_is_gets_the_stored_file() {
        for accept in ["text/html", "application/json", "application/problem+json", "application/octet-stream"] {
            assert_eq!(chosen(accept, Formats::All), None, "{accept}");
        }
        assert_eq!(chosen("image/webp", Formats::All), None);
        assert_eq!(chosen("image/png;q=0", Formats::All), None);
    }

    #[test]
    fn numbers_are_not_made_a_jpeg() {
        assert_eq!(chosen("image/jpeg", Formats::Lossless), None);
        assert_eq!(chosen("image/tiff", Formats::Lossless), Some("image/tiff"));
        assert_eq!(chosen("image/tiff", Formats::Stored), None);
    }
}
