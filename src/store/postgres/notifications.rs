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

/// Sends and receives notifications. Dropping it ends the receiver.
pub(super) struct Notifications {
    /// One channel per schema: two stores in one database do not hear each other.
    channel: String,
    /// Says which process sent a notification: a process hears its own too, and has announced them already.
    origin: Uuid,
    receiver: AbortHandle,
}

impl Notifications {
    /// Listens, and forwards the changes of other processes to `changes`.
    pub(super) async fn start(pool: &PgPool, changes: broadcast::Sender<Uuid>) -> StoreResult<Self> {
        let channel: String = sqlx::query_scalar("SELECT 'pinstack_' || md5(current_schema())").fetch_one(pool).await?;
        let origin = Uuid::now_v7();
        let listener = listen(pool, &channel).await?;
        let receiver = tokio::spawn(receive(listener, pool.clone(), channel.clone(), origin, changes)).abort_handle();
        Ok(Self { channel, origin, receiver })
    }

    /// Sends the ids of what changed with the commit of the transaction.
    pub(super) async fn send(&self, transaction: &mut PgConnection, ids: &[Uuid]) -> StoreResult<()> {
        let payloads: Vec<String> = ids.iter().map(|id| format!("{} {id}", self.origin)).collect();
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
async fn receive(
    mut listener: PgListener,
    pool: PgPool,
    channel: String,
    origin: Uuid,
    changes: broadcast::Sender<Uuid>,
) {
    loop {
        let error = match listener.recv().await {
            Ok(notification) => {
                if let Some(id) = of_another(notification.payload(), origin) {
                    let _ = changes.send(id);
                }
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

/// The id in a notification of another process.
fn of_another(payload: &str, origin: Uuid) -> Option<Uuid> {
    let (sender, id) = payload.split_once(' ')?;
    if Uuid::try_parse(sender).ok()? == origin {
        return None;
    }
    Uuid::try_parse(id).ok()
}
