//! Lists, a page at a time.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{Calibration, Stack};
use crate::{
    contract::ProfileSummary,
    store::{Page, Skipped},
};

/// A page of profiles, newest first.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub struct ProfileList {
    /// At most `limit` of them; fewer when the answer would be larger than about 4 MiB.
    pub items: Vec<ProfileSummary>,
    /// Pass it as `cursor` to get the next page; null on the last one.
    pub next_cursor: Option<String>,
    /// Revisions that cannot be read and are left out; not there when there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub skipped: Vec<Skipped>,
}

/// A page of stacks, newest first.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub struct StackList {
    /// At most `limit` of them; fewer when the answer would be larger than about 4 MiB.
    pub items: Vec<Stack>,
    /// Pass it as `cursor` to get the next page; null on the last one.
    pub next_cursor: Option<String>,
    /// Stacks that cannot be read and are left out; not there when there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub skipped: Vec<Skipped>,
}

/// A page of calibrations, newest first.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub struct CalibrationList {
    /// At most `limit` of them; fewer when the answer would be larger than about 4 MiB.
    pub items: Vec<Calibration>,
    /// Pass it as `cursor` to get the next page; null on the last one.
    pub next_cursor: Option<String>,
    /// Calibrations that cannot be read and are left out; not there when there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub skipped: Vec<Skipped>,
}

impl From<Page<ProfileSummary>> for ProfileList {
    fn from(page: Page<ProfileSummary>) -> Self {
        Self { items: page.items, next_cursor: page.next_cursor, skipped: page.skipped }
    }
}
