//! State that survives: rows ([`Rows`]) and blobs.
//!
//! A job is a row. A claim takes a queued job, or one whose lease ran out, and increments `lease_token`;
//! each later write of the worker says `WHERE id = ? AND lease_token = ?`, so a worker that comes back from
//! the dead can write bytes but never publish them.

pub mod backup;
pub mod blobs;
pub mod clock;
pub mod digest;
pub mod folder;
pub mod json;
pub mod sqlite;
pub mod step;
pub mod sweep;
pub mod tokens;
pub mod totals;
pub mod uploads;
pub mod verify;

#[cfg(test)]
pub(crate) mod conformance;

pub use clock::{Clock, ManualClock, SystemClock};
pub use tokens::TokenRows;
pub use totals::Totals;
pub use uploads::UploadRows;

use async_trait::async_trait;
use jiff::Timestamp;
use uuid::Uuid;

use crate::contract::{
    Fault, JobKind, JobState, Name, ProfileSummary, Progress,
    outcome::JobOutcome,
    profile::{Profile, ProfileOrigin, ProfileSource},
    request::JobRequest,
};
use pinstack_science::types::{
    Warning,
    profile::{HomographyModel, ProfileInput, ProfileSlice},
};
use sweep::Retention;

/// Why the store could not do it. Never shown to a client as it is.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The disk is full.
    #[error("no room left: {0}")]
    NoRoom(String),
    /// A cursor that this store never handed out: the client's mistake.
    #[error("the cursor is not one that this service handed out")]
    BadCursor,
    /// Anything else: said in the log.
    #[error(transparent)]
    Other(#[from] anyhow::Error),
}

impl StoreError {
    /// What an error of the file system means here; `what` was to be done.
    pub(crate) fn of_io(error: std::io::Error, what: String) -> Self {
        match error.kind() {
            std::io::ErrorKind::StorageFull | std::io::ErrorKind::QuotaExceeded => Self::NoRoom(what),
            _ => Self::Other(anyhow::Error::new(error).context(what)),
        }
    }
}

/// Shorthand.
pub type StoreResult<T> = Result<T, StoreError>;

/// A profile about to become a revision.
#[derive(Debug, Clone, PartialEq)]
pub struct ProfileDraft {
    /// The numbers.
    pub input: ProfileInput,
    /// Uploaded or measured.
    pub source: ProfileSource,
    /// The calibration that measured it.
    pub calibration_id: Option<Uuid>,
    /// Family of maps.
    pub model: HomographyModel,
    /// One entry per slice.
    pub slices: Vec<ProfileSlice>,
    /// The profile that it is a copy of.
    pub origin: Option<ProfileOrigin>,
    /// What was done to the numbers on their way in.
    pub warnings: Vec<Warning>,
}

/// What `If-Match` / `If-None-Match` demand of the current revision before a write.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Precondition {
    /// Nothing.
    #[default]
    Any,
    /// There is no current revision (`If-None-Match: *`).
    Absent,
    /// There is one (`If-Match: *`).
    Present,
    /// It is this one.
    Revision(u32),
}

impl Precondition {
    /// Whether it holds when `current` is the current revision.
    pub fn holds(self, current: Option<u32>) -> bool {
        match self {
            Self::Any => true,
            Self::Absent => current.is_none(),
            Self::Present => current.is_some(),
            Self::Revision(wanted) => current == Some(wanted),
        }
    }
}

/// How a conditional write of a profile ended.
#[derive(Debug, Clone, PartialEq)]
pub enum PutProfile {
    /// The first current revision of this key (after a delete too).
    Created(Profile),
    /// A new revision of a key that had one.
    Updated(Profile),
    /// The precondition did not hold; the current revision, if any.
    PreconditionFailed(Option<u32>),
}

/// A page of a list, newest first.
#[derive(Debug, Clone, PartialEq)]
pub struct Page<T> {
    /// At most as many as asked for.
    pub items: Vec<T>,
    /// Pass it to get the next page; `None` at the end.
    pub next_cursor: Option<String>,
    /// Rows of the page that cannot be read, and are not among the items.
    pub skipped: Vec<Skipped>,
}

/// A row that cannot be read. The log says why; `pinstack verify` finds it too.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize, utoipa::ToSchema)]
pub struct Skipped {
    /// Id of the job, or `{rig}/{lens}?revision={N}` of a profile.
    pub id: String,
    /// What to do.
    pub detail: String,
}

impl Skipped {
    /// Leaves a row out, and says so in the log.
    pub(crate) fn because(id: String, error: &StoreError) -> Self {
        tracing::error!(row = id, ?error, "a row cannot be read; lists leave it out");
        let detail = "this row cannot be read, so it is left out; the log of the service and 'pinstack verify' say why";
        Self { id, detail: detail.to_owned() }
    }
}

/// Which page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PageRequest {
    /// Most items, 1 to 500.
    pub limit: u32,
    /// From the page before.
    pub cursor: Option<String>,
}

/// Which jobs to list.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct JobFilter {
    /// Stacks or calibrations.
    pub kind: Option<JobKind>,
    /// In this state.
    pub state: Option<JobState>,
    /// Of this rig.
    pub rig: Option<Name>,
    /// Of this lens.
    pub lens: Option<Name>,
    /// Of this scan.
    pub scan: Option<Name>,
    /// Sent by this token.
    pub owner: Option<Uuid>,
}

/// A job as its row has it.
#[derive(Debug, Clone, PartialEq)]
pub struct Job {
    /// UUIDv7.
    pub id: Uuid,
    /// Rig of the profile.
    pub rig: Name,
    /// Lens of the profile.
    pub lens: Name,
    /// What was asked.
    pub request: JobRequest,
    /// Where it is.
    pub state: JobState,
    /// How far it is.
    pub progress: Progress,
    /// Claims so far.
    pub attempt: u32,
    /// Fence: grows with each claim.
    pub lease_token: i64,
    /// Grows with every visible change; the id of server-sent events.
    pub version: i64,
    /// When it was accepted.
    pub created_at: Timestamp,
    /// When its first claim was.
    pub started_at: Option<Timestamp>,
    /// When it ended.
    pub finished_at: Option<Timestamp>,
    /// Someone asked for its end.
    pub cancel_requested: bool,
    /// Why it failed.
    pub error: Option<Fault>,
    /// What the user should know.
    pub warnings: Vec<Warning>,
    /// The zip is gone, because its time was over; what was made of it is there.
    pub upload_removed: bool,
    /// What it made.
    pub outcome: Option<JobOutcome>,
}

/// A job about to be accepted.
#[derive(Debug, Clone, PartialEq)]
pub struct NewJob {
    /// UUIDv7, made before the upload was published under it.
    pub id: Uuid,
    /// Rig of the profile.
    pub rig: Name,
    /// Lens of the profile.
    pub lens: Name,
    /// What is asked.
    pub request: JobRequest,
    /// Known at the POST already.
    pub warnings: Vec<Warning>,
    /// `Idempotency-Key` and the fingerprint of the request (parameters and body digest).
    pub idempotency: Option<(String, String)>,
    /// The token that sent it; `None` when nobody was asked.
    pub owner: Option<Uuid>,
}

/// How accepting a job ended.
#[derive(Debug, Clone, PartialEq)]
pub enum Enqueue {
    /// It is stored; it survives a crash from here on.
    Accepted(Box<Job>),
    /// The same key and fingerprint came before: the first job.
    Repeated(Box<Job>),
    /// The same key came with another fingerprint.
    KeyReused,
    /// `limit` jobs wait already.
    QueueFull {
        /// Jobs that wait.
        waiting: u64,
    },
    /// The upload does not fit into the quota of its token.
    OverQuota(OverQuota),
}

/// Why bytes do not fit into the quota of a token.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OverQuota {
    /// Name of the token.
    pub token: String,
    /// Bytes that its stacks, calibrations and open uploads take.
    pub used: u64,
    /// Bytes that they may take.
    pub quota: u64,
}

/// What the heartbeat of a worker learns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Heartbeat {
    /// Go on.
    Alive,
    /// Somebody wants it cancelled: stop, then `finish` with [`Finish::Cancelled`].
    CancelRequested,
    /// Another worker has it, or it is gone: stop, publish nothing.
    Lost,
}

/// How a job ends.
#[derive(Debug, Clone, PartialEq)]
pub enum Finish {
    /// With results. A calibration brings the profile that becomes a revision in the same transaction; the
    /// outcome's `profile_revision` and `profile_digest` are filled in by the store.
    Succeeded {
        /// What was made.
        outcome: Box<JobOutcome>,
        /// What the user should know, in all.
        warnings: Vec<Warning>,
        /// The profile that a calibration measured.
        profile: Option<Box<ProfileDraft>>,
    },
    /// With an error.
    Failed(Fault),
    /// Because it was asked for.
    Cancelled,
}

/// A row, as the clean-up sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BlobOwner {
    /// Where the job is.
    pub state: JobState,
    /// Results of older leases are nobody's.
    pub lease_token: i64,
    /// The zip is not needed any more.
    pub upload_removed: bool,
}

/// Whether an attempt that was given up counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Attempt {
    /// The job may be why: it counts towards the most that are made. It is not claimed again before `pause` is over.
    Counts {
        /// Time before the next claim.
        pause: std::time::Duration,
    },
    /// The server goes down: the job has nothing to do with it.
    IsFree,
}

/// How asking for the end of a job ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CancelRequest {
    /// It was queued and is cancelled now.
    Cancelled,
    /// It runs; its worker will see the wish within seconds.
    Requested,
    /// It had ended before, in this state.
    AlreadyEnded(JobState),
}

/// Jobs by state, for the Prometheus page and admission.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct JobCounts {
    /// Waiting.
    pub queued: u64,
    /// With a worker.
    pub running: u64,
    /// Ended well.
    pub succeeded: u64,
    /// Ended badly.
    pub failed: u64,
    /// Cancelled.
    pub cancelled: u64,
}

/// The rows. One narrow seam with one conformance suite that runs on every engine.
#[async_trait]
pub trait Rows: UploadRows + TokenRows + Send + Sync + 'static {
    /// Stores the next revision of (rig, lens). Revision numbers are never used twice, even after a delete.
    async fn put_profile(
        &self,
        rig: &Name,
        lens: &Name,
        draft: &ProfileDraft,
        condition: Precondition,
    ) -> StoreResult<PutProfile>;
    /// The current revision, or the one asked for. `None` when there is none or the profile was deleted.
    async fn profile(&self, rig: &Name, lens: &Name, revision: Option<u32>) -> StoreResult<Option<Profile>>;
    /// A revision that a job names, deleted or not.
    async fn profile_of_job(&self, rig: &Name, lens: &Name, revision: u32) -> StoreResult<Option<Profile>>;
    /// Current revisions, the one written last first. Like every list: a page ends at its limit or at 3 MiB of rows,
    /// whichever comes first, and has one row at least unless there is none.
    async fn profiles(
        &self,
        rig: Option<&Name>,
        lens: Option<&Name>,
        page: &PageRequest,
    ) -> StoreResult<Page<ProfileSummary>>;
    /// All revisions of one key, newest first; empty when there is no such profile.
    async fn revisions(&self, rig: &Name, lens: &Name, page: &PageRequest) -> StoreResult<Page<ProfileSummary>>;
    /// Every revision there is, of deleted profiles too, whole, newest first.
    async fn stored_revisions(&self, page: &PageRequest) -> StoreResult<Page<Profile>>;
    /// Rig and lens of the profiles that are there: at most `limit`.
    async fn profile_keys(&self, limit: u32) -> StoreResult<Vec<(Name, Name)>>;
    /// Deletes (rig, lens); false when there was none, and nothing happens on a failed precondition (`Err(current)`).
    async fn delete_profile(
        &self,
        rig: &Name,
        lens: &Name,
        condition: Precondition,
    ) -> StoreResult<Result<bool, Option<u32>>>;

    /// Accepts a job: when this returns, it survives a crash. At most `queue_limit` jobs may wait, and the upload must
    /// fit into the quota of its owner.
    async fn enqueue(&self, job: &NewJob, queue_limit: u64) -> StoreResult<Enqueue>;
    /// The job that an `Idempotency-Key` made, with the fingerprint it came with.
    async fn by_idempotency_key(&self, key: &str) -> StoreResult<Option<(Job, String)>>;
    /// One job.
    async fn job(&self, id: Uuid) -> StoreResult<Option<Job>>;
    /// The kind of a job, also of one whose row cannot be read otherwise. `None` when there is no such job.
    async fn job_kind(&self, id: Uuid) -> StoreResult<Option<JobKind>>;
    /// Jobs, newest first.
    async fn jobs(&self, filter: &JobFilter, page: &PageRequest) -> StoreResult<Page<Job>>;
    /// Jobs by state.
    async fn counts(&self) -> StoreResult<JobCounts>;
    /// Sums over all rows, for Prometheus.
    async fn totals(&self) -> StoreResult<Totals>;

    /// Takes the oldest job that waits, or one whose lease ran out, for `lease`. A job that was claimed
    /// `max_attempts` times and lost each time fails with `worker_lost` instead.
    async fn claim(&self, lease: std::time::Duration, max_attempts: u32) -> StoreResult<Option<Job>>;
    /// Renews the lease and stores the progress.
    async fn heartbeat(
        &self,
        id: Uuid,
        lease_token: i64,
        lease: std::time::Duration,
        progress: &Progress,
    ) -> StoreResult<Heartbeat>;
    /// Ends the job. False when the lease was lost: then nothing was published. A cancel that was requested
    /// before wins over success and over failure: then this is still true, the job is `cancelled` and what it made is
    /// garbage ([`sweep::tidy_job`]).
    async fn finish(&self, id: Uuid, lease_token: i64, finish: &Finish) -> StoreResult<bool>;
    /// Gives a job back unfinished. A job that should end or go ends or goes instead. False when the lease was lost.
    async fn release(&self, id: Uuid, lease_token: i64, attempt: Attempt) -> StoreResult<bool>;
    /// Asks for the end of a job. `None` when there is no such job.
    async fn cancel(&self, id: Uuid) -> StoreResult<Option<CancelRequest>>;
    /// Removes a job that has ended or waits; a running one is told to cancel, is not to be seen any more, and is
    /// removed when its worker lets go. False when there is no such job. Its blobs become garbage for the sweep.
    async fn delete_job(&self, id: Uuid) -> StoreResult<bool>;
    /// Removes the jobs whose time since their end is over, by their own `keep_days` or by `keep`; their ids.
    async fn delete_expired(&self, keep: &Retention) -> StoreResult<Vec<Uuid>>;
    /// Says of the jobs whose zip is over its time that it is gone; their ids. The blobs go afterwards.
    async fn expire_job_uploads(&self, keep: &Retention) -> StoreResult<Vec<Uuid>>;
    /// Bytes that the stacks, calibrations and open uploads of a token take.
    async fn bytes_of(&self, owner: Uuid) -> StoreResult<u64>;
    /// What a live row still needs of the blobs of this job (`uploads/{id}...`, `results/{id}/...`): the sweep asks before
    /// it deletes. `None`: no row, nothing is needed.
    async fn blob_owner(&self, id: Uuid) -> StoreResult<Option<BlobOwner>>;

    /// Fires (with the job's id) after each visible change made by this process; listeners poll as well,
    /// because other processes may change rows too.
    fn changes(&self) -> tokio::sync::broadcast::Receiver<Uuid>;
    /// What the database itself finds wrong with its file: a sentence each.
    async fn objections(&self) -> StoreResult<Vec<String>>;
    /// True when the database answers.
    async fn healthy(&self) -> bool;
}
