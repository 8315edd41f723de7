//! Changes that one process made, announced to the others with `NOTIFY`.
//!
//! A notification is sent within the transaction of the change, so it arrives after the commit or not at all. It is
//! lost when the connection of the listener breaks; the listeners poll as well, so the change is seen later.

use std::{
    sync::{Arc, Mutex, PoisonError},
    time::Duration,
};

use sqlx::{PgConnection, PgPool, postgres::PgListener};
use tokio::task::AbortHandle;
use uuid::Uuid;

use crate::{
    store::{
        StoreResult,
        rows::transaction::{Listeners, Notice},
    },
    supervision::supervised,
};

/// Pause before a listener that lost its connection tries again.
const PAUSE: Duration = Duration::from_secs(1);

/// The last word of the notification of an arrival.
const ARRIVAL: &str = "queued";

/// Sends and receives notifications. Dropping it ends the receiver.
pub(super) struct Notifications {
    /// One channel per schema: two stores in one database do not hear each other.
    channel: String,
    /// Says which process sent a notification: a process hears its own too, and has announced them already.
    origin: Uuid,
    receiver: AbortHandle,
}

impl Notifications {
    /// Listens, and tells `listeners` of what other processes changed.
    pub(super) async fn start(pool: &PgPool, listeners: Listeners) -> StoreResult<Self> {
        let channel: String = sqlx::query_scalar("SELECT 'pinstack_' || md5(current_schema())").fetch_one(pool).await?;
        let origin = Uuid::now_v7();
        let first = Mutex::new(Some(listen(pool, &channel).await?));
        let (pool, of_others) = (pool.clone(), Arc::new(OfOthers { origin, listeners }));
        let listened = channel.clone();
        let receiving = supervised("notifications of the database", move || {
            let first = first.lock().unwrap_or_else(PoisonError::into_inner).take();
            receive(first, pool.clone(), listened.clone(), Arc::clone(&of_others))
        });
        Ok(Self { channel, origin, receiver: tokio::spawn(receiving).abort_handle() })
    }

    /// Sends the ids of what changed with the commit of the transaction.
    pub(super) async fn send(&self, transaction: &mut PgConnection, notice: Notice<'_>) -> StoreResult<()> {
        let (ids, ending) = match notice {
            Notice::None => return Ok(()),
            Notice::Changes(ids) => (ids, String::new()),
            Notice::Arrivals(ids) => (ids, format!(" {ARRIVAL}")),
        };
        let payloads: Vec<String> = ids.iter().map(|id| format!("{} {id}{ending}", self.origin)).collect();
        if payloads.is_empty() {
            return Ok(());
        }
        sqlx::query("SELECT pg_notify($1, payload) FROM unnest($2::text[]) AS payload")
            .bind(&self.channel)
            .bind(&payloads)
            .execute(transaction)
            .await?;
        Ok(())
    }

    pub(super) fn stop(&self) {
        self.receiver.abort();
    }
}

impl Drop for Notifications {
    fn drop(&mut self) {
        self.stop();
    }
}

async fn listen(pool: &PgPool, channel: &str) -> Result<PgListener, sqlx::Error> {
    let mut listener = PgListener::connect_with(pool).await?;
    listener.listen(channel).await?;
    Ok(listener)
}

/// Receives until it is aborted. A broken connection is replaced.
async fn receive(mut listener: Option<PgListener>, pool: PgPool, channel: String, of_others: Arc<OfOthers>) {
    loop {
        if let Some(listener) = &mut listener {
            let error = loop {
                match listener.recv().await {
                    Ok(notification) => of_others.hear(notification.payload()),
                    Err(error) => break error,
                }
            };
            tracing::warn!(?error, "no notifications of the database arrive; changes are found by polling meanwhile");
            tokio::time::sleep(PAUSE).await;
        }
        match listen(&pool, &channel).await {
            Ok(new) => listener = Some(new),
            Err(error) => {
                tracing::warn!(?error, "cannot listen for notifications of the database");
                listener = None;
                tokio::time::sleep(PAUSE).await;
            }
        }
    }
}

/// The notifications of other processes.
struct OfOthers {
    /// This process.
    origin: Uuid,
    listeners: Listeners,
}

impl OfOthers {
    /// Forwards a notification, if another process sent it.
    fn hear(&self, payload: &str) {
        let mut words = payload.split(' ');
        let mut id = || Uuid::try_parse(words.next()?).ok();
        let (Some(sender), Some(changed)) = (id(), id()) else { return };
        if sender == self.origin {
            return;
        }
        let changed = [changed];
        let is_arrival = words.next() == Some(ARRIVAL);
        self.listeners.tell(if is_arrival { Notice::Arrivals(&changed) } else { Notice::Changes(&changed) });
    }
}
