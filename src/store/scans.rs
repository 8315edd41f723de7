//! Scans: what is stored of them beside their stacks. The stacks of a scan name it in their request.

use async_trait::async_trait;
use uuid::Uuid;

use super::{Page, PageRequest, Precondition, StoreResult};
use crate::contract::{Name, Scan, ScanInput};

/// Which scans a list contains. A filter that is `None` accepts every scan.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ScanFilter {
    /// Rig of its stacks.
    pub rig: Option<Name>,
    /// Lens of its stacks.
    pub lens: Option<Name>,
    /// Scans that this token created, and scans created without a token.
    pub owner: Option<Uuid>,
}

/// A scan whose stacks have changed and all ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SettledScan {
    /// Its name.
    pub name: Name,
    /// The token that created it.
    pub owner: Option<Uuid>,
    /// What tells this state of it from others: its version, and of its stacks with results how many they are, the sum
    /// of their numbers, and the latest end.
    pub state: String,
}

/// Result of writing a scan.
#[derive(Debug, Clone, PartialEq)]
pub enum PutScan {
    /// There was no such scan.
    Created(Scan),
    /// There was one.
    Updated(Scan),
    /// The precondition failed. Contains the current version, if there is a scan.
    PreconditionFailed(Option<u32>),
    /// Rig or lens would change, and the scan has stacks.
    HasStacks(u64),
}

/// Result of deleting a scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeleteScan {
    /// It is deleted.
    Deleted,
    /// There is no such scan.
    NotFound,
    /// The precondition failed. Contains the current version, if there is a scan.
    PreconditionFailed(Option<u32>),
    /// It has stacks.
    HasStacks(u64),
}

/// Stores scans.
#[async_trait]
pub trait ScanStore: Send + Sync + 'static {
    /// Writes a scan. `owner` is kept from the first write.
    async fn put_scan(
        &self,
        name: &Name,
        input: &ScanInput,
        owner: Option<Uuid>,
        condition: Precondition,
    ) -> StoreResult<PutScan>;
    /// One scan.
    async fn scan(&self, name: &Name) -> StoreResult<Option<Scan>>;
    /// The token that created a scan; `None` when there is no such scan, or no token was required.
    async fn scan_owner(&self, name: &Name) -> StoreResult<Option<Uuid>>;
    /// Scans, the most recently created first.
    async fn scans(&self, filter: &ScanFilter, page: &PageRequest) -> StoreResult<Page<Scan>>;
    /// The names of at most `limit` scans that `owner` may see; `None`: of all.
    async fn scan_names(&self, owner: Option<Uuid>, limit: u32) -> StoreResult<Vec<Name>>;
    /// Scans to be reconstructed by themselves that were written, or whose stacks with results have changed, since they
    /// were examined, and none of whose stacks waits or runs; at most 100.
    async fn settled_scans(&self) -> StoreResult<Vec<SettledScan>>;
    /// Remembers that this state of a scan was examined.
    async fn scan_examined(&self, scan: &SettledScan) -> StoreResult<()>;
    /// Deletes a scan that has no stacks.
    async fn delete_scan(&self, name: &Name, condition: Precondition) -> StoreResult<DeleteScan>;
}
