//! The application state of every handler, and the policy: limits and rules of the service. What requests share is in
//! the files below: no part of the state knows the handlers that use it, or the whole state.

pub mod conversions;
pub mod health;
pub mod job_watch;
mod recent;
pub mod thumbnails;
pub mod token_sums;

use std::{
    net::IpAddr,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;

use self::{
    conversions::Conversions, health::HealthChecks, job_watch::JobWatch, thumbnails::Thumbnails, token_sums::TokenSums,
};
use super::{ApiError, ApiResult, background, connections::AddressRange};
use crate::{
    disk_budget::DiskBudget,
    store::{Store, StoreResult, gc::MOST_STORING},
};
use pinstack_science::archive::ArchiveLimits;

/// Zips that are inspected at a time. Each may need the memory of one member of the zip in the worst case (a TIFF whose
/// parts are out of order).
const INSPECTIONS: usize = 2;

/// Tiles that are cut at a time.
const TILES: usize = 4;

/// Limits and rules of the service.
#[derive(Debug, Clone)]
pub struct Policy {
    /// Largest upload, bytes.
    pub max_upload_bytes: u64,
    /// Largest upload with all views of a scan, bytes.
    pub max_scan_bytes: u64,
    /// Limits of a zip.
    pub archive: ArchiveLimits,
    /// Largest number of queued jobs.
    pub queue_limit: u64,
    /// Longest time from the first blob that a request stores to the row of its job. No setting: it must be less than
    /// the grace of garbage collection.
    pub most_storing: Duration,
    /// Disk space that must stay free, bytes.
    pub min_free_bytes: u64,
    /// Bytes that the open uploads of one token may reserve on the disk ahead of those that have arrived.
    pub upload_reserve_bytes: u64,
    /// Largest number of open resumable uploads per token.
    pub max_open_uploads: u64,
    /// Timeout of a request body from which no data arrives.
    pub body_idle_timeout: Duration,
    /// Time after which a resumable upload without new data expires.
    pub upload_keep: Duration,
    /// How often waiting requests read their job, because another process may change it.
    pub poll_interval: Duration,
    /// Every request needs a token.
    pub auth_required: bool,
    /// Every request needs a token once one exists, made by this process or another.
    pub auth_once_there_are_tokens: bool,
    /// A token sees only the stacks, scans and uploads that it sent, unless its scope is `admin`.
    pub isolate_tokens: bool,
    /// Largest number of connections; more have to wait.
    pub max_connections: usize,
    /// Largest number of connections per address, and of requests in progress per token; `None`: a quarter of
    /// `max_connections`.
    pub connections_per_client: Option<usize>,
    /// Addresses of reverse proxies. Their connections are not limited per address, and their `X-Forwarded-For` is
    /// logged.
    pub trusted_proxies: Vec<AddressRange>,
    /// Time within which the head of a request must arrive, and idle time after which a connection is closed.
    pub header_timeout: Duration,
    /// The address that the server listens on; `None`: a loopback address.
    pub listen: Option<IpAddr>,
    /// Host names besides `localhost` under which browsers may use the service while it requires no token; without a
    /// port.
    pub hosts: Vec<String>,
    /// Origins whose pages may use the service from a browser.
    pub cors_origins: Vec<String>,
    /// How long a signed URL of a file in a bucket is valid; `None`: clients get files from the service alone.
    pub presigned: Option<Duration>,
    /// Number of jobs that this process runs at a time, for `/v1/info`.
    pub workers: usize,
}

impl Default for Policy {
    fn default() -> Self {
        Self {
            max_upload_bytes: 64 << 30,
            max_scan_bytes: 512 << 30,
            archive: ArchiveLimits::default(),
            queue_limit: 1000,
            most_storing: MOST_STORING,
            min_free_bytes: 512 << 20,
            upload_reserve_bytes: 16 << 30,
            max_open_uploads: 100,
            body_idle_timeout: Duration::from_secs(60),
            upload_keep: Duration::from_secs(24 * 60 * 60),
            poll_interval: Duration::from_secs(1),
            auth_required: false,
            auth_once_there_are_tokens: false,
            isolate_tokens: false,
            max_connections: 1024,
            connections_per_client: None,
            trusted_proxies: AddressRange::loopback(),
            header_timeout: Duration::from_secs(20),
            listen: None,
            hosts: Vec::new(),
            cors_origins: Vec::new(),
            presigned: None,
            workers: 0,
        }
    }
}

impl Policy {
    /// Largest number of connections per address, and of requests in progress per token.
    pub fn client_share(&self) -> usize {
        self.connections_per_client.unwrap_or(self.max_connections / 4).max(1)
    }
}

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

    /// Inspects a zip, or names, on another thread. An inspection needs as much memory as a hostile zip makes it need, so
    /// few run at once.
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
