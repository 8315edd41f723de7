//! Calibration profiles and their revisions.
//!
//! A profile is addressed by (rig, lens). Each write stores a new revision. A revision never changes, and it stays in
//! the store after its profile was deleted, because results refer to it.

use async_trait::async_trait;
use jiff::Timestamp;
use uuid::Uuid;

use super::{
    Page, PageRequest, StoreResult,
    digest::{optics_digest, profile_digest},
};
use crate::contract::{
    Name, ProfileSummary,
    profile::{Profile, ProfileOrigin, ProfileSource},
};
use pinstack_science::types::{
    Warning,
    profile::{HomographyModel, ProfileInput, ProfileSlice},
};

/// The content of a revision that is to be stored.
#[derive(Debug, Clone, PartialEq)]
pub struct ProfileDraft {
    /// Geometry and camera parameters.
    pub input: ProfileInput,
    /// Uploaded or measured.
    pub source: ProfileSource,
    /// The calibration that measured it.
    pub calibration_id: Option<Uuid>,
    /// Transform model of the homographies.
    pub model: HomographyModel,
    /// One entry per slice.
    pub slices: Vec<ProfileSlice>,
    /// The profile that this one was copied from.
    pub origin: Option<ProfileOrigin>,
    /// What was changed in the input when it was accepted.
    pub warnings: Vec<Warning>,
}

impl ProfileDraft {
    /// The revision that it becomes.
    pub fn revision(self, rig: Name, lens: Name, revision: u32, created_at: Timestamp) -> Profile {
        Profile {
            rig,
            lens,
            revision,
            digest: profile_digest(&self.input),
            optics_digest: optics_digest(&self.input),
            created_at,
            source: self.source,
            calibration_id: self.calibration_id,
            origin: self.origin,
            model: self.model,
            warnings: self.warnings,
            principal_distance_px: self.input.principal_distance_px(),
            slice_count: u32::try_from(self.input.homographies.len()).unwrap_or(u32::MAX),
            slices: self.slices,
            input: self.input,
        }
    }
}

/// Condition of a write on the current revision (`If-Match`, `If-None-Match`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Precondition {
    /// No condition.
    #[default]
    Any,
    /// There is no current revision (`If-None-Match: *`).
    Absent,
    /// There is a current revision (`If-Match: *`).
    Present,
    /// The current revision has this number.
    Revision(u32),
}

impl Precondition {
    /// Whether the condition holds for the revision `current`.
    pub fn holds(self, current: Option<u32>) -> bool {
        match self {
            Self::Any => true,
            Self::Absent => current.is_none(),
            Self::Present => current.is_some(),
            Self::Revision(expected) => current == Some(expected),
        }
    }
}

/// Result of a conditional write of a profile.
#[derive(Debug, Clone, PartialEq)]
pub enum PutProfile {
    /// The key had no current revision: it is new, or it was deleted before.
    Created(Profile),
    /// The key had a current revision.
    Updated(Profile),
    /// The precondition failed. Contains the current revision, if there is one.
    PreconditionFailed(Option<u32>),
}

/// Result of deleting a profile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeleteProfile {
    /// It is deleted.
    Deleted,
    /// There is no such profile.
    NotFound,
    /// The precondition failed. Contains the current revision, if there is one.
    PreconditionFailed(Option<u32>),
}

/// Stores profiles.
#[async_trait]
pub trait ProfileStore: Send + Sync + 'static {
    /// Stores the next revision of (rig, lens). A revision number is never used twice, not even after a delete.
    async fn put_profile(
        &self,
        rig: &Name,
        lens: &Name,
        draft: &ProfileDraft,
        condition: Precondition,
    ) -> StoreResult<PutProfile>;
    /// The current revision, or the given one. `None` when it does not exist or the profile was deleted.
    async fn profile(&self, rig: &Name, lens: &Name, revision: Option<u32>) -> StoreResult<Option<Profile>>;
    /// A revision that a job refers to, whether or not its profile was deleted.
    async fn profile_of_job(&self, rig: &Name, lens: &Name, revision: u32) -> StoreResult<Option<Profile>>;
    /// Current revisions, the most recently written first. A page ends at its limit or at 3 MiB of rows, whichever
    /// comes first, and has at least one row unless the list is empty. The same holds for every list of the store.
    async fn profiles(
        &self,
        rig: Option<&Name>,
        lens: Option<&Name>,
        page: &PageRequest,
    ) -> StoreResult<Page<ProfileSummary>>;
    /// All revisions of one key, newest first; empty when there is no such profile.
    async fn revisions(&self, rig: &Name, lens: &Name, page: &PageRequest) -> StoreResult<Page<ProfileSummary>>;
    /// All revisions in full, including those of deleted profiles, newest first.
    async fn all_revisions(&self, page: &PageRequest) -> StoreResult<Page<Profile>>;
    /// Rig and lens of at most `limit` profiles.
    async fn profile_keys(&self, limit: u32) -> StoreResult<Vec<(Name, Name)>>;
    /// Deletes (rig, lens). Its revisions stay, because results refer to them.
    async fn delete_profile(&self, rig: &Name, lens: &Name, condition: Precondition) -> StoreResult<DeleteProfile>;
}
