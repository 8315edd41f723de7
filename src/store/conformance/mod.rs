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
//! engine needs that a machine may lack: the tests are ignored for this reason. The suites are compiled for the tests of
//! this crate, and for other crates with the feature `testing`, so that a test can run them against a live database.

// the name of a case states what it requires
#![allow(missing_docs)]

pub mod blobs;
pub mod disk;
pub mod expiry;
pub mod gc;
pub mod jobs;
pub mod leases;
pub mod line;
pub mod memory;
pub mod parts;
pub mod profiles;
pub mod scans;
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

/// Fresh, empty metadata and its clock.
pub struct Fresh {
    pub metadata: Arc<dyn MetadataStore>,
    pub clock: Arc<ManualClock>,
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
    let request = JobRequest::Calibration(CalibrationRequest { options, upload: upload(), layout: layout() });
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
    metadata.claim(LEASE, ATTEMPTS).await.expect("claim")
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

/// The suites of a metadata store. See [`crate::store::conformance`].
#[macro_export]
macro_rules! metadata_conformance {
    ($fresh:path $(, $needs:tt)?) => {
        $crate::conformance_cases! { $fresh, [$($needs)?];
            profiles:
                a_profile_comes_back_as_it_was_put,
                an_imported_profile_remembers_its_origin_and_its_warnings,
                every_write_is_a_new_revision_and_old_ones_never_change,
                preconditions_decide_a_race,
                a_delete_hides_the_profile_and_keeps_the_numbering,
                lists_are_paged_newest_first_and_filtered,
                a_foreign_cursor_is_refused,
                the_keys_of_profiles_are_listed,
                a_profile_that_could_not_be_read_again_is_not_stored,
                concurrent_writes_each_get_a_revision_of_their_own;
            jobs:
                an_accepted_job_is_queued_with_its_whole_request,
                a_repeated_key_gives_the_first_job_and_another_request_is_refused,
                concurrent_repeats_of_one_key_make_one_job,
                a_full_queue_refuses_until_a_worker_takes_one,
                the_queue_is_told_in_the_order_of_acceptance,
                lists_are_paged_newest_first_and_filtered,
                a_success_shows_its_outcome,
                a_calibration_stores_its_revision_with_its_end,
                a_failure_shows_its_fault,
                a_queued_job_is_cancelled_at_once_and_never_claimed,
                a_cancel_before_the_end_wins_over_success,
                a_cancel_after_the_end_changes_nothing,
                a_concurrent_cancel_and_finish_have_one_winner,
                a_deleted_job_disappears_and_a_running_one_when_its_worker_releases_it,
                a_job_expires_after_its_retention_time,
                every_visible_change_is_announced_and_counted,
                a_page_ends_at_its_size_limit,
                the_versions_of_several_jobs_are_read_at_once,
                a_result_that_could_not_be_read_again_fails_the_job;
            scans:
                a_scan_comes_back_as_it_was_put_and_counts_its_versions,
                scans_are_listed_newest_first_filtered_and_by_owner,
                a_stack_joins_only_a_scan_of_its_rig_and_lens,
                a_scan_with_stacks_keeps_its_camera_and_is_not_deleted,
                several_jobs_are_accepted_together_or_not_at_all,
                an_upload_becomes_the_stacks_of_a_scan_once;
            uploads:
                open_uploads_are_listed_newest_first_with_their_tokens,
                a_quota_holds_under_concurrent_requests,
                concurrent_repeats_of_a_key_make_one_job_within_a_quota_for_one,
                an_upload_advances_only_from_its_offset,
                an_upload_that_several_may_write_advances_only_for_the_newest_generation,
                a_takeover_increments_the_generation_and_is_announced,
                a_complete_upload_becomes_one_job_and_an_incomplete_one_none,
                a_refused_upload_becomes_no_job,
                an_upload_expires_unless_more_bytes_arrive,
                only_open_uploads_are_counted;
            tokens:
                a_token_comes_back_as_it_was_added_until_it_is_revoked,
                a_list_can_be_restricted_to_the_jobs_of_one_token,
                the_bytes_of_a_token_are_counted_until_they_are_removed;
            totals:
                totals_count_jobs_bytes_and_quotas;
            leases:
                a_job_released_with_a_pause_is_not_claimed_before_it_is_over,
                a_clock_that_jumps_forward_takes_no_job_from_a_living_worker,
                a_clock_that_jumps_back_keeps_no_job_with_a_dead_worker,
                jobs_are_claimed_in_the_order_of_acceptance,
                no_job_is_claimed_twice_by_concurrent_workers,
                a_heartbeat_renews_the_lease_and_shows_the_progress,
                a_worker_back_from_the_dead_cannot_publish,
                a_late_worker_may_finish_a_job_that_was_not_claimed_again,
                a_job_that_loses_its_worker_three_times_fails_and_does_not_stall_the_queue,
                a_released_job_is_queued_again_and_the_attempt_does_not_count,
                a_cancel_reaches_the_worker_and_survives_its_death,
                a_job_of_a_lost_worker_is_cancelled_at_once,
                a_released_job_with_a_pending_cancellation_ends,
                a_deleted_job_of_a_lost_worker_is_removed_by_the_next_claim,
                a_lease_expires_by_its_own_length;
            turns:
                rigs_take_turns,
                a_rig_that_sends_late_is_next_and_does_not_catch_up_on_the_past,
                a_rig_that_sends_one_stack_after_another_does_not_push_others_aside,
                a_turn_is_measured_by_the_size_of_the_zips,
                a_high_priority_passes_the_jobs_of_its_rig_and_a_low_one_waits_for_all,
                a_calibration_passes_the_stacks_of_its_rig,
                a_rig_whose_jobs_are_all_urgent_does_not_push_others_aside,
                cancelled_stacks_cost_their_rig_no_turn,
                tokens_of_one_rig_take_turns,
                a_resumable_upload_takes_the_turn_of_its_token,
                workers_hear_of_jobs_that_join_the_queue_and_of_nothing_else,
                a_job_that_returns_to_the_queue_keeps_its_turn;
            expiry:
                a_clock_that_jumps_expires_nothing,
                time_that_passes_after_a_jump_counts;
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
