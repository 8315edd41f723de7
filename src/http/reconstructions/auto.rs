//! Reconstructions without a request: of scans with `reconstruct: auto`, once all their views are there.
//!
//! What is to be done follows from the store alone, so a server that is killed at any step continues where it was, and
//! several servers may do this at once: a scan is examined when its stacks have changed and have all ended
//! ([`ScanStore::settled_scans`](crate::store::ScanStore::settled_scans)); its job has a key that only this set of
//! stacks has, so there is one; then the store remembers that this state was examined, so that a job that a client
//! deletes does not come back.

use sha2::{Digest, Sha256};
use uuid::Uuid;

use super::{create::enqueue, plan::request_of};
use crate::{
    contract::{
        Code, JobKind,
        reconstruction::{ReconstructionOptions, ReconstructionRequest},
        request::JobRequest,
    },
    http::{ApiResult, App, auth::Caller, ingest::idempotency::fingerprint},
    store::{JobFilter, PageRequest, digest::hex, scans::SettledScan},
};

/// Between two looks at the scans, in multiples of the time between two looks at the jobs that requests wait for.
const POLLS: u32 = 5;
/// Latest reconstructions among which one of the same stacks may be.
const LATEST: u32 = 20;

/// Looks for scans to reconstruct, for ever.
pub async fn watch(app: App) {
    if !app.policy.reconstructs {
        return;
    }
    loop {
        tokio::time::sleep(app.policy.poll_interval * POLLS).await;
        if let Err(error) = look(&app).await {
            tracing::warn!(code = error.fault().code.name(), "cannot look for scans to reconstruct; trying again");
        }
    }
}

/// Examines the scans whose stacks have changed.
async fn look(app: &App) -> ApiResult<()> {
    for scan in app.store.metadata.settled_scans().await? {
        match examine(app, &scan).await {
            Ok(()) => {}
            Err(error) if is_passing(error.fault().code) => {
                tracing::warn!(scan = %scan.name, detail = error.fault().detail, "not reconstructed yet");
                continue;
            }
            Err(error) => tracing::info!(scan = %scan.name, detail = error.fault().detail, "not reconstructed"),
        }
        app.store.metadata.scan_examined(&scan).await?;
    }
    Ok(())
}

/// Whether the same may succeed later, although nothing about the scan changes.
fn is_passing(code: Code) -> bool {
    matches!(code, Code::QueueFull | Code::Unavailable | Code::InsufficientStorage)
}

/// Makes the reconstruction of a scan once all its views are there, and once for the same stacks.
async fn examine(app: &App, scan: &SettledScan) -> ApiResult<()> {
    let Some(caller) = Caller::of_owner(app, scan.owner).await? else { return Ok(()) };
    let options = ReconstructionOptions::default();
    let (of, request) = request_of(app, &caller, &scan.name, options).await?;
    let stacks = stacks(&request);
    if stacks.len() < request.expected as usize || was_made(app, &caller, scan, &stacks).await? {
        return Ok(());
    }
    let digest = hex(&Sha256::digest(stacks.iter().flat_map(Uuid::as_bytes).copied().collect::<Vec<u8>>()));
    // no key of a client begins with a blank
    let key = format!(" auto {} {digest}", scan.name);
    let fingerprint = fingerprint(JobKind::Reconstruction, (&scan.name, options), &digest);
    let made = enqueue(app, &caller, of, request, Some((key, fingerprint))).await?;
    tracing::info!(scan = %scan.name, id = %made.job.id, "all views are there: the scan is reconstructed");
    Ok(())
}

/// The stacks of the views, in order.
fn stacks(request: &ReconstructionRequest) -> Vec<Uuid> {
    let mut stacks: Vec<Uuid> = request.views.iter().map(|view| view.stack).collect();
    stacks.sort_unstable();
    stacks
}

/// Whether one of the latest reconstructions is of these stacks.
async fn was_made(app: &App, caller: &Caller, scan: &SettledScan, of: &[Uuid]) -> ApiResult<bool> {
    let filter = JobFilter {
        kind: Some(JobKind::Reconstruction),
        scan: Some(scan.name.clone()),
        owner: caller.sees_only(app),
        ..JobFilter::default()
    };
    let latest = app.store.metadata.jobs(&filter, &PageRequest { limit: LATEST, cursor: None }).await?;
    Ok(latest.items.iter().any(|job| matches!(&job.request, JobRequest::Reconstruction(made) if stacks(made) == of)))
}
