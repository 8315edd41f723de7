//! The conformance suite on SQLite, and what SQLite alone must do.

use std::sync::Arc;

use tempfile::TempDir;

use super::*;
use crate::{
    contract::{ProfileSummary, profile::Profile},
    store::{
        Expiry, Job, JobFilter, JobQueue, Leases, ManualClock, ProfileStore, Retention, UploadRecords,
        conformance::{self, Fresh},
    },
};

async fn fresh() -> (TempDir, Fresh) {
    let folder = tempfile::tempdir().expect("a folder for the test");
    let clock = Arc::new(ManualClock::default());
    let rows = SqliteMetadata::open_with_clock(folder.path().join("rows.db"), clock.clone()).await.expect("open");
    (folder, Fresh { rows: Arc::new(rows), clock })
}

macro_rules! conforms {
    ($suite:ident: $($case:ident),+ $(,)?) => { mod $suite { $(
        #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
        async fn $case() {
            let (_folder, store) = super::fresh().await;
            super::conformance::$suite::$case(store).await;
        }
    )+ } };
}

conforms!(profiles:
    a_profile_comes_back_as_it_was_put,
    an_imported_profile_remembers_its_origin_and_its_warnings,
    every_write_is_a_new_revision_and_old_ones_never_change,
    preconditions_decide_a_race,
    a_delete_hides_the_profile_and_keeps_the_numbering,
    lists_are_paged_newest_first_and_filtered,
    a_foreign_cursor_is_refused,
    the_keys_of_profiles_are_listed,
    a_profile_that_could_not_be_read_again_is_not_stored,
    concurrent_writes_each_get_a_revision_of_their_own,
);

conforms!(jobs:
    an_accepted_job_waits_with_all_that_was_asked,
    a_repeated_key_gives_the_first_job_and_another_request_is_refused,
    concurrent_repeats_of_one_key_make_one_job,
    a_full_queue_refuses_until_a_worker_takes_one,
    lists_are_paged_newest_first_and_filtered,
    a_success_shows_its_outcome,
    a_calibration_stores_its_revision_with_its_end,
    a_failure_shows_its_fault,
    a_waiting_job_is_cancelled_at_once_and_never_claimed,
    a_cancel_before_the_end_wins_over_success,
    a_cancel_after_the_end_changes_nothing,
    a_cancel_that_meets_a_finish_has_one_winner,
    a_deleted_job_is_gone_and_a_running_one_goes_with_its_worker,
    a_job_expires_only_after_its_days,
    every_visible_change_is_announced_and_counted,
    a_page_ends_before_it_is_too_large,
    a_result_that_could_not_be_read_again_fails_the_job,
);

conforms!(uploads:
    open_uploads_are_listed_newest_first_with_their_tokens,
    a_quota_holds_however_many_ask_at_once,
    repeats_of_a_key_at_once_make_one_job_though_the_quota_has_room_for_one,
    an_upload_grows_only_from_where_it_is,
    a_newer_wish_has_a_larger_number_and_is_announced,
    a_whole_upload_becomes_one_job_and_a_torn_one_none,
    a_refused_upload_becomes_no_job,
    an_upload_goes_when_its_time_is_over_and_each_piece_gives_it_more,
    only_open_uploads_are_counted,
);

conforms!(tokens:
    a_token_comes_back_as_it_was_added_until_it_is_revoked,
    a_list_can_be_kept_to_what_one_token_sent,
    what_a_token_takes_is_counted_until_it_is_gone,
);

conforms!(totals:
    totals_count_jobs_bytes_and_quotas,
);

conforms!(leases:
    a_job_released_with_a_pause_is_not_claimed_before_it_is_over,
    a_clock_that_leaps_forward_takes_no_job_from_a_living_worker,
    a_clock_that_leaps_back_keeps_no_job_with_a_dead_worker,
    jobs_are_claimed_in_the_order_of_acceptance,
    no_job_is_claimed_twice_however_many_claim_at_once,
    a_heartbeat_renews_the_lease_and_shows_the_progress,
    a_worker_back_from_the_dead_cannot_publish,
    a_late_worker_whose_job_nobody_took_may_still_finish,
    a_job_that_loses_its_worker_three_times_fails_and_does_not_stall_the_queue,
    a_released_job_waits_again_and_the_attempt_does_not_count,
    a_cancel_reaches_the_worker_and_survives_its_death,
    a_job_whose_worker_is_gone_is_cancelled_without_one,
    a_released_job_that_was_to_end_ends,
    a_deleted_job_whose_worker_died_goes_with_the_next_claim,
    a_lease_is_judged_by_its_own_length_and_not_by_that_of_who_looks,
);

conforms!(expiry:
    a_clock_that_leaps_expires_nothing,
    after_a_leap_time_that_passes_counts,
);

#[tokio::test]
async fn accepted_jobs_and_profiles_survive_a_reopen() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rows.db");
    let rows = SqliteMetadata::open(&path).await.unwrap();
    let job = conformance::accept(&rows, &conformance::stack()).await;
    let profile = conformance::put(&rows, "rig", "lens", 1.5).await;
    drop(rows); // without a close, as after a kill
    let rows = SqliteMetadata::open(&path).await.unwrap();
    assert_eq!(rows.job(job.id).await.unwrap(), Some(job));
    assert_eq!(rows.profile(&profile.rig, &profile.lens, None).await.unwrap(), Some(profile));
    rows.close().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn two_processes_on_one_file_never_claim_the_same_job() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rows.db");
    // two stores on one file share nothing but the file, like two processes
    let (one, two) = tokio::join!(SqliteMetadata::open(&path), SqliteMetadata::open(&path));
    let (one, two) = (one.unwrap(), two.unwrap());
    for _ in 0..10 {
        conformance::accept(&one, &conformance::stack()).await;
    }
    let drain = async |rows: &SqliteMetadata| {
        let mut claimed = Vec::new();
        while let Some(job) = conformance::claim(rows).await {
            claimed.push(job.id);
        }
        claimed
    };
    let (mut claimed, others) = tokio::join!(drain(&one), drain(&two));
    claimed.extend(others);
    claimed.sort();
    claimed.dedup();
    assert_eq!(claimed.len(), 10);
    assert_eq!(two.counts().await.unwrap().running, 10);
}

#[tokio::test]
async fn a_full_disk_is_told_from_other_errors_and_tears_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let rows = SqliteMetadata::open(folder.path().join("rows.db")).await.unwrap();
    let first = conformance::accept(&rows, &conformance::stack()).await;
    // SQLite reports its own page limit like a full disk; this is below what the file has, so it cannot grow
    sqlx::query("PRAGMA max_page_count = 1").execute(&rows.writer).await.unwrap();
    let mut full = None;
    for _ in 0..200 {
        if let Err(error) = rows.enqueue(&conformance::stack(), 1000).await {
            full = Some(error);
            break;
        }
    }
    assert!(matches!(full, Some(StoreError::DiskFull(_))), "{full:?}");
    assert_eq!(rows.job(first.id).await.unwrap(), Some(first));
    sqlx::query("PRAGMA max_page_count = 1000000").execute(&rows.writer).await.unwrap();
    conformance::accept(&rows, &conformance::stack()).await;
}

#[tokio::test]
async fn a_revision_cannot_be_changed_even_by_sql() {
    let folder = tempfile::tempdir().unwrap();
    let rows = SqliteMetadata::open(folder.path().join("rows.db")).await.unwrap();
    let put = conformance::put(&rows, "rig", "lens", 1.5).await;
    assert!(sqlx::query("UPDATE revisions SET body = '{}'").execute(&rows.writer).await.is_err());
    assert!(sqlx::query("DELETE FROM revisions").execute(&rows.writer).await.is_err());
    assert_eq!(rows.profile(&put.rig, &put.lens, None).await.unwrap(), Some(put));
}

#[tokio::test]
async fn an_offset_never_goes_back_even_by_sql() {
    let folder = tempfile::tempdir().unwrap();
    let rows = SqliteMetadata::open(folder.path().join("rows.db")).await.unwrap();
    let id = conformance::uploads::begun(&rows, 100).await;
    assert!(rows.advance_upload(id, &conformance::uploads::advance(0, 60)).await.unwrap());
    assert!(sqlx::query("UPDATE uploads SET received = 59").execute(&rows.writer).await.is_err());
    assert!(sqlx::query("UPDATE uploads SET received = 101").execute(&rows.writer).await.is_err());
    assert_eq!(rows.upload(id).await.unwrap().unwrap().offset, 60);
}

#[tokio::test]
async fn a_revision_stored_before_profiles_had_an_origin_or_a_digest_of_their_optics_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let rows = SqliteMetadata::open(folder.path().join("rows.db")).await.unwrap();
    let put = conformance::put(&rows, "rig", "lens", 1.5).await;
    let mut body = serde_json::to_value(&put).unwrap();
    for name in ["origin", "warnings", "principal_distance_px", "optics_digest"] {
        body.as_object_mut().unwrap().remove(name);
    }
    sqlx::query("INSERT INTO revisions (rig, lens, revision, body) VALUES ('rig', 'lens', 2, ?1)")
        .bind(body.to_string())
        .execute(&rows.writer)
        .await
        .unwrap();
    assert_eq!(rows.profile(&put.rig, &put.lens, Some(2)).await.unwrap(), Some(put));
}

/// A store as the schema of before heads, leases with a length and gaps of the clock left it, with a revision and a job.
async fn old_store(path: &Path) -> (Profile, Job) {
    let rows = SqliteMetadata::open(path).await.unwrap();
    let profile = conformance::put(&rows, "rig", "lens", 1.5).await;
    let job = conformance::accept(&rows, &conformance::stack()).await;
    for sql in [
        "DROP INDEX revisions_that_are_there",
        "DROP TRIGGER revision_heads_never_go",
        "DROP TABLE revision_heads",
        "ALTER TABLE jobs DROP COLUMN lease_ms",
        "DROP TABLE clock_seen",
        "DROP TABLE clock_gaps",
        "DELETE FROM _sqlx_migrations WHERE version = 6",
    ] {
        sqlx::query(sql).execute(&rows.writer).await.unwrap();
    }
    rows.close().await;
    (profile, job)
}

#[tokio::test]
async fn a_store_of_the_schema_before_is_brought_up_to_date_with_all_that_is_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rows.db");
    let (profile, job) = old_store(&path).await;
    let rows = SqliteMetadata::open(&path).await.unwrap();
    assert_eq!(rows.profile(&profile.rig, &profile.lens, None).await.unwrap().as_ref(), Some(&profile));
    assert_eq!(rows.job(job.id).await.unwrap().as_ref(), Some(&job));
    let heads: i64 = sqlx::query_scalar("SELECT count(*) FROM revision_heads").fetch_one(&rows.writer).await.unwrap();
    assert_eq!(heads, 1);
    let listed = rows.profiles(None, None, &conformance::page(10, None)).await.unwrap();
    assert_eq!(listed.items, [ProfileSummary::from(&profile)]);
    assert!(sqlx::query("UPDATE revision_heads SET head = '{}'").execute(&rows.writer).await.is_err());
    assert_eq!(conformance::claim(&rows).await.map(|claimed| claimed.id), Some(job.id));
}

#[tokio::test]
async fn a_clock_that_leapt_while_no_server_ran_expires_nothing_until_somebody_says_that_it_is_right() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rows.db");
    let clock = Arc::new(ManualClock::default());
    let rows = SqliteMetadata::open_with_clock(&path, clock.clone()).await.unwrap();
    conformance::accept(&rows, &conformance::stack_with(|request| request.options.keep_days = Some(1))).await;
    let job = conformance::claim(&rows).await.unwrap();
    assert!(rows.finish(job.id, job.lease_token, &conformance::success()).await.unwrap());
    assert!(rows.delete_expired_jobs(&Retention::default()).await.unwrap().is_empty());
    rows.close().await;

    let later = Arc::new(ManualClock::default());
    later.set_wall_by(10 * 24 * 60 * 60 * 1000);
    let rows = SqliteMetadata::open_with_clock(&path, later).await.unwrap();
    for _ in 0..2 {
        assert!(rows.delete_expired_jobs(&Retention::default()).await.unwrap().is_empty());
    }
    rows.confirm_clock().await.unwrap();
    assert_eq!(rows.delete_expired_jobs(&Retention::default()).await.unwrap(), [job.id]);
}

#[tokio::test]
async fn a_job_whose_row_cannot_be_read_is_named_in_lists_and_fails_when_its_turn_comes() {
    let folder = tempfile::tempdir().unwrap();
    let rows = SqliteMetadata::open(folder.path().join("rows.db")).await.unwrap();
    let broken = conformance::accept(&rows, &conformance::stack()).await;
    let next = conformance::accept(&rows, &conformance::stack()).await;
    sqlx::query("UPDATE jobs SET request = json_set(request, '$.layout.width', 'wide') WHERE id = ?1")
        .bind(broken.id)
        .execute(&rows.writer)
        .await
        .unwrap();
    let page = rows.jobs(&JobFilter::default(), &conformance::page(10, None)).await.unwrap();
    let skipped: Vec<String> = page.skipped.into_iter().map(|row| row.id).collect();
    assert_eq!((page.items, skipped), (vec![next.clone()], vec![broken.id.to_string()]));
    assert_eq!(rows.blob_keys(broken.id).await.unwrap(), [broken.request.upload().key.as_str()]);
    assert_eq!(conformance::claim(&rows).await.map(|claimed| claimed.id), Some(next.id), "the queue goes on");
    let (state, error): (String, String) = sqlx::query_as("SELECT state, error FROM jobs WHERE id = ?1")
        .bind(broken.id)
        .fetch_one(&rows.writer)
        .await
        .unwrap();
    assert!(state == "failed" && error.contains("cannot be read any more"), "{state} {error}");
}
