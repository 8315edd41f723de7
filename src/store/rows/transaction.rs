//! What a transaction locks, its commit, and who is told of it.

use sqlx::{Database, Transaction};
use tokio::sync::broadcast;
use uuid::Uuid;

use crate::store::{StoreError, StoreResult, failpoint::step};

/// Changes that a slow listener may lag behind before it must read the rows again.
const CHANGES: usize = 1024;
/// The same for arrivals, of which one is as good as many.
const ARRIVALS: usize = 1;

/// Locks on decisions over many rows, held until the transaction ends. Against deadlocks, `Accept` and `Expiry` are
/// taken first and never together; only `Profiles` may be taken after another lock or after the lock of a row.
#[derive(Debug, Clone, Copy)]
pub(in crate::store) enum Lock {
    /// Jobs and uploads are accepted, scans written and deleted one at a time: the limits are sums over all rows, and
    /// the numbers that order the queue are given in the order of the commits.
    Accept = 1,
    /// Revisions are numbered.
    Profiles = 2,
    /// Rows expire: many are deleted at once.
    Expiry = 3,
}

/// Commits, with a failpoint before and one after. A fault after the commit leaves the caller uncertain whether the
/// rows were stored, as a real one may.
pub(in crate::store) async fn commit(tx: Transaction<'_, impl Database>, name: &'static str) -> StoreResult<()> {
    let broken = |error| StoreError::of_io(error, format!("cannot commit {name}"));
    step(name).map_err(broken)?;
    tx.commit().await?;
    step(name).map_err(broken)
}

/// What listeners are told of a commit.
#[derive(Debug, Clone, Copy)]
pub(in crate::store) enum Notice<'a> {
    /// Nothing.
    None,
    /// These jobs or uploads changed.
    Changes(&'a [Uuid]),
    /// These changed, and jobs joined the queue: workers are told too.
    Arrivals(&'a [Uuid]),
}

/// The listeners of this process.
#[derive(Debug, Clone)]
pub(in crate::store) struct Listeners {
    /// Those who want to know what changed.
    pub(in crate::store) changes: broadcast::Sender<Uuid>,
    /// Workers.
    pub(in crate::store) arrivals: broadcast::Sender<()>,
}

impl Default for Listeners {
    fn default() -> Self {
        Self { changes: broadcast::channel(CHANGES).0, arrivals: broadcast::channel(ARRIVALS).0 }
    }
}

impl Listeners {
    /// Tells them, if there are any.
    pub(in crate::store) fn tell(&self, notice: Notice<'_>) {
        let (Notice::Changes(ids) | Notice::Arrivals(ids)) = notice else { return };
        for id in ids {
            let _ = self.changes.send(*id);
        }
        if matches!(notice, Notice::Arrivals(_)) {
            let _ = self.arrivals.send(());
        }
    }
}
