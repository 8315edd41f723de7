//! The conformance suite on local files, and what local files alone must do.

use std::sync::Arc;

use tempfile::TempDir;

use super::*;
use crate::store::{
    ManualClock,
    conformance::{Fresh, blobs as suite},
    sqlite::SqliteMetadata,
};

fn fresh() -> (TempDir, LocalBlobs) {
    let folder = tempfile::tempdir().expect("a folder for the test");
    let blobs = LocalBlobs::open(folder.path()).expect("open");
    (folder, blobs)
}

async fn fresh_rows(folder: &TempDir) -> Fresh {
    let clock = Arc::new(ManualClock::default());
    let rows = SqliteMetadata::open_with_clock(folder.path().join("rows.db"), clock.clone()).await.expect("open");
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
fn blobs_on_another_file_system_are_refused_with_what_to_do() {
    use std::os::unix::fs::MetadataExt;
    let folder = tempfile::tempdir().expect("a folder");
    let device = |path: &Path| fs::metadata(path).map(|m| m.dev()).ok();
    let Some(elsewhere) = [Path::new("/dev/shm"), Path::new("/run")]
        .into_iter()
        .filter(|path| device(path).is_some() && device(path) != device(folder.path()))
        .find_map(|path| tempfile::tempdir_in(path).ok())
    else {
        return eprintln!("skipped: there is one file system alone");
    };
    std::os::unix::fs::symlink(elsewhere.path(), folder.path().join("blobs")).expect("a link");
    let refused = LocalBlobs::open(folder.path()).expect_err("nothing can be moved there");
    let told = format!("{:#}", anyhow::Error::from(refused));
    assert!(told.contains("another file system") && told.contains("data folder itself"), "{told}");
}

#[tokio::test]
async fn the_probe_leaves_nothing_behind_and_finds_what_is_broken() {
    let (folder, blobs) = fresh();
    blobs.probe().await.expect("sound");
    let uploads = folder.path().join("blobs/uploads");
    assert_eq!(fs::read_dir(&uploads).expect("a folder").count(), 0);
    assert_eq!(fs::read_dir(blobs.spool_dir()).expect("a folder").count(), 0);
    fs::remove_dir(&uploads).expect("empty");
    assert!(blobs.probe().await.is_err());
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
