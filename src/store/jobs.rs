//! Jobs as clients see them: accepted, listed, cancelled, deleted. What workers do with them is in [`super::leases`].

use async_trait::async_trait;
use jiff::Timestamp;
use uuid::Uuid;

use super::{Page, PageRequest, StoreResult, search::FoundStacks};
use crate::contract::{
    Fault, JobKind, JobState, Name, Progress, Verdict, outcome::JobOutcome, request::JobRequest, verdict,
};
use pinstack_science::types::Warning;

/// Which jobs a list contains. A filter that is `None` accepts every job.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct JobFilter {
    /// Stacks, calibrations or reconstructions.
    pub kind: Option<JobKind>,
    /// State.
    pub state: Option<JobState>,
    /// Rig of the profile.
    pub rig: Option<Name>,
    /// Lens of the profile.
    pub lens: Option<Name>,
    /// Scan of the stack or reconstruction.
    pub scan: Option<Name>,
    /// SHA-256 of the zip of the stack, hex: all runs of the same pictures. Ignored without `kind`.
    pub zip: Option<String>,
    /// Verdict on the result of the stack.
    pub verdict: Option<Verdict>,
    /// Words that label, scan, rig, lens or file name contain, each at least as the beginning of a word. Ignored
    /// without `kind`.
    pub q: Option<String>,
    /// Accepted at this time or later.
    pub since: Option<Timestamp>,
    /// Accepted before this time.
    pub until: Option<Timestamp>,
    /// Jobs that this token sent, and jobs sent without a token.
    pub owner: Option<Uuid>,
}

/// A stored job.
#[derive(Debug, Clone, PartialEq)]
pub struct Job {
    /// UUIDv7.
    pub id: Uuid,
    /// Rig of the profile.
    pub rig: Name,
    /// Lens of the profile.
    pub lens: Name,
    /// What was requested.
    pub request: JobRequest,
    /// State.
    pub state: JobState,
    /// Progress within the state `running`.
    pub progress: Progress,
    /// Number of claims that count.
    pub attempt: u32,
    /// Fencing token: incremented by each claim.
    pub lease_token: i64,
    /// Incremented by every change except the removal of the zip; the id of server-sent events.
    pub version: i64,
    /// Time of acceptance.
    pub created_at: Timestamp,
    /// Time of the first claim.
    pub started_at: Option<Timestamp>,
    /// Time of the end.
    pub finished_at: Option<Timestamp>,
    /// A client asked for the cancellation.
    pub cancel_requested: bool,
    /// Why the job failed.
    pub error: Option<Fault>,
    /// What the user should know.
    pub warnings: Vec<Warning>,
    /// The zip was removed when its retention time expired; the results are still stored.
    pub upload_removed: bool,
    /// What the job produced.
    pub outcome: Option<JobOutcome>,
    /// The trace that it belongs to, for [`crate::telemetry::traces`].
    pub trace: Option<String>,
}

impl Job {
    /// A job that runs now and that no queue has.
    pub fn unqueued(rig: Name, lens: Name, request: JobRequest, now: Timestamp) -> Self {
        Self {
            id: Uuid::now_v7(),
            rig,
            lens,
            request,
            state: JobState::Running,
            progress: Progress::default(),
            attempt: 1,
            lease_token: 1,
            version: 1,
            created_at: now,
            started_at: None,
            finished_at: None,
            cancel_requested: false,
            error: None,
            warnings: Vec::new(),
            upload_removed: false,
            outcome: None,
            trace: None,
        }
    }

    /// The verdict on the result; `None` for a calibration, and for a stack without a result.
    pub fn verdict(&self) -> Option<Verdict> {
        let is_fused = self.request.kind() == JobKind::Stack && self.state == JobState::Succeeded;
        is_fused.then(|| verdict::verdict(&self.warnings))
    }
}

/// A job that is to be accepted.
#[derive(Debug, Clone, PartialEq)]
pub struct NewJob {
    /// UUIDv7, chosen before the upload was stored under it.
    pub id: Uuid,
    /// Rig of the profile.
    pub rig: Name,
    /// Lens of the profile.
    pub lens: Name,
    /// What is requested.
    pub request: JobRequest,
    /// Warnings that are known at acceptance.
    pub warnings: Vec<Warning>,
    /// `Idempotency-Key`, and the fingerprint of the request (parameters and body digest).
    pub idempotency: Option<(String, String)>,
    /// The token that sent the job; `None` when no token was required.
    pub owner: Option<Uuid>,
    /// The trace that it belongs to, for [`crate::telemetry::traces`].
    pub trace: Option<String>,
}

/// Result of accepting a job.
#[derive(Debug, Clone, PartialEq)]
pub enum Enqueue {
    /// The job is stored durably.
    Accepted(Box<Job>),
    /// A job with the same key and fingerprint exists. Contains that job.
    Repeated(Box<Job>),
    /// A job with the same key and another fingerprint exists.
    KeyReused,
    /// The queue is full.
    QueueFull {
        /// Number of queued jobs.
        waiting: u64,
    },
    /// The upload exceeds the quota of its token.
    OverQuota(OverQuota),
    /// The stack names a scan that does not exist, or is of another rig or lens.
    NoSuchScan(Name),
}

/// Result of accepting several jobs: all of them or none.
#[derive(Debug, Clone, PartialEq)]
pub enum EnqueueAll {
    /// Every job is stored durably, in the order given.
    Accepted(Vec<Job>),
    /// No job is stored: this is the result of the first job that is not accepted.
    Refused(Enqueue),
}

/// Why an upload exceeds the quota of a token.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OverQuota {
    /// Name of the token.
    pub token: String,
    /// Bytes that its stacks, calibrations and open uploads use.
    pub used: u64,
    /// Bytes that they may use.
    pub quota: u64,
}

/// What garbage collection needs to know of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BlobOwner {
    /// State.
    pub state: JobState,
    /// Token of the latest lease. Results of older leases were never published.
    pub lease_token: i64,
    /// The zip is not needed any more.
    pub upload_removed: bool,
}

/// Result of a request for cancellation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CancelRequest {
    /// No worker held the job; it is cancelled.
    Cancelled,
    /// The job is running; its worker stops within seconds.
    Requested,
    /// The job had ended before, in this state.
    AlreadyEnded(JobState),
}

/// Number of jobs by state.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct JobCounts {
    /// `queued`.
    pub queued: u64,
    /// `running`.
    pub running: u64,
    /// `succeeded`.
    pub succeeded: u64,
    /// `failed`.
    pub failed: u64,
    /// `cancelled`.
    pub cancelled: u64,
}

/// Accepts, lists, cancels and deletes jobs.
#[async_trait]
pub trait JobQueue: Send + Sync + 'static {
    /// Accepts a job: on return it is durable. At most `queue_limit` jobs may be queued, and the upload must fit into
    /// the quota of its owner.
    async fn enqueue(&self, job: &NewJob, queue_limit: u64) -> StoreResult<Enqueue>;
    /// Accepts all of these jobs, or none, in one transaction. The limits hold for all of them together.
    async fn enqueue_all(&self, jobs: &[NewJob], queue_limit: u64) -> StoreResult<EnqueueAll>;
    /// The job that an `Idempotency-Key` created, and the fingerprint of its request.
    async fn by_idempotency_key(&self, key: &str) -> StoreResult<Option<(Job, String)>>;
    /// One job.
    async fn job(&self, id: Uuid) -> StoreResult<Option<Job>>;
    /// The versions of those of these jobs that exist.
    async fn versions(&self, ids: &[Uuid]) -> StoreResult<Vec<(Uuid, i64)>>;
    /// The kind of a job, also when the rest of its row cannot be read. `None` when there is no such job.
    async fn job_kind(&self, id: Uuid) -> StoreResult<Option<JobKind>>;
    /// Jobs, newest first.
    async fn jobs(&self, filter: &JobFilter, page: &PageRequest) -> StoreResult<Page<Job>>;
    /// Numbers of the stacks that match, by verdict; `state` and `verdict` of the filter are left out.
    async fn found(&self, filter: &JobFilter) -> StoreResult<FoundStacks>;
    /// Ids of the queued jobs in the order in which they will be claimed; at most `limit`.
    async fn queued(&self, limit: u32) -> StoreResult<Vec<Uuid>>;
    /// Number of jobs by state.
    async fn counts(&self) -> StoreResult<JobCounts>;
    /// Requests the cancellation of a job. `None` when there is no such job.
    async fn cancel(&self, id: Uuid) -> StoreResult<Option<CancelRequest>>;
    /// Deletes a job; false when there is no such job. A running job is cancelled and hidden at once, and removed when
    /// its worker releases it. Its blobs become garbage.
    async fn delete_job(&self, id: Uuid) -> StoreResult<bool>;
    /// Which blobs of a job are still needed (`uploads/{id}.zip`, `results/{id}/`). `None`: there is no such row, so
    /// none is needed. A job that is deleted but still running has a row.
    async fn blob_owner(&self, id: Uuid) -> StoreResult<Option<BlobOwner>>;
    /// Keys of the blobs that the row of a job refers to, as far as they can be read from a damaged row.
    async fn blob_keys(&self, id: Uuid) -> StoreResult<Vec<String>>;
}
