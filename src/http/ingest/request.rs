//! A request that makes a job: who sends it, and whether it repeats an earlier one. The steps that stacks, calibrations
//! and reruns share are methods of it, each in the file of the step:
//!
//! ```text
//! begin     Idempotency-Key: is this a repeat?                                                           here
//! receive   the checked submission, and its zip in a spool file (a rerun takes a stored zip instead)     receive.rs
//! submit    zip -> blob, submission -> queued job                                                        accept.rs
//! answer    202 with the job, or 200 when `Prefer: wait` saw it end                                      accept.rs
//! ```

use axum::http::HeaderMap;

use super::idempotency::IdempotencyKey;
use crate::http::{ApiResult, App, auth::Caller};

/// A request that makes a job.
pub struct IngestRequest<'a> {
    /// The service.
    pub app: &'a App,
    /// Who sent it.
    pub caller: &'a Caller,
    /// Its headers.
    pub headers: &'a HeaderMap,
    /// Its `Idempotency-Key`.
    pub key: IdempotencyKey,
}

impl<'a> IngestRequest<'a> {
    /// Reads the `Idempotency-Key`.
    ///
    /// # Errors
    /// `invalid_request` for a key that breaks the rule.
    pub async fn begin(app: &'a App, caller: &'a Caller, headers: &'a HeaderMap) -> ApiResult<Self> {
        let key = IdempotencyKey::of_request(app, caller, headers).await?;
        Ok(Self { app, caller, headers, key })
    }
}
