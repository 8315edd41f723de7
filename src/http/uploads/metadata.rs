//! `Upload-Metadata`: the client's description of its upload.

use std::collections::BTreeMap;

use axum::http::{HeaderMap, HeaderName};
use base64::{Engine, prelude::BASE64_STANDARD};

use crate::{
    contract::{Code, Name, UploadPurpose},
    http::{
        ApiError, ApiResult,
        extract::path::name,
        ingest::{fields::Fields, filename, submission::scan::NAME_RULES},
    },
};

/// The header.
pub const UPLOAD_METADATA: HeaderName = HeaderName::from_static("upload-metadata");

/// Longest header that is accepted, bytes.
const MAX_LENGTH: usize = 16 << 10;

/// The decoded values by name. Unknown names are kept and shown, because clients send names of their own.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Metadata(pub BTreeMap<String, String>);

impl Metadata {
    /// The header of a request, as text and decoded. Empty for a request without it.
    ///
    /// # Errors
    /// As [`Metadata::parse`].
    pub fn of_request(headers: &HeaderMap) -> ApiResult<(String, Self)> {
        let text = match headers.get(UPLOAD_METADATA).map(|value| value.to_str()) {
            None => "",
            Some(Ok(text)) => text,
            Some(Err(_)) => {
                return Err(refuse(
                    "Upload-Metadata contains characters that are not ASCII; encode each value in base64",
                ));
            }
        };
        Ok((text.to_owned(), Self::parse(text)?))
    }

    /// Parses `name base64,name base64,name`.
    ///
    /// # Errors
    /// `invalid_request` that names the invalid part.
    pub fn parse(text: &str) -> ApiResult<Self> {
        if text.len() > MAX_LENGTH {
            return Err(refuse(&format!("Upload-Metadata is longer than {MAX_LENGTH} bytes")));
        }
        let mut pairs = BTreeMap::new();
        for part in text.split(',').map(str::trim).filter(|part| !part.is_empty()) {
            let (name, value) = part.split_once(' ').unwrap_or((part, ""));
            let decoded = BASE64_STANDARD.decode(value.trim()).ok().and_then(|bytes| String::from_utf8(bytes).ok());
            let Some(value) = decoded else {
                return Err(refuse(&format!("Upload-Metadata: the value of '{name}' is not UTF-8 text in base64")));
            };
            if pairs.insert(name.to_owned(), value).is_some() {
                return Err(refuse(&format!("Upload-Metadata contains '{name}' twice; send it once")));
            }
        }
        Ok(Self(pairs))
    }

    /// What the upload becomes.
    ///
    /// # Errors
    /// `invalid_request` for an unknown purpose.
    pub fn purpose(&self) -> ApiResult<UploadPurpose> {
        let Some(name) = self.0.get("purpose") else { return Ok(UploadPurpose::Stack) };
        UploadPurpose::of_name(name).ok_or_else(|| {
            let name: String = name.chars().take(80).collect();
            refuse(&format!("Upload-Metadata: purpose is '{name}'; it must be stack, calibration or scan"))
        })
    }

    /// The scan of an upload with the purpose `scan`.
    ///
    /// # Errors
    /// `invalid_request` when it is missing or no name.
    pub fn scan(&self) -> ApiResult<Name> {
        match self.0.get("scan") {
            Some(text) => name("scan", text.clone()),
            None => Err(refuse("Upload-Metadata: purpose is 'scan', but 'scan' is missing; it names the scan")),
        }
    }

    /// The file name that the client gave.
    pub fn filename(&self) -> Option<String> {
        self.0.get("filename").and_then(|name| filename::tidy(name))
    }

    /// The fields that describe the submission, like those of a form. Those of a scan may say how names are read.
    pub fn fields(&self) -> Fields {
        let rules: &[&str] = match self.purpose() {
            Ok(UploadPurpose::Scan) => &NAME_RULES,
            _ => &[],
        };
        let names = ["rig", "lens"].iter().chain(rules);
        let pairs = names.filter_map(|&name| Some((name.to_owned(), self.0.get(name)?.clone())));
        Fields { pairs: pairs.collect(), options: self.0.get("options").map(|text| text.clone().into_bytes()) }
    }
}

fn refuse(detail: &str) -> ApiError {
    ApiError::new(Code::InvalidRequest, detail)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_with_and_without_values_are_read_and_unknown_ones_kept() {
        let read = Metadata::parse("rig cmlnLTE=, lens bGVucw== ,relativePath bnVsbA==,is_secret").expect("valid");
        assert_eq!(read.0["rig"], "rig-1");
        assert_eq!((read.0["relativePath"].as_str(), read.0["is_secret"].as_str()), ("null", ""));
        assert_eq!(read.fields().pairs, [("rig".into(), "rig-1".into()), ("lens".into(), "lens".into())]);
        assert_eq!(read.purpose().expect("the default"), UploadPurpose::Stack);
        assert_eq!(Metadata::parse("").expect("nothing is fine"), Metadata::default());
    }

    #[test]
    fn an_invalid_value_is_refused_with_its_name() {
        let scan = Metadata::parse("purpose c2Nhbg==,scan YmVl").expect("valid");
        assert_eq!(scan.purpose().expect("known"), UploadPurpose::Scan);
        assert_eq!(scan.scan().expect("given").as_str(), "bee");
        assert!(Metadata::default().scan().is_err());
        let rules = "x cGFu,x_zero MTIw,relativePath bnVsbA==";
        let scan = Metadata::parse(&format!("purpose c2Nhbg==,scan YmVl,{rules}")).expect("valid");
        assert_eq!(scan.fields().pairs, [("x".into(), "pan".into()), ("x_zero".into(), "120".into())]);
        assert_eq!(Metadata::parse(rules).expect("valid").fields().pairs, [], "a stack has no such rules");
        for (text, expected) in [
            ("rig %%%", "'rig' is not UTF-8"),
            ("rig /w==", "'rig' is not UTF-8"),
            ("rig cmln,rig cmln", "contains 'rig' twice"),
            ("purpose bHVuY2g=", "purpose is 'lunch'"),
        ] {
            let refused = Metadata::parse(text).and_then(|read| read.purpose()).expect_err(text);
            assert!(refused.fault().detail.contains(expected), "{:?}", refused.fault());
        }
    }
}
