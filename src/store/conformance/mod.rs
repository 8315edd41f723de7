//! Conformance suites: what every engine must do.
//!
//! One macro per trait lists the cases of its suite and makes a test of each. An engine calls the macro with a function
//! that creates a fresh store:
//!
//! | macro | trait | argument |
//! |---|---|---|
//! | [`metadata_conformance!`](crate::metadata_conformance) | [`MetadataStore`] | `async fn() -> (guard, Fresh)` |
//! | [`blob_conformance!`](crate::blob_conformance) | [`super::BlobStore`] | `async fn() -> (guard, Store)` |
//! | [`upload_parts_conformance!`](crate::upload_parts_conformance) | [`super::UploadParts`] | `async fn() -> (guard, Store)` |
//! | [`gc_conformance!`](crate::gc_conformance) | all of them, with garbage collection | `async fn() -> (guard, FreshStore)` |
//!
//! The path of the function must be absolute. The guard is kept until the test ends. A second argument says what the
//! engine needs that a machine may lack: the tests are ignored for this reason. The suites are compiled for the tests
//! of this crate, and for other crates with the feature `testing`, so that a test can run them against a live database.

// the name of a case states what it requires
#![allow(missing_docs)]

pub mod blobs;
pub mod clock;
pub mod database;
pub mod disk;
pub mod expiry;
pub mod gc;
pub mod jobs;
pub mod leases;
pub mod line;
pub mod memory;
pub mod notes;
pub mod parts;
pub mod profiles;
pub mod scans;
pub mod search;
mod suites;
pub mod tokens;
pub mod totals;
pub mod turns;
pub mod uploads;

use std::{sync::Arc, time::Duration};

use uuid::Uuid;

use super::{
    Enqueue, Job, ManualClock, MetadataStore, NewJob, PageRequest, Precondition, ProfileDraft, PutProfile, Store,
};
use crate::contract::{
    Name,
    outcome::{Artifact, CalibrationOutcome, ImageInfo, JobOutcome, StackOutcome},
    profile::{Profile, ProfileSource},
    request::{CalibrationRequest, JobRequest, StackRequest, Upload},
};
use pinstack_science::types::{
    Homography,
    calibration_options::CalibrationOptions,
    profile::{HomographyModel, ProfileInput, ProfileSlice},
    stack_layout::StackLayout,
};

/// Fresh, empty metadata, its clock, and the database that it is in.
pub struct Fresh {
    pub metadata: Arc<dyn MetadataStore>,
    pub clock: Arc<ManualClock>,
    pub database: Arc<dyn database::Database>,
}

/// A fresh, empty store and its clock.
pub struct FreshStore {
    pub store: Store,
    pub clock: Arc<ManualClock>,
}

pub const LEASE: Duration = Duration::from_secs(15);
pub const ATTEMPTS: u32 = 3;

pub fn name(text: &str) -> Name {
    Name::new(text).expect("a test uses good names")
}

pub fn page(limit: u32, cursor: Option<String>) -> PageRequest {
    PageRequest { limit, cursor }
}

pub fn draft(scale: f64) -> ProfileDraft {
    let homographies = vec![Homography::IDENTITY, Homography::similarity(scale, [0.25, -0.5])];
    let slices = homographies.iter().enumerate().map(|(i, h)| ProfileSlice::given(i as u32, *h, 1.0, 64, 48)).collect();
    let input = ProfileInput {
        image_width: 64,
        image_height: 48,
        reference_index: 0,
        homographies,
        gains: None,
        note: Some("made by a test".into()),
        ..ProfileInput::default()
    };
    let (source, model) = (ProfileSource::Upload, HomographyModel::Given);
    ProfileDraft { input, source, calibration_id: None, model, slices, origin: None, warnings: vec![] }
}

pub async fn put(metadata: &dyn MetadataStore, rig: &str, lens: &str, scale: f64) -> Profile {
    let put = metadata.put_profile(&name(rig), &name(lens), &draft(scale), Precondition::Any).await.expect("put");
    match put {
        PutProfile::Created(profile) | PutProfile::Updated(profile) => profile,
        PutProfile::PreconditionFailed(_) => panic!("no precondition was made"),
    }
}

fn layout() -> StackLayout {
    StackLayout {
        front: vec!["front/1.png".into(), "front/2.png".into()],
        back: vec![],
        lights: vec![],
        moved: vec![],
        width: 64,
        height: 48,
        bit_depth: 8,
        channels: 3,
        orientation: 1,
        largest_file_bytes: 5_000,
    }
}

fn upload() -> Upload {
    Upload { key: "uploads/x.zip".into(), bytes: 12, sha256: "00".into(), filename: None }
}

pub fn stack() -> NewJob {
    NewJob {
        id: Uuid::now_v7(),
        rig: name("rig"),
        lens: name("lens"),
        request: JobRequest::Stack(StackRequest {
            options: Default::default(),
            profile_revision: 1,
            profile_digest: "d".into(),
            profile_optics_digest: Some("o".into()),
            upload: upload(),
            layout: layout(),
            rerun_of: None,
        }),
        warnings: vec![],
        idempotency: None,
        owner: None,
        trace: None,
    }
}

pub fn calibration() -> NewJob {
    let options = CalibrationOptions::default();
    let request =
        JobRequest::Calibration(CalibrationRequest { options, upload: upload(), layout: layout(), stacks: vec![] });
    NewJob { request, ..stack() }
}

pub fn stack_with(change: impl FnOnce(&mut StackRequest)) -> NewJob {
    let mut job = stack();
    if let JobRequest::Stack(request) = &mut job.request {
        change(request);
    }
    job
}

pub async fn accept(metadata: &dyn MetadataStore, job: &NewJob) -> Job {
    match metadata.enqueue(job, 1000).await.expect("enqueue") {
        Enqueue::Accepted(job) => *job,
        other => panic!("the job was not accepted: {other:?}"),
    }
}

pub async fn claim(metadata: &dyn MetadataStore) -> Option<Job> {
    metadata.claim(LEASE, ATTEMPTS, None).await.expect("claim")
}

/// Claims a job whose worker has sent no heartbeat for a whole lease, in a process that has not observed the lease
/// before.
pub async fn claim_from_the_dead(metadata: &dyn MetadataStore, clock: &ManualClock) -> Job {
    assert_eq!(claim(metadata).await, None, "its worker may be alive");
    clock.advance(LEASE);
    claim(metadata).await.expect("its worker is dead")
}

pub async fn job(metadata: &dyn MetadataStore, id: Uuid) -> Job {
    metadata.job(id).await.expect("read the job").expect("the job is there")
}

pub fn stack_outcome() -> JobOutcome {
    let artifact = Artifact {
        name: "image".into(),
        key: "results/x/1/image.png".into(),
        media_type: "image/png".into(),
        bytes: 3,
        sha256: "ab".into(),
        crc32: Some(7),
    };
    let image = ImageInfo { width: 64, height: 48, bit_depth: 8, crop_offset_px: [0, 0], intrinsics: None };
    JobOutcome::Stack(StackOutcome {
        artifacts: vec![artifact],
        image,
        height: None,
        metrics: Default::default(),
        software: None,
    })
}

pub fn calibration_outcome() -> JobOutcome {
    JobOutcome::Calibration(CalibrationOutcome {
        artifacts: vec![],
        profile_revision: None,
        profile_digest: None,
        profile_optics_digest: None,
        reference_index: 0,
        slices: vec![],
        dot_pitch_px: None,
        magnification: None,
        verdict: "good".into(),
        grade: None,
    })
}

pub fn success() -> super::Finish {
    super::Finish::Succeeded { outcome: Box::new(stack_outcome()), warnings: vec![], profile: None }
}

/// Makes a test of each case of the suites; the tests are ignored for the reason in the brackets, if there is one.
#[doc(hidden)]
#[macro_export]
macro_rules! conformance_cases {
    ($fresh:path, $needs:tt; $($suite:ident: $($case:ident),+ $(,)?;)+) => { $(
        mod $suite { $($crate::conformance_case!($fresh, $needs, $suite, $case);)+ }
    )+ };
}

/// Makes a test of one case.
#[doc(hidden)]
#[macro_export]
macro_rules! conformance_case {
    ($fresh:path, [$($needs:tt)?], $suite:ident, $case:ident) => {
        #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
        $(#[ignore = $needs])?
        async fn $case() {
            let (_guard, fresh) = $fresh().await;
            $crate::store::conformance::$suite::$case(fresh).await;
        }
    };
}

/// The suite of a blob store. See [`crate::store::conformance`].
#[macro_export]
macro_rules! blob_conformance {
    ($fresh:path $(, $needs:tt)?) => {
        $crate::conformance_cases! { $fresh, [$($needs)?];
            blobs:
                a_stored_file_is_the_blob_and_leaves_the_workspace,
                a_blob_is_read_by_range,
                an_open_blob_is_read_by_offset,
                blobs_are_listed_by_prefix,
                shared_bytes_stay_until_the_last_blob_is_removed,
                a_key_that_leaves_the_store_is_refused,
                deleting_a_job_removes_its_blobs_and_no_others,
                only_results_of_older_leases_are_stale;
        }
    };
}

/// The suite of the parts of resumable uploads. See [`crate::store::conformance`].
#[macro_export]
macro_rules! upload_parts_conformance {
    ($fresh:path $(, $needs:tt)?) => {
        $crate::conformance_cases! { $fresh, [$($needs)?];
            parts:
                an_upload_is_locked_by_one_request_at_a_time,
                uploads_with_bytes_are_listed_until_they_are_removed,
                bytes_after_the_offset_are_discarded_and_missing_bytes_are_reported;
        }
    };
}

/// The suite of garbage collection over a whole store. See [`crate::store::conformance`].
#[macro_export]
macro_rules! gc_conformance {
    ($fresh:path $(, $needs:tt)?) => {
        $crate::conformance_cases! { $fresh, [$($needs)?];
            gc:
                garbage_collection_keeps_what_rows_refer_to_and_removes_the_rest,
                the_blobs_of_expired_and_deleted_jobs_are_removed,
                zips_of_a_scan_are_kept_while_its_upload_is_open_however_long_they_take_to_store,
                only_uploads_that_waited_count_as_given_up,
                jobs_and_zips_expire_by_their_retention_times;
        }
    };
}
