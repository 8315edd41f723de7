//! Changes that one process made, announced to the others with `NOTIFY`.
//!
//! A notification is sent within the transaction of the change, so it arrives after the commit or not at all. It is
//! lost when the connection of the listener breaks; the listeners poll as well, so the change is seen later.

use std::time::Duration;

use sqlx::{PgConnection, PgPool, postgres::PgListener};
use tokio::{sync::broadcast, task::AbortHandle};
use uuid::Uuid;

use crate::store::StoreResult;

/// Pause before a listener that lost its connection tries again.
const PAUSE: Duration = Duration::from_secs(1);

/// What a notification tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// A job or an upload changed.
    Change,
    /// A job joined the queue.
    Arrival,
}

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
    /// Listens, and forwards the changes of other processes to `changes`, and what joined the queue to `arrivals`.
    pub(super) async fn start(
        pool: &PgPool,
        changes: broadcast::Sender<Uuid>,
        arrivals: broadcast::Sender<()>,
    ) -> StoreResult<Self> {
        let channel: String = sqlx::query_scalar("SELECT 'pinstack_' || md5(current_schema())").fetch_one(pool).await?;
        let origin = Uuid::now_v7();
        let listener = listen(pool, &channel).await?;
        let listeners = Listeners { origin, changes, arrivals };
        let receiver = tokio::spawn(receive(listener, pool.clone(), channel.clone(), listeners)).abort_handle();
        Ok(Self { channel, origin, receiver })
    }

    /// Sends the ids of what changed with the commit of the transaction.
    pub(super) async fn send(&self, transaction: &mut PgConnection, ids: &[Uuid], kind: Kind) -> StoreResult<()> {
        let ending = match kind {
            Kind::Change => String::new(),
            Kind::Arrival => format!(" {ARRIVAL}"),
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
async fn receive(mut listener: PgListener, pool: PgPool, channel: String, listeners: Listeners) {
    loop {
        let error = match listener.recv().await {
            Ok(notification) => {
                listeners.hear(notification.payload());
                continue;
            }
            Err(error) => error,
        };
        tracing::warn!(?error, "no notifications of the database arrive; changes are found by polling meanwhile");
        tokio::time::sleep(PAUSE).await;
        match listen(&pool, &channel).await {
            Ok(new) => listener = new,
            Err(error) => tracing::warn!(?error, "cannot listen for notifications of the database"),
        }
    }
}

/// Those in this process who want to hear of other processes.
struct Listeners {
    /// This process.
    origin: Uuid,
    changes: broadcast::Sender<Uuid>,
    arrivals: broadcast::Sender<()>,
}

impl Listeners {
    /// Forwards a notification of another process.
    fn hear(&self, payload: &str) {
        let mut words = payload.split(' ');
        let mut id = || Uuid::try_parse(words.next()?).ok();
        let (Some(sender), Some(changed)) = (id(), id()) else { return };
        if sender == self.origin {
            return;
        }
        let _ = self.changes.send(changed);
        if words.next() == Some(ARRIVAL) {
            let _ = self.arrivals.send(());
        }
    }
}
