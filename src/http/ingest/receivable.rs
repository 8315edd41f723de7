//! What the submissions of stacks, calibrations and scans have in common while their zip is received.

use std::future::Future;

use super::fields::Fields;
use crate::http::{ApiResult, App, auth::Caller};

/// What a zip is received for. It is checked before the zip is read.
pub trait Receivable: Sized + Send {
    /// What the URL names beside the fields.
    type Target: Sync;

    /// Parses and checks the fields of a request, and reads what they name from the store.
    ///
    /// # Errors
    /// `invalid_request` that names the field; the codes of what does not exist.
    fn read(
        app: &App,
        caller: &Caller,
        target: &Self::Target,
        fields: &Fields,
    ) -> impl Future<Output = ApiResult<Self>> + Send;

    /// Bytes that will be written beyond an upload of `announced` bytes.
    fn disk_need(&self, announced: u64) -> u64;

    /// Largest upload, bytes.
    fn max_bytes(app: &App) -> u64;
}
