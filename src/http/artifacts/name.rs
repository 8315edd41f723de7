//! Names of downloads: `{label or name of the upload}_{end of the id}_{what}.png`.

use axum::http::HeaderValue;
use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};

use crate::{model::request::JobRequest, store::Job};

/// What RFC 8187 lets stand in `filename*`.
const ATTR_CHAR: &AsciiSet = &NON_ALPHANUMERIC.remove(b'-').remove(b'.').remove(b'_').remove(b'~');

/// Longest stem, in characters.
const MAX_STEM: usize = 100;

/// The file name of a result. The image itself has no suffix, so that `a.png` and `a_mask.png` are the pair that
/// photogrammetry tools look for. The last digits of a UUIDv7 are the random ones: two stacks of one minute differ
/// there.
pub fn of(job: &Job, what: &str, media_type: &str) -> String {
    let label = match &job.request {
        JobRequest::Stack(request) => request.options.label.as_deref(),
        JobRequest::Calibration(_) => None,
    };
    let upload =
        job.request.upload().filename.as_deref().map(|name| name.rsplit_once('.').map_or(name, |(stem, _)| stem));
    let stem = [label, upload].into_iter().flatten().map(tidy).find(|stem| !stem.is_empty());
    let stem = stem.unwrap_or_else(|| match job.request {
        JobRequest::Stack(_) => "stack".to_owned(),
        JobRequest::Calibration(_) => "calibration".to_owned(),
    });
    let id = job.id.simple().to_string();
    let short = id.get(24..).unwrap_or_default();
    let suffix = if what == "image" { String::new() } else { format!("_{what}") };
    let extension = if media_type == "image/tiff" { "tiff" } else { "png" };
    format!("{stem}_{short}{suffix}.{extension}")
}

/// The file name of the zip of a job: as it was sent, or made up.
pub fn of_upload(job: &Job) -> String {
    job.request.upload().filename.clone().unwrap_or_else(|| format!("{}.zip", job.id))
}

/// Without what file systems, shells and photogrammetry tools stumble over: blanks, separators, quotes.
fn tidy(text: &str) -> String {
    let replaced: String =
        text.chars().take(MAX_STEM).map(|c| if c.is_alphanumeric() || "._-+".contains(c) { c } else { '_' }).collect();
    replaced.trim_matches(['.', '_']).to_owned()
}

/// `Content-Disposition` as RFC 6266 has it, of a file to look at: an ASCII name for everybody, and the right one for who
/// can read it.
pub fn disposition(name: &str) -> HeaderValue {
    disposition_as("inline", name)
}

/// The same of a file to save. The name may be one that a client chose.
pub fn attachment(name: &str) -> HeaderValue {
    disposition_as("attachment", name)
}

fn disposition_as(kind: &'static str, name: &str) -> HeaderValue {
    // a quoted string has escapes of its own that clients read in different ways
    let plain = |c: char| (c.is_ascii_graphic() || c == ' ') && !['"', '\\', '%'].contains(&c);
    let ascii: String = name.chars().map(|c| if plain(c) { c } else { '_' }).collect();
    let value = if ascii == name {
        format!("{kind}; filename=\"{ascii}\"")
    } else {
        let extended = utf8_percent_encode(name, ATTR_CHAR);
        format!("{kind}; filename=\"{ascii}\"; filename*=UTF-8''{extended}")
    };
    HeaderValue::from_str(&value).unwrap_or_else(|_| HeaderValue::from_static(kind))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_loses_what_tools_stumble_over() {
        assert_eq!(tidy("Carabus violaceus / left \"1\""), "Carabus_violaceus___left__1");
        assert_eq!(tidy("..\\..\\x"), "x");
        assert_eq!(tidy("   "), "");
    }

    #[test]
    fn a_name_with_umlauts_is_sent_in_both_spellings() {
        let value = disposition("käfer_1.png");
        assert_eq!(value, "inline; filename=\"k_fer_1.png\"; filename*=UTF-8''k%C3%A4fer_1.png");
        assert_eq!(disposition("bee.png"), "inline; filename=\"bee.png\"");
        assert_eq!(attachment("a\"b.zip"), "attachment; filename=\"a_b.zip\"; filename*=UTF-8''a%22b.zip");
    }
}
