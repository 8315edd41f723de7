//! Sums over all rows, for the gauges of Prometheus.

use jiff::Timestamp;

use crate::contract::{JobKind, JobState};

/// What the rows add up to at one moment. As large as the lists of kinds and states, and one entry per token with a quota.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Totals {
    /// One entry per kind and state that has jobs.
    pub jobs: Vec<JobTotals>,
    /// Resumable uploads that are not complete.
    pub open_uploads: u64,
    /// Bytes of them that have arrived.
    pub open_upload_bytes: u64,
    /// The quotas of valid tokens.
    pub quotas: Vec<QuotaUse>,
}

/// The jobs of one kind in one state.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct JobTotals {
    /// Stacks or calibrations.
    pub kind: JobKind,
    /// In this state.
    pub state: JobState,
    /// How many there are.
    pub count: u64,
    /// Bytes of their zips.
    pub upload_bytes: u64,
    /// Bytes of their results.
    pub result_bytes: u64,
    /// When the oldest of them was accepted.
    pub oldest: Timestamp,
}

/// A quota, and what of it is used, bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct QuotaUse {
    /// May be used.
    pub quota: u64,
    /// Is used.
    pub used: u64,
}
