//! Slots of connections, shares of them, and a reserve.
//!
//! A connection has one of `max_connections` slots, and one address only a share of them. What comes when no slot is left is
//! taken all the same, up to [`RESERVE`]: such a connection may ask for `/healthz` and `/readyz` at once, and anything else
//! once it gets a slot. When the reserve is full, the connection that has waited longest gives way to the newest. So a health
//! check is answered whatever the others do, and a client over the limit waits, but not for ever.

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

use super::AddressRange;
use crate::http::state::Policy;

/// Connections without a slot at a time.
pub const RESERVE: usize = 32;
/// How long one that gives way may take to send its refusal.
const FAREWELL: Duration = Duration::from_secs(1);
/// Addresses that are remembered without a connection of theirs, at most.
const ADDRESSES: usize = 1024;

/// The slots of a server.
pub struct Slots {
    total: Arc<Semaphore>,
    share: usize,
    trusted: Vec<AddressRange>,
    /// How long a request waits for a slot.
    patience: Duration,
    by_address: Mutex<HashMap<IpAddr, Arc<Semaphore>>>,
    /// Without a slot, the oldest first.
    reserve: Mutex<VecDeque<Weak<Seat>>>,
    shutdown: CancellationToken,
}

/// A slot, and its part of the share of an address.
struct Slot {
    _total: OwnedSemaphorePermit,
    _own: Option<OwnedSemaphorePermit>,
}

impl Slots {
    /// All slots are free. `shutdown` sends those away that wait for one.
    pub fn new(policy: &Policy, shutdown: CancellationToken) -> Arc<Self> {
        Arc::new(Self {
            total: Arc::new(Semaphore::new(policy.max_connections)),
            share: policy.client_share(),
            trusted: policy.trusted_proxies.clone(),
            patience: policy.header_timeout,
            by_address: Mutex::default(),
            reserve: Mutex::default(),
            shutdown,
        })
    }

    /// A seat for a connection that was taken: with a slot when there is one, else in the reserve.
    pub fn seat(self: &Arc<Self>, peer: IpAddr) -> Arc<Seat> {
        let peer = peer.to_canonical();
        let slot = self.try_take(peer);
        let is_in_reserve = slot.is_none();
        let seat = Arc::new(Seat {
            peer,
            slots: Arc::clone(self),
            slot: Mutex::new(slot),
            has_asked: AtomicBool::new(false),
            gives_way: self.shutdown.child_token(),
        });
        if is_in_reserve {
            self.make_way_for(&seat);
        }
        seat
    }

    fn make_way_for(&self, seat: &Arc<Seat>) {
        let mut reserve = self.reserve.lock().unwrap_or_else(PoisonError::into_inner);
        reserve.retain(|other| other.upgrade().is_some_and(|other| !other.has_slot()));
        reserve.push_back(Arc::downgrade(seat));
        while reserve.len() > RESERVE {
            if let Some(oldest) = reserve.pop_front().and_then(|oldest| oldest.upgrade()) {
                oldest.gives_way.cancel();
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

    /// The share of an address; proxies have none, as their connections are those of many.
    fn share_of(&self, peer: IpAddr) -> Option<Arc<Semaphore>> {
        if self.is_trusted(peer) {
            return None;
        }
        let client = match peer {
            // one client has a whole /64 of addresses
            IpAddr::V6(address) => IpAddr::V6((address.to_bits() >> 64 << 64).into()),
            IpAddr::V4(_) => peer,
        };
        let mut shares = self.by_address.lock().unwrap_or_else(PoisonError::into_inner);
        if shares.len() >= ADDRESSES {
            shares.retain(|_, share| Arc::strong_count(share) > 1);
        }
        Some(Arc::clone(shares.entry(client).or_insert_with(|| Arc::new(Semaphore::new(self.share)))))
    }
}

/// Where a connection sits, with a slot or without; its slot is free again once this is dropped.
pub struct Seat {
    peer: IpAddr,
    slots: Arc<Slots>,
    slot: Mutex<Option<Slot>>,
    has_asked: AtomicBool,
    gives_way: CancellationToken,
}

impl Seat {
    fn has_slot(&self) -> bool {
        self.slot.lock().unwrap_or_else(PoisonError::into_inner).is_some()
    }

    /// A request came on this connection.
    pub fn asked(&self) {
        self.has_asked.store(true, Ordering::Relaxed);
    }

    /// True once the connection has a slot; false when none became free in time.
    pub async fn got_slot(&self) -> bool {
        if self.has_slot() {
            return true;
        }
        let taken = tokio::select! {
            taken = timeout(self.slots.patience, self.slots.take(self.peer)) => taken,
            () = self.gives_way.cancelled() => return false,
        };
        let Ok(Some(slot)) = taken else { return false };
        *self.slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(slot);
        true
    }

    /// Returns when a connection without a slot has to go. One that asked for something may say why first.
    pub async fn gave_way(&self) {
        self.gives_way.cancelled().await;
        if self.has_slot() {
            return std::future::pending().await;
        }
        if self.has_asked.load(Ordering::Relaxed) {
            sleep(FAREWELL).await;
        }
    }

    /// Who sent a request: the other end of the connection, or who a trusted proxy says it is.
    pub fn client(&self, headers: &HeaderMap) -> IpAddr {
        let forwarded = headers.get_all("x-forwarded-for").iter().next_back();
        let nearest = forwarded.and_then(|list| list.to_str().ok()?.rsplit(',').next()?.trim().parse().ok());
        nearest.filter(|_| self.slots.is_trusted(self.peer)).unwrap_or(self.peer)
    }
}
