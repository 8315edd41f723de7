//! Lists, a page at a time.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{Calibration, Stack};
use crate::{model::profile::Profile, store::Page};

/// A page of profiles, newest first.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub struct ProfileList {
    /// At most `limit` of them.
    pub items: Vec<Profile>,
    /// Pass it as `cursor` to get the next page; null on the last one.
    pub next_cursor: Option<String>,
}

/// A page of stacks, newest first.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub struct StackList {
    /// At most `limit` of them.
    pub items: Vec<Stack>,
    /// Pass it as `cursor` to get the next page; null on the last one.
    pub next_cursor: Option<String>,
}

/// A page of calibrations, newest first.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub struct CalibrationList {
    /// At most `limit` of them.
    pub items: Vec<Calibration>,
    /// Pass it as `cursor` to get the next page; null on the last one.
    pub next_cursor: Option<String>,
}

impl From<Page<Profile>> for ProfileList {
    fn from(page: Page<Profile>) -> Self {
        Self { items: page.items, next_cursor: page.next_cursor }
    }
}
