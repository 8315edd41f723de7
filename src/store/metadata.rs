//! The metadata store: everything but the bytes of uploads and results.

use std::path::Path;

use async_trait::async_trait;
use tokio::sync::broadcast;
use uuid::Uuid;

use super::{Expiry, JobQueue, Leases, NoteStore, ProfileStore, ScanStore, StoreResult, Tokens, Totals, UploadRecords};

/// All metadata of the service behind one handle. Each part is a trait of its own with a conformance suite that runs on
/// every engine.
#[async_trait]
pub trait MetadataStore:
    ProfileStore + ScanStore + NoteStore + JobQueue + Leases + Expiry + UploadRecords + Tokens
{
    /// Sends the id of a job or an upload after each visible change that this process made. Listeners poll as well,
    /// because other processes change rows too.
    fn changes(&self) -> broadcast::Receiver<Uuid>;
    /// Sends something after jobs joined the queue, as far as this process knows. Workers poll as well.
    fn arrivals(&self) -> broadcast::Receiver<()>;
    /// The identity of the service: that of its database, kept by a backup and its restore.
    async fn service_id(&self) -> StoreResult<Uuid>;
    /// Sums over all rows, for metrics.
    async fn totals(&self) -> StoreResult<Totals>;
    /// True when the database answers.
    async fn healthy(&self) -> bool;
    /// Violations of integrity that the database reports about itself, one sentence each.
    async fn integrity_errors(&self) -> StoreResult<Vec<String>>;
    /// Writes all rows, as of one moment, to a new database file that a data folder can hold. Writers of other
    /// processes do not wait.
    ///
    /// # Errors
    /// When the file exists or cannot be written.
    async fn snapshot_to(&self, file: &Path) -> StoreResult<()>;
    /// Waits for running statements and closes the connections.
    async fn close(&self);
}
