//! Scans: many views of one object. One endpoint per file.
//!
//! A scan is a row with its rig, lens and metadata. Its stacks name it; what it knows of its views is read from them
//! ([`table`]).

pub mod archive;
pub mod bundle;
pub mod camera;
pub mod csv;
pub mod delete;
pub mod get;
pub mod groupings;
pub mod list;
pub mod poses;
pub mod put;
pub mod rerun;
pub mod same_pictures;
pub mod stored_zip;
pub mod table;

use axum::{extract::FromRequestParts, http::request::Parts};

use super::{
    ApiError, ApiResult, App,
    auth::Caller,
    extract::{Numbered, path::named_segment},
    profiles::near,
};
use crate::contract::{Code, Name, Scan};

/// Most scans that are searched for similar names.
const MAX_SEARCHED: u32 = 10_000;

/// `{scan}` in a path.
#[derive(Debug, Clone)]
pub struct ScanName(pub Name);

impl<S: Send + Sync> FromRequestParts<S> for ScanName {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        Ok(Self(named_segment(parts, state, "scan").await?))
    }
}

/// The scan of this name.
///
/// # Errors
/// `scan_not_found` with similar names, also for a scan that the caller may not see.
pub async fn find(app: &App, caller: &Caller, name: &Name) -> ApiResult<Scan> {
    let scan = match is_of_another(app, caller, name).await? {
        true => None,
        false => app.store.metadata.scan(name).await?,
    };
    match scan {
        Some(scan) => Ok(scan),
        None => Err(not_found(app, caller, name).await),
    }
}

/// Whether a scan belongs to another token, where tokens see only their own.
async fn is_of_another(app: &App, caller: &Caller, name: &Name) -> ApiResult<bool> {
    let Some(own) = caller.sees_only(app) else { return Ok(false) };
    Ok(app.store.metadata.scan_owner(name).await?.is_some_and(|owner| owner != own))
}

/// Checks that a stack of this rig and lens may join the scan.
///
/// # Errors
/// `scan_not_found`; `scan_mismatch`.
pub async fn require_joinable(app: &App, caller: &Caller, scan: &Name, rig: &Name, lens: &Name) -> ApiResult<()> {
    let scan = find(app, caller, scan).await?;
    if (&scan.input.rig, &scan.input.lens) == (rig, lens) {
        return Ok(());
    }
    let detail = format!(
        "the scan '{}' is of rig '{}' and lens '{}', the stack is of rig '{rig}' and lens '{lens}'; all views of a scan \
         need one camera: use another scan, or send the stack with the rig and lens of the scan",
        scan.name, scan.input.rig, scan.input.lens
    );
    Err(ApiError::new(Code::ScanMismatch, detail))
}

/// The error for a scan that does not exist. It suggests scans with similar names.
pub async fn not_found(app: &App, caller: &Caller, name: &Name) -> ApiError {
    // without them the error is still complete
    let names = app.store.metadata.scan_names(caller.sees_only(app), MAX_SEARCHED).await.unwrap_or_default();
    let near: Vec<String> = near::names(name, &names).into_iter().map(|near| format!("'{near}'")).collect();
    let near = if near.is_empty() { String::new() } else { format!(" (there is {})", near.join(", ")) };
    let detail = format!("there is no scan '{name}'{near}; create it with PUT /v1/scans/{name}, or correct the name");
    ApiError::new(Code::ScanNotFound, detail)
}

impl Numbered for ScanName {
    const KIND: &'static str = "scan";
    const NUMBER: &'static str = "version";

    fn subject(&self) -> String {
        format!("the scan '{}'", self.0)
    }

    fn url(&self) -> String {
        url(&self.0)
    }

    async fn current(&self, app: &App) -> ApiResult<Option<u32>> {
        Ok(app.store.metadata.scan(&self.0).await?.map(|scan| scan.version))
    }
}

/// The error for a change that a scan with stacks does not allow.
fn has_stacks(name: &Name, stacks: u64, what: &str) -> ApiError {
    let detail = format!(
        "the scan '{name}' has {stacks} stacks, so {what}; delete them first (DELETE /v1/scans/{name}?stacks=delete \
         deletes scan and stacks), or use another scan"
    );
    ApiError::new(Code::Conflict, detail)
}

/// URL of a scan.
pub fn url(name: &Name) -> String {
    link!("/v1/scans/{name}")
}
