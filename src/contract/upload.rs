//! What a job keeps of the zip that was sent.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A stored zip.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Upload {
    /// Key in the blob store.
    #[serde(skip_serializing_if = "String::is_empty", default)]
    pub key: String,
    /// Size, bytes.
    pub bytes: u64,
    /// SHA-256, hex.
    pub sha256: String,
    /// File name that the client gave.
    pub filename: Option<String>,
}
