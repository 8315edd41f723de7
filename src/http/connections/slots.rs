//! Slots of connections, shares per address, and a reserve.
//!
//! There are `max_connections` slots, and each address gets only a share of them. A connection without a slot is still
//! accepted, up to [`RESERVE`]: it may request `/healthz` and `/readyz` at once, and anything else when it gets a slot.
//! When the reserve is full, the connection that has waited longest is closed in favour of the newest. So health checks
//! are always answered, and a client over its limit waits for a bounded time.

use std::{
    collections::{HashMap, VecDeque},
    net::IpAddr,
    sync::{
        Arc, Mutex, PoisonError, Weak,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use axum::http::HeaderMap;
use tokio::{
    sync::{OwnedSemaphorePermit, Semaphore},
    time::{sleep, timeout},
};
use tokio_util::sync::CancellationToken;

use crate::settings::{AddressRange, Policy};

/// Largest number of connections without a slot.
pub const RESERVE: usize = 32;
/// How long an evicted connection may take to send its last answer.
const LAST_ANSWER: Duration = Duration::from_secs(1);
/// From this number of addresses on, the shares of addresses without connections are removed.
const MAX_IDLE_SHARES: usize = 1024;

/// The slots of a server.
pub struct Slots {
    total: Arc<Semaphore>,
    share: usize,
    trusted: Vec<AddressRange>,
    /// How long a request waits for a slot.
    slot_timeout: Duration,
    by_address: Mutex<HashMap<IpAddr, Arc<Semaphore>>>,
    /// Connections without a slot, oldest first.
    reserve: Mutex<VecDeque<Weak<Seat>>>,
    shutdown: CancellationToken,
}

/// A slot, and its part of the share of its address.
struct Slot {
    _total: OwnedSemaphorePermit,
    _own: Option<OwnedSemaphorePermit>,
}

impl Slots {
    /// Free slots. `shutdown` ends the waiting for a slot.
    pub fn new(policy: &Policy, shutdown: CancellationToken) -> Arc<Self> {
        Arc::new(Self {
            total: Arc::new(Semaphore::new(policy.max_connections)),
            share: policy.client_share(),
            trusted: policy.trusted_proxies.clone(),
            slot_timeout: policy.header_timeout,
            by_address: Mutex::default(),
            reserve: Mutex::default(),
            shutdown,
        })
    }

    /// The seat of a new connection: with a slot if one is free, else in the reserve.
    pub fn seat(self: &Arc<Self>, peer: IpAddr) -> Arc<Seat> {
        let peer = peer.to_canonical();
        let slot = self.try_take(peer);
        let is_in_reserve = slot.is_none();
        let seat = Arc::new(Seat {
            peer,
            slots: Arc::clone(self),
            slot: Mutex::new(slot),
            has_request: AtomicBool::new(false),
            evicted: self.shutdown.child_token(),
        });
        if is_in_reserve {
            self.reserve_seat(&seat);
        }
        seat
    }

    fn reserve_seat(&self, seat: &Arc<Seat>) {
        let mut reserve = self.reserve.lock().unwrap_or_else(PoisonError::into_inner);
        reserve.retain(|other| other.upgrade().is_some_and(|other| !other.has_slot()));
        reserve.push_back(Arc::downgrade(seat));
        while reserve.len() > RESERVE {
            if let Some(oldest) = reserve.pop_front().and_then(|oldest| oldest.upgrade()) {
                oldest.evicted.cancel();
            }
        }
    }

    fn try_take(&self, peer: IpAddr) -> Option<Slot> {
        let own = match self.share_of(peer) {
            Some(share) => Some(share.try_acquire_owned().ok()?),
            None => None,
        };
        Some(Slot { _total: Arc::clone(&self.total).try_acquire_owned().ok()?, _own: own })
    }

    async fn take(&self, peer: IpAddr) -> Option<Slot> {
        let own = match self.share_of(peer) {
            Some(share) => Some(share.acquire_owned().await.ok()?),
            None => None,
        };
        Some(Slot { _total: Arc::clone(&self.total).acquire_owned().await.ok()?, _own: own })
    }

    fn is_trusted(&self, peer: IpAddr) -> bool {
        self.trusted.iter().any(|range| range.contains(peer))
    }

    /// The share of an address. Trusted proxies have none, because their connections carry many clients.
    fn share_of(&self, peer: IpAddr) -> Option<Arc<Semaphore>> {
        if self.is_trusted(peer) {
            return None;
        }
        let client = match peer {
            // one IPv6 client usually has a whole /64
            IpAddr::V6(address) => IpAddr::V6((address.to_bits() >> 64 << 64).into()),
            IpAddr::V4(_) => peer,
        };
        let mut shares = self.by_address.lock().unwrap_or_else(PoisonError::into_inner);
        if shares.len() >= MAX_IDLE_SHARES {
            shares.retain(|_, share| Arc::strong_count(share) > 1);
        }
        Some(Arc::clone(shares.entry(client).or_insert_with(|| Arc::new(Semaphore::new(self.share)))))
    }
}

/// The place of a connection among the slots or in the reserve. Dropping it frees the slot.
pub struct Seat {
    peer: IpAddr,
    slots: Arc<Slots>,
    slot: Mutex<Option<Slot>>,
    has_request: AtomicBool,
    evicted: CancellationToken,
}

impl Seat {
    fn has_slot(&self) -> bool {
        self.slot.lock().unwrap_or_else(PoisonError::into_inner).is_some()
    }

    /// Records that a request arrived on this connection.
    pub fn note_request(&self) {
        self.has_request.store(true, Ordering::Relaxed);
    }

    /// Waits for a slot. False when none became free in time or the connection was evicted.
    pub async fn got_slot(&self) -> bool {
        if self.has_slot() {
            return true;
        }
        let taken = tokio::select! {
            taken = timeout(self.slots.slot_timeout, self.slots.take(self.peer)) => taken,
            () = self.evicted.cancelled() => return false,
        };
        let Ok(Some(slot)) = taken else { return false };
        *self.slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(slot);
        true
    }

    /// Returns when a connection without a slot must be closed. One with a request in progress may send its answer
    /// first.
    pub async fn was_evicted(&self) {
        self.evicted.cancelled().await;
        if self.has_slot() {
            return std::future::pending().await;
        }
        if self.has_request.load(Ordering::Relaxed) {
            sleep(LAST_ANSWER).await;
        }
    }

    /// Whether a trusted proxy opened the connection.
    pub fn is_of_proxy(&self) -> bool {
        self.slots.is_trusted(self.peer)
    }

    /// The client of a request: the peer of the connection, or the address that a trusted proxy reports.
    pub fn client(&self, headers: &HeaderMap) -> IpAddr {
        let forwarded = headers.get_all("x-forwarded-for").iter().next_back();
        let nearest = forwarded.and_then(|list| list.to_str().ok()?.rsplit(',').next()?.trim().parse().ok());
        nearest.filter(|_| self.is_of_proxy()).unwrap_or(self.peer)
    }

    /// The sub-path that a trusted proxy removes from the URLs, without a slash at its end. It is a path and nothing
    /// else, whatever the header says: its segments have letters, digits, `-`, `.`, `_` and `~` only.
    pub fn prefix(&self, headers: &HeaderMap) -> Option<Arc<str>> {
        let forwarded = headers.get_all("x-forwarded-prefix").iter().next_back()?.to_str().ok()?;
        let prefix = forwarded.trim().trim_end_matches('/');
        let is_segment = |segment: &str| {
            let is_safe = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~".contains(&byte);
            !["", ".", ".."].contains(&segment) && segment.bytes().all(is_safe)
        };
        let is_path = prefix.strip_prefix('/').is_some_and(|path| path.split('/').all(is_segment));
        (is_path && self.is_of_proxy()).then(|| prefix.into())
    }

    /// Whether a trusted proxy reports that the client uses TLS.
    pub fn is_behind_tls(&self, headers: &HeaderMap) -> bool {
        let scheme = headers.get("x-forwarded-proto").and_then(|scheme| scheme.to_str().ok());
        self.is_of_proxy() && scheme.is_some_and(|scheme| scheme.trim().eq_ignore_ascii_case("https"))
    }
}
