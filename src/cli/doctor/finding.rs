//! What one check found.

use serde::Serialize;

/// How serious a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Level {
    /// As it should be.
    Ok,
    /// The service runs, but something may become a problem.
    Warning,
    /// The service cannot start or work.
    Problem,
}

/// What one check found.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Finding {
    /// What was checked.
    pub check: &'static str,
    pub level: Level,
    /// What was found and, unless it is as it should be, what to do.
    pub detail: String,
}

impl Finding {
    pub(super) fn ok(check: &'static str, detail: impl Into<String>) -> Self {
        Self { check, level: Level::Ok, detail: detail.into() }
    }

    pub(super) fn warning(check: &'static str, detail: impl Into<String>) -> Self {
        Self { check, level: Level::Warning, detail: detail.into() }
    }

    pub(super) fn problem(check: &'static str, detail: impl Into<String>) -> Self {
        Self { check, level: Level::Problem, detail: detail.into() }
    }
}
