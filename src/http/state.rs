//! What every handler can reach.

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

use super::{
    artifacts::conversions::Conversions,
    connections::{AddressRange, Tally},
    ingest::{quota::Claims, reservation::Shares},
    recent::Recent,
    system::readyz,
};
use crate::{
    disk_budget::DiskBudget,
    store::{Store, StoreResult},
};
use pinstack_science::archive::ArchiveLimits;

/// Zips that are inspected at a time. Each may need the memory of one member of the zip in the worst case (a TIFF whose
/// parts are out of order).
const INSPECTIONS: usize = 2;

/// How long what `/readyz` found counts.
const READINESS_AGE: Duration = Duration::from_secs(1);

/// How much the service takes on.
#[derive(Debug, Clone)]
pub struct Policy {
    /// Largest upload, bytes.
    pub max_upload_bytes: u64,
    /// How much a zip may hold and cost.
    pub archive: ArchiveLimits,
    /// Most jobs that may wait.
    pub queue_limit: u64,
    /// Room that must stay free on the disk, bytes.
    pub min_free_bytes: u64,
    /// Most bytes that the uploads in progress of one token reserve ahead of those that have arrived.
    pub upload_reserve_bytes: u64,
    /// Most resumable uploads that one token may have open.
    pub max_open_uploads: u64,
    /// An upload that sends nothing for this long is given up.
    pub body_idle_timeout: Duration,
    /// An upload that arrives in pieces waits so long for its next one.
    pub upload_keep: Duration,
    /// How often waiting requests look at the rows by themselves: other processes may change them too.
    pub poll_interval: Duration,
    /// A token is asked for.
    pub auth_required: bool,
    /// A token is asked for as soon as one was made, in this process or another.
    pub auth_once_there_are_tokens: bool,
    /// A token sees only the stacks and uploads that it sent, unless it is an admin's.
    pub isolate_tokens: bool,
    /// Most connections at a time; more wait.
    pub max_connections: usize,
    /// Most connections of one address and most requests in progress of one token; `None`: a quarter of `max_connections`.
    pub connections_per_client: Option<usize>,
    /// Where reverse proxies are. Their connections have no share of their own, and who they say a client is goes to the log.
    pub trusted_proxies: Vec<AddressRange>,
    /// A client that takes longer for the head of a request, or asks nothing for so long, is hung up on.
    pub header_timeout: Duration,
    /// The address that is listened on; `None`: a loopback address.
    pub listen: Option<IpAddr>,
    /// Names beside `localhost` under which browsers may reach the service while it asks for no token; without a port.
    pub hosts: Vec<String>,
    /// Origins whose pages may use the service from a browser.
    pub cors_origins: Vec<String>,
    /// Worker threads of this process, for `/v1/info`.
    pub workers: usize,
}

impl Default for Policy {
    fn default() -> Self {
        Self {
            max_upload_bytes: 64 << 30,
            archive: ArchiveLimits::default(),
            queue_limit: 1000,
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
            workers: 0,
        }
    }
}

impl Policy {
    /// Most connections of one address, and most requests in progress of one token.
    pub fn client_share(&self) -> usize {
        self.connections_per_client.unwrap_or(self.max_connections / 4).max(1)
    }
}

/// What every handler can reach. Cheap to clone.
#[derive(Clone)]
pub struct App {
    /// Metadata, blobs, upload parts and workspace.
    pub store: Store,
    /// How much the service takes on.
    pub policy: Arc<Policy>,
    /// Fires when the server goes down: event streams and waiting requests end.
    pub shutdown: CancellationToken,
    /// Room on the disk: what uploads, jobs and conversions of this process reserve.
    pub disk: Arc<DiskBudget>,
    /// What of it the uploads in progress of each token hold.
    pub shares: Shares,
    /// What requests have claimed of the quotas of their tokens.
    pub claims: Claims,
    /// A token was seen among the rows: they never go.
    has_tokens: Arc<AtomicBool>,
    /// Stored pictures in other file formats.
    pub conversions: Arc<Conversions>,
    /// Requests in progress by token.
    pub tally: Tally,
    /// What `/readyz` found last.
    pub readiness: Arc<Recent<readyz::Look>>,
    /// Permits to inspect a zip. An inspection needs as much memory as a hostile zip makes it need, so few run at once.
    pub inspection_permits: Arc<Semaphore>,
}

impl App {
    /// An application over a store.
    pub fn new(store: Store, policy: Policy) -> Self {
        let disk = DiskBudget::new(&store, policy.min_free_bytes);
        Self {
            store,
            disk,
            shares: Shares::default(),
            claims: Claims::default(),
            policy: Arc::new(policy),
            shutdown: CancellationToken::new(),
            has_tokens: Arc::default(),
            conversions: Arc::default(),
            tally: Tally::default(),
            readiness: Arc::new(Recent::new(READINESS_AGE)),
            inspection_permits: Arc::new(Semaphore::new(INSPECTIONS)),
        }
    }

    /// Whether this request must bring a token. Where tokens are asked for once there are any, the rows are looked at until
    /// there are: the server need not be restarted after the first token is made.
    ///
    /// # Errors
    /// When the rows do not answer: then nobody knows, and nobody is let in.
    pub async fn asks_for_tokens(&self) -> StoreResult<bool> {
        if self.policy.auth_required || self.has_tokens.load(Ordering::Relaxed) {
            return Ok(true);
        }
        let asks = self.policy.auth_once_there_are_tokens && self.store.metadata.any_token().await?;
        if asks && !self.has_tokens.swap(true, Ordering::Relaxed) {
            tracing::warn!("a token was made: from here on every request must bring one");
        }
        Ok(asks)
    }
}
