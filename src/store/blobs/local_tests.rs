//! The conformance suite on local files, and what local files alone must do.

use std::sync::Arc;

use tempfile::TempDir;

use super::*;
use crate::store::{
    ManualClock,
    conformance::{Fresh, blobs as suite},
    sqlite::SqliteRows,
};

fn fresh() -> (TempDir, LocalBlobs) {
    let folder = tempfile::tempdir().expect("a folder for the test");
    let blobs = LocalBlobs::open(folder.path()).expect("open");
    (folder, blobs)
}

async fn fresh_rows(folder: &TempDir) -> Fresh {
    let clock = Arc::new(ManualClock::default());
    let rows = SqliteRows::open_with_clock(folder.path().join("rows.db"), clock.clone()).await.expect("open");
    Fresh { rows: Arc::new(rows), clock }
}

macro_rules! conforms {
    ($($case:ident),+ $(,)?) => { $(
        #[tokio::test]
        async fn $case() {
            let (_folder, blobs) = fresh();
            suite::$case(&blobs).await;
        }
    )+ };
}

conforms!(
    a_published_file_is_the_blob_and_leaves_the_spool,
    a_shared_blob_stays_until_the_last_of_its_jobs_is_deleted,
    no_key_leads_out_of_the_store,
    deleting_a_job_removes_its_blobs_and_no_others,
    only_results_of_older_leases_are_stale,
    an_upload_in_pieces_is_held_by_one_at_a_time,
    what_lies_behind_the_offset_goes_and_what_is_missing_is_told,
);

#[tokio::test]
async fn the_sweep_keeps_what_a_row_names_and_removes_the_rest() {
    let (folder, blobs) = fresh();
    suite::the_sweep_keeps_what_a_row_names_and_removes_the_rest(fresh_rows(&folder).await, &blobs).await;
}

#[tokio::test]
async fn the_blobs_of_expired_and_deleted_jobs_go() {
    let (folder, blobs) = fresh();
    suite::the_blobs_of_expired_and_deleted_jobs_go(fresh_rows(&folder).await, &blobs).await;
}

#[tokio::test]
async fn what_is_over_its_time_goes_by_its_class() {
    let (folder, blobs) = fresh();
    suite::what_is_over_its_time_goes_by_its_class(fresh_rows(&folder).await, &blobs).await;
}

#[test]
fn a_start_removes_the_spool_of_the_dead_and_not_that_of_the_living() {
    let (folder, living) = fresh();
    let dead = LocalBlobs::open(folder.path()).unwrap();
    let (kept, left) = (living.spool_dir().join("upload"), dead.spool_dir().join("upload"));
    fs::write(&kept, "x").unwrap();
    fs::write(&left, "x").unwrap();
    let stray = folder.path().join("spool/stray");
    fs::write(&stray, "x").unwrap();
    drop(dead); // the kernel lets go of the lock, as it does after a kill
    let newcomer = LocalBlobs::open(folder.path()).unwrap();
    assert!(kept.exists());
    assert!(!left.exists() && !stray.exists());
    assert_ne!(newcomer.spool_dir(), living.spool_dir());
    assert_eq!(fs::read_dir(folder.path().join("spool")).unwrap().count(), 4, "two folders and their locks");
}
