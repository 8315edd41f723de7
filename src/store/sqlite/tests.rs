//! The conformance suite on SQLite, and what is specific to SQLite.

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
    let file = folder.path().join("metadata.sqlite");
    let metadata = SqliteMetadata::open_with_clock(file, clock.clone()).await.expect("open");
    (folder, Fresh { metadata: Arc::new(metadata), clock })
}

crate::metadata_conformance!(crate::store::sqlite::tests::fresh);

#[tokio::test]
async fn accepted_jobs_and_profiles_survive_a_reopen() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("metadata.sqlite");
    let store = SqliteMetadata::open(&path).await.unwrap();
    let job = conformance::accept(&store, &conformance::stack()).await;
    let profile = conformance::put(&store, "rig", "lens", 1.5).await;
    drop(store); // not closed, as after a kill
    let store = SqliteMetadata::open(&path).await.unwrap();
    assert_eq!(store.job(job.id).await.unwrap(), Some(job));
    assert_eq!(store.profile(&profile.rig, &profile.lens, None).await.unwrap(), Some(profile));
    store.close().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn two_processes_on_one_file_never_claim_the_same_job() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("metadata.sqlite");
    // two stores share nothing but the file, like two processes
    let (one, two) = tokio::join!(SqliteMetadata::open(&path), SqliteMetadata::open(&path));
    let (one, two) = (one.unwrap(), two.unwrap());
    for _ in 0..10 {
        conformance::accept(&one, &conformance::stack()).await;
    }
    let drain = async |store: &SqliteMetadata| {
        let mut claimed = Vec::new();
        while let Some(job) = conformance::claim(store).await {
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
async fn a_full_disk_is_recognised_and_corrupts_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let store = SqliteMetadata::open(folder.path().join("metadata.sqlite")).await.unwrap();
    let first = conformance::accept(&store, &conformance::stack()).await;
    // SQLite reports its page limit like a full disk; this limit is below the size of the file, so it cannot grow
    sqlx::query("PRAGMA max_page_count = 1").execute(&store.writer).await.unwrap();
    let mut full = None;
    for _ in 0..200 {
        if let Err(error) = store.enqueue(&conformance::stack(), 1000).await {
            full = Some(error);
            break;
        }
    }
    assert!(matches!(full, Some(StoreError::DiskFull(_))), "{full:?}");
    assert_eq!(store.job(first.id).await.unwrap(), Some(first));
    sqlx::query("PRAGMA max_page_count = 1000000").execute(&store.writer).await.unwrap();
    conformance::accept(&store, &conformance::stack()).await;
}

#[tokio::test]
async fn a_revision_cannot_be_changed_even_by_sql() {
    let folder = tempfile::tempdir().unwrap();
    let store = SqliteMetadata::open(folder.path().join("metadata.sqlite")).await.unwrap();
    let put = conformance::put(&store, "rig", "lens", 1.5).await;
    assert!(sqlx::query("UPDATE revisions SET body = '{}'").execute(&store.writer).await.is_err());
    assert!(sqlx::query("DELETE FROM revisions").execute(&store.writer).await.is_err());
    assert_eq!(store.profile(&put.rig, &put.lens, None).await.unwrap(), Some(put));
}

#[tokio::test]
async fn an_offset_never_goes_back_even_by_sql() {
    let folder = tempfile::tempdir().unwrap();
    let store = SqliteMetadata::open(folder.path().join("metadata.sqlite")).await.unwrap();
    let id = conformance::uploads::begun(&store, 100).await;
    assert!(store.advance_upload(id, &conformance::uploads::advance(0, 60)).await.unwrap());
    assert!(sqlx::query("UPDATE uploads SET received = 59").execute(&store.writer).await.is_err());
    assert!(sqlx::query("UPDATE uploads SET received = 101").execute(&store.writer).await.is_err());
    assert_eq!(store.upload(id).await.unwrap().unwrap().offset, 60);
}

#[tokio::test]
async fn a_revision_from_before_origins_and_optics_digests_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let store = SqliteMetadata::open(folder.path().join("metadata.sqlite")).await.unwrap();
    let put = conformance::put(&store, "rig", "lens", 1.5).await;
    let mut body = serde_json::to_value(&put).unwrap();
    for name in ["origin", "warnings", "principal_distance_px", "optics_digest"] {
        body.as_object_mut().unwrap().remove(name);
    }
    sqlx::query("INSERT INTO revisions (rig, lens, revision, body) VALUES ('rig', 'lens', 2, ?1)")
        .bind(body.to_string())
        .execute(&store.writer)
        .await
        .unwrap();
    assert_eq!(store.profile(&put.rig, &put.lens, Some(2)).await.unwrap(), Some(put));
}

/// A store with the schema before summaries of revisions, lengths of leases and clock gaps, with a revision and a job.
async fn old_store(path: &Path) -> (Profile, Job) {
    let store = SqliteMetadata::open(path).await.unwrap();
    let profile = conformance::put(&store, "rig", "lens", 1.5).await;
    let job = conformance::accept(&store, &conformance::stack()).await;
    for sql in [
        "DROP INDEX revisions_that_are_there",
        "DROP TRIGGER revision_heads_never_go",
        "DROP TABLE revision_heads",
        "ALTER TABLE jobs DROP COLUMN lease_ms",
        "DROP TABLE clock_seen",
        "DROP TABLE clock_gaps",
        "DELETE FROM _sqlx_migrations WHERE version = 6",
    ] {
        sqlx::query(sql).execute(&store.writer).await.unwrap();
    }
    store.close().await;
    (profile, job)
}

#[tokio::test]
async fn a_store_with_an_older_schema_is_migrated_with_its_content() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("metadata.sqlite");
    let (profile, job) = old_store(&path).await;
    let store = SqliteMetadata::open(&path).await.unwrap();
    assert_eq!(store.profile(&profile.rig, &profile.lens, None).await.unwrap().as_ref(), Some(&profile));
    assert_eq!(store.job(job.id).await.unwrap().as_ref(), Some(&job));
    let heads: i64 = sqlx::query_scalar("SELECT count(*) FROM revision_heads").fetch_one(&store.writer).await.unwrap();
    assert_eq!(heads, 1);
    let listed = store.profiles(None, None, &conformance::page(10, None)).await.unwrap();
    assert_eq!(listed.items, [ProfileSummary::from(&profile)]);
    assert!(sqlx::query("UPDATE revision_heads SET head = '{}'").execute(&store.writer).await.is_err());
    assert_eq!(conformance::claim(&store).await.map(|claimed| claimed.id), Some(job.id));
}

#[tokio::test]
async fn a_clock_that_jumped_while_no_server_ran_expires_nothing_until_it_is_confirmed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("metadata.sqlite");
    let clock = Arc::new(ManualClock::default());
    let store = SqliteMetadata::open_with_clock(&path, clock.clone()).await.unwrap();
    conformance::accept(&store, &conformance::stack_with(|request| request.options.keep_days = Some(1))).await;
    let job = conformance::claim(&store).await.unwrap();
    assert!(store.finish(job.id, job.lease_token, &conformance::success()).await.unwrap());
    assert!(store.delete_expired_jobs(&Retention::default()).await.unwrap().is_empty());
    store.close().await;

    let later = Arc::new(ManualClock::default());
    later.set_wall_by(10 * 24 * 60 * 60 * 1000);
    let store = SqliteMetadata::open_with_clock(&path, later).await.unwrap();
    for _ in 0..2 {
        assert!(store.delete_expired_jobs(&Retention::default()).await.unwrap().is_empty());
    }
    store.confirm_clock().await.unwrap();
    assert_eq!(store.delete_expired_jobs(&Retention::default()).await.unwrap(), [job.id]);
}

#[tokio::test]
async fn a_job_with_an_unreadable_row_is_listed_as_skipped_and_fails_when_it_is_claimed() {
    let folder = tempfile::tempdir().unwrap();
    let store = SqliteMetadata::open(folder.path().join("metadata.sqlite")).await.unwrap();
    let broken = conformance::accept(&store, &conformance::stack()).await;
    let next = conformance::accept(&store, &conformance::stack()).await;
    sqlx::query("UPDATE jobs SET request = json_set(request, '$.layout.width', 'wide') WHERE id = ?1")
        .bind(broken.id)
        .execute(&store.writer)
        .await
        .unwrap();
    let page = store.jobs(&JobFilter::default(), &conformance::page(10, None)).await.unwrap();
    let skipped: Vec<String> = page.skipped.into_iter().map(|row| row.id).collect();
    assert_eq!((page.items, skipped), (vec![next.clone()], vec![broken.id.to_string()]));
    assert_eq!(store.blob_keys(broken.id).await.unwrap(), [broken.request.upload().key.as_str()]);
    assert_eq!(conformance::claim(&store).await.map(|claimed| claimed.id), Some(next.id), "the queue continues");
    let (state, error): (String, String) = sqlx::query_as("SELECT state, error FROM jobs WHERE id = ?1")
        .bind(broken.id)
        .fetch_one(&store.writer)
        .await
        .unwrap();
    assert!(state == "failed" && error.contains("cannot be read any more"), "{state} {error}");
}
