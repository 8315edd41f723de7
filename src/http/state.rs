//! The application state of every handler.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;

use super::{
    artifacts::conversions::Conversions,
    connections::Tally,
    ingest::{quota::Claims, reservation::Shares},
    pages::stacks::thumbnail::Thumbnails,
    recent::Recent,
    system::readyz,
    watch::JobWatch,
};
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

/// How long the result of `/readyz` is cached.
const READINESS_AGE: Duration = Duration::from_secs(1);

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
    /// Reservations of the open uploads by token.
    pub shares: Shares,
    /// Changes of the jobs that requests wait for.
    pub watch: Arc<JobWatch>,
    /// What the requests in progress claim of the quotas of their tokens.
    pub claims: Claims,
    /// A token exists. Tokens are never deleted, only revoked.
    has_tokens: Arc<AtomicBool>,
    /// Conversions of stored images to other file formats.
    pub conversions: Arc<Conversions>,
    /// Thumbnails of the web pages.
    pub thumbnails: Arc<Thumbnails>,
    /// Permits to cut a tile out of a picture.
    pub tile_permits: Arc<Semaphore>,
    /// Requests in progress by token.
    pub tally: Tally,
    /// The cached result of `/readyz`.
    pub readiness: Arc<Recent<readyz::LastChecks>>,
    /// Permits to inspect a zip. An inspection needs as much memory as a hostile zip makes it need, so few run at once.
    pub inspection_permits: Arc<Semaphore>,
}

impl App {
    /// An application over a store.
    pub fn new(store: Store, policy: Policy) -> Self {
        let disk = DiskBudget::new(&store, policy.min_free_bytes);
        let watch = JobWatch::new(Arc::clone(&store.metadata), policy.poll_interval);
        Self {
            store,
            disk,
            watch,
            shares: Shares::default(),
            claims: Claims::default(),
            policy: Arc::new(policy),
            shutdown: CancellationToken::new(),
            has_tokens: Arc::default(),
            conversions: Arc::default(),
            thumbnails: Arc::default(),
            tile_permits: Arc::new(Semaphore::new(TILES)),
            tally: Tally::default(),
            readiness: Arc::new(Recent::new(READINESS_AGE)),
            inspection_permits: Arc::new(Semaphore::new(INSPECTIONS)),
        }
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
