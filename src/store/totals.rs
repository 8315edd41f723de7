//! Sums over all rows, for metrics.

use jiff::Timestamp;

use crate::contract::{JobKind, JobState};

/// Sums over all rows at one moment. Its size is bounded by the number of kinds, states, and tokens with a quota.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Totals {
    /// One entry per kind and state that has jobs.
    pub jobs: Vec<JobTotals>,
    /// Number of resumable uploads that are not complete.
    pub open_uploads: u64,
    /// Bytes of these uploads that have arrived.
    pub open_upload_bytes: u64,
    /// The quotas of valid tokens.
    pub quotas: Vec<QuotaUse>,
}

/// The jobs of one kind in one state.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct JobTotals {
    /// Stacks or calibrations.
    pub kind: JobKind,
    /// State.
    pub state: JobState,
    /// Number of jobs.
    pub count: u64,
    /// Bytes of their zips.
    pub upload_bytes: u64,
    /// Bytes of their results.
    pub result_bytes: u64,
    /// Time of acceptance of the oldest job.
    pub oldest: Timestamp,
}

/// A quota and its use, in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct QuotaUse {
    /// Bytes that may be used.
    pub quota: u64,
    /// Bytes that are used.
    pub used: u64,
}
