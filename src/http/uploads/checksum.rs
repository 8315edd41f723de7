//! `Upload-Checksum`: the checksum of the body of one request.

use axum::http::HeaderMap;
use base64::{Engine, prelude::BASE64_STANDARD};
use sha1::Sha1;
use sha2::{Digest, Sha256};

use super::protocol::UPLOAD_CHECKSUM;
use crate::{
    contract::Code,
    http::{ApiError, ApiResult},
};

/// The algorithms, as `Tus-Checksum-Algorithm` lists them.
pub const ALGORITHMS: &str = "sha1,sha256";

enum Running {
    Sha1(Sha1),
    Sha256(Sha256),
}

/// The expected checksum, and the running one of what arrives.
pub struct Checksum {
    expected: Vec<u8>,
    running: Running,
}

impl Checksum {
    /// The checksum in the headers of a request.
    ///
    /// # Errors
    /// `invalid_request` for an unknown algorithm or an invalid value.
    pub fn of_request(headers: &HeaderMap) -> ApiResult<Option<Self>> {
        let Some(value) = headers.get(UPLOAD_CHECKSUM) else { return Ok(None) };
        let text = value.to_str().unwrap_or_default();
        let (name, value) = text.trim().split_once(' ').unwrap_or((text, ""));
        let (running, length) = match name {
            "sha1" => (Running::Sha1(Sha1::new()), 20),
            "sha256" => (Running::Sha256(Sha256::new()), 32),
            _ => {
                let detail = format!("Upload-Checksum: unknown algorithm; use one of: {ALGORITHMS}");
                return Err(ApiError::new(Code::InvalidRequest, detail));
            }
        };
        match BASE64_STANDARD.decode(value.trim()) {
            Ok(expected) if expected.len() == length => Ok(Some(Self { expected, running })),
            _ => {
                let detail = format!("Upload-Checksum: the value after '{name}' must be {length} bytes in base64");
                Err(ApiError::new(Code::InvalidRequest, detail))
            }
        }
    }

    /// Adds bytes.
    pub fn update(&mut self, bytes: &[u8]) {
        match &mut self.running {
            Running::Sha1(hash) => hash.update(bytes),
            Running::Sha256(hash) => hash.update(bytes),
        }
    }

    /// Compares the two.
    ///
    /// # Errors
    /// `checksum_mismatch`.
    pub fn verify(self) -> ApiResult<()> {
        let found = match self.running {
            Running::Sha1(hash) => hash.finalize().to_vec(),
            Running::Sha256(hash) => hash.finalize().to_vec(),
        };
        if found == self.expected {
            return Ok(());
        }
        let detail = "the bytes of this request do not match its Upload-Checksum; none of them were stored; send them \
                      again from the same offset";
        Err(ApiError::new(Code::ChecksumMismatch, detail))
    }
}
