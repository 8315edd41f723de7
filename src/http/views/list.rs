//! Lists, one page at a time.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{Calibration, Stack};
use crate::{
    contract::{ProfileSummary, Scan, request::JobRequest},
    store::{Job, Page, Skipped},
};

/// A page of profiles, newest first.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub struct ProfileList {
    /// At most `limit` items; fewer when the response would exceed about 4 MiB.
    pub items: Vec<ProfileSummary>,
    /// Pass it as `cursor` to get the next page; null on the last page.
    pub next_cursor: Option<String>,
    /// Revisions that cannot be read and are omitted from `items`; absent when there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub skipped: Vec<Skipped>,
}

/// A page of scans, newest first.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub struct ScanList {
    /// At most `limit` items; fewer when the response would exceed about 4 MiB.
    pub items: Vec<Scan>,
    /// Pass it as `cursor` to get the next page; null on the last page.
    pub next_cursor: Option<String>,
    /// Scans that cannot be read and are omitted from `items`; absent when there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub skipped: Vec<Skipped>,
}

/// A page of stacks, newest first.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub struct StackList {
    /// At most `limit` items; fewer when the response would exceed about 4 MiB.
    pub items: Vec<Stack>,
    /// Pass it as `cursor` to get the next page; null on the last page.
    pub next_cursor: Option<String>,
    /// Stacks that cannot be read and are omitted from `items`; absent when there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub skipped: Vec<Skipped>,
}

/// A page of calibrations, newest first.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub struct CalibrationList {
    /// At most `limit` items; fewer when the response would exceed about 4 MiB.
    pub items: Vec<Calibration>,
    /// Pass it as `cursor` to get the next page; null on the last page.
    pub next_cursor: Option<String>,
    /// Calibrations that cannot be read and are omitted from `items`; absent when there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub skipped: Vec<Skipped>,
}

impl From<Page<ProfileSummary>> for ProfileList {
    fn from(page: Page<ProfileSummary>) -> Self {
        Self { items: page.items, next_cursor: page.next_cursor, skipped: page.skipped }
    }
}

impl From<Page<Scan>> for ScanList {
    fn from(page: Page<Scan>) -> Self {
        Self { items: page.items, next_cursor: page.next_cursor, skipped: page.skipped }
    }
}

impl From<Page<Job>> for StackList {
    fn from(page: Page<Job>) -> Self {
        let stack = |job: &Job| match &job.request {
            JobRequest::Stack(request) => Some(Stack::of(job, request)),
            JobRequest::Calibration(_) => None,
        };
        let items = page.items.iter().filter_map(stack).collect();
        Self { items, next_cursor: page.next_cursor, skipped: page.skipped }
    }
}

impl From<Page<Job>> for CalibrationList {
    fn from(page: Page<Job>) -> Self {
        let calibration = |job: &Job| match &job.request {
            JobRequest::Calibration(request) => Some(Calibration::of(job, request)),
            JobRequest::Stack(_) => None,
        };
        let items = page.items.iter().filter_map(calibration).collect();
        Self { items, next_cursor: page.next_cursor, skipped: page.skipped }
    }
}
