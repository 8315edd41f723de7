//! File names of downloads: `{stem}{_artifact}.{extension}`.
//!
//! The stem is what the client called the view. So it stays the same when the view is fused again, and a project that
//! refers to the file still finds it:
//!
//! | given | stem |
//! |---|---|
//! | label, pan or tilt | `{label}_{pan}_{tilt}`: one label may name the specimen of many views |
//! | scan, pan or tilt | `{scan}_{pan}_{tilt}` |
//! | label | `{label}` |
//! | none of these | `{name of the upload, or "stack"}_{end of the id}`: differs from view to view |
//!
//! Two stacks with the same label have the same file name; `curl -OJ` then refuses to overwrite the first, and browsers
//! number the second.

use axum::http::HeaderValue;
use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};

use crate::{
    contract::{
        artifact::{FileFormat, StackArtifact},
        options::StackOptions,
        request::JobRequest,
    },
    store::Job,
};
use pinstack_science::types::text::{composed, not_a_device};

/// Characters that RFC 8187 allows unencoded in `filename*`.
const ATTR_CHAR: &AsciiSet = &NON_ALPHANUMERIC.remove(b'-').remove(b'.').remove(b'_').remove(b'~');

/// Longest stem, in characters.
const MAX_STEM: usize = 100;

/// The file name of an artifact. The image has no suffix, so that `a.png` and `a_mask.png` are the pair that
/// photogrammetry tools look for. The picture of a further light is `a_lights_uv.png`.
pub fn of(job: &Job, artifact: &str, media_type: &str) -> String {
    let stem = match &job.request {
        JobRequest::Stack(request) => of_view(&request.options),
        JobRequest::Calibration(_) => None,
        JobRequest::Reconstruction(request) => Some(tidy(request.scan.as_str())),
    };
    let stem = stem.unwrap_or_else(|| by_upload(job));
    let is_image = artifact == StackArtifact::Image.name();
    let suffix = if is_image { String::new() } else { format!("_{}", artifact.replace('/', "_")) };
    let extension = FileFormat::of_media_type(media_type).unwrap_or(FileFormat::Png).extension();
    format!("{stem}{suffix}.{extension}")
}

/// What the client called the view.
fn of_view(options: &StackOptions) -> Option<String> {
    let label = options.label.as_deref().map(tidy).filter(|label| !label.is_empty());
    let angles = [options.pan_deg, options.tilt_deg];
    if angles == [None, None] {
        return label;
    }
    let subject = label.or_else(|| options.scan.as_ref().map(|scan| tidy(scan.as_str())))?;
    Some(angles.iter().flatten().fold(subject, |stem, angle| format!("{stem}_{}", degrees(*angle))))
}

/// An angle in degrees with three digits before the point and up to three after it, so that names sort like angles.
fn degrees(angle: f64) -> String {
    let text = format!("{:07.3}", angle.abs());
    let sign = if angle < 0.0 { "-" } else { "" };
    format!("{sign}{}", text.trim_end_matches('0').trim_end_matches('.'))
}

/// The file name of the upload and the last digits of the id. Those of a UUIDv7 are random, so that stacks of the same
/// minute differ.
fn by_upload(job: &Job) -> String {
    let upload = job.request.upload().filename.as_deref();
    let upload = upload.map(|name| name.rsplit_once('.').map_or(name, |(stem, _)| stem));
    let stem = upload.map(tidy).filter(|stem| !stem.is_empty()).unwrap_or_else(|| match job.request {
        JobRequest::Stack(_) => "stack".to_owned(),
        JobRequest::Calibration(_) => "calibration".to_owned(),
        JobRequest::Reconstruction(_) => "reconstruction".to_owned(),
    });
    let id = job.id.simple().to_string();
    format!("{stem}_{}", id.get(24..).unwrap_or_default())
}

/// The file name of the zip of a job: as the client named it, or made from the id.
pub fn of_upload(job: &Job) -> String {
    job.request.upload().filename.clone().unwrap_or_else(|| format!("{}.zip", job.id))
}

/// Replaces characters that file systems, shells or photogrammetry tools do not accept: spaces, separators, quotes.
fn tidy(text: &str) -> String {
    let replaced: String = composed(text)
        .chars()
        .take(MAX_STEM)
        .map(|c| if c.is_alphanumeric() || "._-+".contains(c) { c } else { '_' })
        .collect();
    not_a_device(replaced.trim_matches(['.', '_']))
}

/// `Content-Disposition: inline` (RFC 6266), with an ASCII name and, where they differ, the exact name in UTF-8.
pub fn disposition(name: &str) -> HeaderValue {
    disposition_as("inline", name)
}

/// `Content-Disposition: attachment`. The name may be chosen by a client.
pub fn attachment(name: &str) -> HeaderValue {
    disposition_as("attachment", name)
}

fn disposition_as(kind: &'static str, name: &str) -> HeaderValue {
    // clients disagree about escapes in quoted strings
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
    use crate::contract::Name;

    #[test]
    fn characters_that_tools_do_not_accept_are_replaced() {
        assert_eq!(tidy("Carabus violaceus / left \"1\""), "Carabus_violaceus___left__1");
        assert_eq!(tidy("..\\..\\x"), "x");
        assert_eq!(tidy("   "), "");
        assert_eq!(["CON", "nul.txt"].map(tidy), ["_CON", "_nul.txt"], "Windows cannot write these");
    }

    #[test]
    fn a_file_is_named_after_label_scan_and_angles() {
        let named = |label: Option<&str>, scan: Option<&str>, pan_deg, tilt_deg| {
            let scan = scan.map(|scan| Name::new(scan).unwrap());
            of_view(&StackOptions {
                label: label.map(str::to_owned),
                scan,
                pan_deg,
                tilt_deg,
                ..StackOptions::default()
            })
        };
        assert_eq!(named(Some("view 1"), None, None, None).as_deref(), Some("view_1"));
        assert_eq!(named(Some("view 1"), Some("bee"), None, None).as_deref(), Some("view_1"));
        assert_eq!(named(None, Some("bee"), Some(20.0), Some(-7.5)).as_deref(), Some("bee_020_-007.5"));
        assert_eq!(named(Some("Apis"), Some("bee"), Some(120.0), Some(0.0)).as_deref(), Some("Apis_120_000"));
        assert_eq!(named(None, Some("bee"), None, Some(6.0)).as_deref(), Some("bee_006"));
        assert_eq!(named(None, Some("bee"), None, None), None);
        assert_eq!(named(None, None, Some(20.0), None), None);
        assert_eq!(named(Some("//"), None, None, None), None);
    }

    #[test]
    fn a_name_with_umlauts_is_sent_in_ascii_and_in_utf_8() {
        let value = disposition("käfer_1.png");
        assert_eq!(value, "inline; filename=\"k_fer_1.png\"; filename*=UTF-8''k%C3%A4fer_1.png");
        assert_eq!(disposition("bee.png"), "inline; filename=\"bee.png\"");
        assert_eq!(attachment("a\"b.zip"), "attachment; filename=\"a_b.zip\"; filename*=UTF-8''a%22b.zip");
    }
}
