//! The conformance suites on local files, and what is specific to them.

use std::{fs, path::Path, sync::Arc};

use tempfile::TempDir;

use super::*;
use crate::store::{BlobStore, ManualClock, Store, blobs::result_key, conformance::FreshStore, open_with_clock};

async fn fresh_store() -> (TempDir, FreshStore) {
    let folder = tempfile::tempdir().expect("a folder");
    let clock = Arc::new(ManualClock::default());
    let store = open_with_clock(folder.path(), clock.clone()).await.expect("a store");
    (folder, FreshStore { store, clock })
}

async fn fresh() -> (TempDir, Store) {
    let (folder, fresh) = fresh_store().await;
    (folder, fresh.store)
}

crate::blob_conformance!(crate::store::local::tests::fresh);
crate::upload_parts_conformance!(crate::store::local::tests::fresh);
crate::gc_conformance!(crate::store::local::tests::fresh_store);

#[test]
#[ignore = "needs a second file system at /dev/shm or /run"]
fn blobs_on_another_file_system_are_refused_with_what_to_do() {
    use std::os::unix::fs::MetadataExt;
    let folder = tempfile::tempdir().expect("a folder");
    let device = |path: &Path| fs::metadata(path).map(|m| m.dev()).ok();
    let elsewhere = [Path::new("/dev/shm"), Path::new("/run")]
        .into_iter()
        .filter(|path| device(path).is_some() && device(path) != device(folder.path()))
        .find_map(|path| tempfile::tempdir_in(path).ok())
        .expect("a second file system at /dev/shm or /run");
    std::os::unix::fs::symlink(elsewhere.path(), folder.path().join("blobs")).expect("a link");
    let refused = open(folder.path()).expect_err("nothing can be renamed into it");
    let message = format!("{:#}", anyhow::Error::from(refused));
    assert!(message.contains("another file system") && message.contains("data folder itself"), "{message}");
}

#[tokio::test]
async fn the_probe_leaves_nothing_behind_and_detects_a_broken_store() {
    let folder = tempfile::tempdir().expect("a folder");
    let (blobs, _parts, workspace) = open(folder.path()).expect("open");
    blobs.probe().await.expect("blobs can be stored");
    let uploads = folder.path().join("blobs/uploads");
    assert_eq!(fs::read_dir(&uploads).expect("a folder").count(), 0);
    assert_eq!(fs::read_dir(workspace.path()).expect("a folder").count(), 0);
    fs::remove_dir(&uploads).expect("empty");
    assert!(blobs.probe().await.is_err());
}

#[tokio::test]
async fn empty_folders_are_removed_and_others_are_kept() {
    let (folder, store) = fresh().await;
    let (empty, used) = (uuid::Uuid::now_v7(), uuid::Uuid::now_v7());
    let results = folder.path().join("blobs/results");
    fs::create_dir_all(results.join(format!("{empty}/1"))).expect("as after a crash before a rename");
    crate::store::conformance::blobs::put_blob(&store, &result_key(used, 1, "image.png"), b"png").await;
    store.blobs.remove_leftovers().await.expect("removed");
    let left: Vec<_> = fs::read_dir(&results).expect("a folder").map(|e| e.expect("an entry").file_name()).collect();
    assert_eq!(left, [used.to_string().as_str()]);
}

#[test]
fn a_start_removes_the_workspaces_of_dead_processes_only() {
    let folder = tempfile::tempdir().expect("a folder");
    let [living, dead] = [(); 2].map(|()| Workspace::open(folder.path()).expect("a workspace"));
    let (kept, left) = (living.path().join("upload"), dead.path().join("upload"));
    fs::write(&kept, "x").expect("written");
    fs::write(&left, "x").expect("written");
    let stray = folder.path().join("spool/stray");
    fs::write(&stray, "x").expect("written");
    drop(dead); // the kernel releases the lock, as it does after a kill
    let newcomer = Workspace::open(folder.path()).expect("a workspace");
    assert!(kept.exists());
    assert!(!left.exists() && !stray.exists());
    assert_ne!(newcomer.path(), living.path());
    assert_eq!(fs::read_dir(folder.path().join("spool")).expect("a folder").count(), 4, "two folders and their locks");
}
