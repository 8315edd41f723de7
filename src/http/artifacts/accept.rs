//! Chooses the file format of a picture from the `Accept` header (RFC 9110, section 12.5.1).

use axum::http::{HeaderMap, header};

use crate::contract::artifact::FileFormat;

/// The format that the client prefers among `formats` and the stored one. `None`: the stored one. It wins ties, and is
/// also sent when the client accepts none of them: RFC 9110, section 12.4.1, allows that, and generated clients ask for
/// `application/json` or `application/octet-stream` although they can read any file.
pub fn choose(headers: &HeaderMap, formats: &[FileFormat], stored: &str) -> Option<FileFormat> {
    let ranges = MediaRanges::of(headers);
    let quality = |media_type: &str| ranges.quality([media_type, "image/*", "*/*"]);
    let mut best = (None, quality(stored));
    for &format in formats.iter().filter(|format| format.media_type() != stored) {
        let quality = quality(format.media_type());
        if quality > best.1 {
            best = (Some(format), quality);
        }
    }
    best.0
}

/// The media ranges of an `Accept` header with their quality values.
pub struct MediaRanges(Vec<(String, f64)>);

impl MediaRanges {
    /// Parses the `Accept` headers of a request. Ranges that cannot be read are ignored.
    pub fn of(headers: &HeaderMap) -> Self {
        let values = headers.get_all(header::ACCEPT).iter().filter_map(|v| v.to_str().ok());
        Self(values.flat_map(|v| v.split(',')).filter_map(media_range).collect())
    }

    /// True when the request accepts everything because it has no `Accept`.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The quality value of the first of these ranges that the client sent; 0 when it sent none. List the most specific
    /// range first.
    pub fn quality(&self, ranges: [&str; 3]) -> f64 {
        let sent = |wanted: &&str| self.0.iter().find(|(range, _)| range == wanted);
        ranges.iter().find_map(sent).map_or(0.0, |(_, quality)| *quality)
    }
}

fn media_range(text: &str) -> Option<(String, f64)> {
    let mut parts = text.split(';');
    let range = parts.next()?.trim().to_ascii_lowercase();
    let quality = parts.find_map(|p| p.trim().strip_prefix("q=")?.trim().parse::<f64>().ok()).unwrap_or(1.0);
    (!range.is_empty()).then_some((range, quality))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contract::artifact::StackArtifact;
    use axum::http::HeaderValue;

    fn chosen(accept: &'static str, artifact: StackArtifact) -> Option<FileFormat> {
        let headers = HeaderMap::from_iter([(header::ACCEPT, HeaderValue::from_static(accept))]);
        choose(&headers, artifact.formats(), "image/png")
    }

    #[test]
    fn the_stored_format_is_kept_unless_another_is_preferred() {
        let image = |accept| chosen(accept, StackArtifact::Image);
        assert_eq!(choose(&HeaderMap::new(), StackArtifact::Image.formats(), "image/png"), None);
        assert_eq!(image("*/*"), None);
        assert_eq!(image("image/tiff"), Some(FileFormat::Tiff));
        assert_eq!(image("image/jpeg"), Some(FileFormat::Jpeg));
        assert_eq!(image("image/tiff;q=0.5, image/png;q=0.9"), None);
        assert_eq!(image("image/avif,image/webp,image/*,*/*;q=0.8"), None);
        assert_eq!(image("image/png;q=0, image/*"), Some(FileFormat::Tiff));
    }

    #[test]
    fn a_client_that_accepts_no_available_format_gets_the_stored_file() {
        for accept in ["text/html", "application/json", "application/problem+json", "application/octet-stream"] {
            assert_eq!(chosen(accept, StackArtifact::Image), None, "{accept}");
        }
        assert_eq!(chosen("image/webp", StackArtifact::Image), None);
        assert_eq!(chosen("image/png;q=0", StackArtifact::Image), None);
    }

    #[test]
    fn data_is_not_converted_to_jpeg() {
        assert_eq!(chosen("image/jpeg", StackArtifact::Depth), None);
        assert_eq!(chosen("image/tiff", StackArtifact::Depth), Some(FileFormat::Tiff));
        assert_eq!(chosen("image/tiff", StackArtifact::Preview), None);
    }
}
