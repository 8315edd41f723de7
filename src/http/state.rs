//! The application state of every handler. What requests share is in the files below. No part of the state knows a
//! handler, or the whole state.

pub mod conversions;
pub mod health;
pub mod job_watch;
mod recent;
pub mod thumbnails;
pub mod token_sums;

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;

use self::{
    conversions::Conversions, health::HealthChecks, job_watch::JobWatch, thumbnails::Thumbnails, token_sums::TokenSums,
};
use super::{ApiError, ApiResult, background};
use crate::{
    disk_budget::DiskBudget,
    settings::Policy,
    store::{Store, StoreResult},
};

/// Zips that are inspected at a time. Each may need the memory of one member of the zip in the worst case (a TIFF whose
/// parts are out of order).
const INSPECTIONS: usize = 2;

/// Tiles that are cut at a time.
const TILES: usize = 4;

/// The state of every handler. Cheap to clone.
#[derive(Clone)]
pub struct App {
    /// Metadata, blobs, upload parts and workspace.
    pub store: Store,
    /// Limits and rules.
    pub policy: Arc<Policy>,
    /// Fires at the shutdown, which ends event streams and waiting requests.
    pub shutdown: CancellationToken,
    /// Disk budget: what uploads, jobs and conversions of this process reserve.
    pub disk: Arc<DiskBudget>,
    /// Bytes reserved ahead of those that have arrived, by token.
    pub reserved_ahead: TokenSums,
    /// Changes of the jobs that requests wait for.
    pub watch: Arc<JobWatch>,
    /// Bytes that requests in progress claim of the quotas of their tokens, and that the store does not count yet.
    pub claims: TokenSums,
    /// A token exists. Tokens are never deleted, only revoked.
    has_tokens: Arc<AtomicBool>,
    /// Conversions of stored images to other file formats.
    pub conversions: Arc<Conversions>,
    /// Thumbnails of the web pages.
    pub thumbnails: Arc<Thumbnails>,
    /// Permits to cut a tile out of a picture.
    pub tile_permits: Arc<Semaphore>,
    /// Requests in progress by token.
    pub in_progress: TokenSums,
    /// The checks of `/readyz`.
    pub health: Arc<HealthChecks>,
    /// Permits to inspect a zip.
    inspection_permits: Arc<Semaphore>,
}

impl App {
    /// An application over a store.
    pub fn new(store: Store, policy: Policy) -> Self {
        let disk = DiskBudget::new(&store, policy.min_free_bytes);
        let watch = JobWatch::new(Arc::clone(&store.metadata), policy.poll_interval);
        Self {
            conversions: Conversions::new(&store, &disk, policy.archive),
            health: HealthChecks::new(&store, &disk),
            store,
            disk,
            watch,
            reserved_ahead: TokenSums::default(),
            claims: TokenSums::default(),
            policy: Arc::new(policy),
            shutdown: CancellationToken::new(),
            has_tokens: Arc::default(),
            thumbnails: Arc::default(),
            tile_permits: Arc::new(Semaphore::new(TILES)),
            in_progress: TokenSums::default(),
            inspection_permits: Arc::new(Semaphore::new(INSPECTIONS)),
        }
    }

    /// Inspects a zip, or a list of file names, on another thread. An inspection needs as much memory as a hostile zip
    /// makes it need, so few run at once.
    ///
    /// # Errors
    /// `internal` when the inspection panics.
    pub async fn inspect<T: Send + 'static>(&self, work: impl FnOnce() -> T + Send + 'static) -> ApiResult<T> {
        let permit = Arc::clone(&self.inspection_permits).acquire_owned().await.map_err(ApiError::internal)?;
        background::blocking_with(permit, |_| work()).await
    }

    /// Whether this request needs a token. With `auth_once_there_are_tokens` the store is queried until a token exists,
    /// so that the server need not be restarted after the first one is made.
    ///
    /// # Errors
    /// When the store cannot be read. The request must then be refused.
    pub async fn requires_token(&self) -> StoreResult<bool> {
        if self.policy.auth_required || self.has_tokens.load(Ordering::Relaxed) {
            return Ok(true);
        }
        let asks = self.policy.auth_once_there_are_tokens && self.store.metadata.any_token().await?;
        if asks && !self.has_tokens.swap(true, Ordering::Relaxed) {
            tracing::warn!("a token was made: every request needs one from now on");
        }
        Ok(asks)
    }
}
