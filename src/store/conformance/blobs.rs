//! Blob stores.

use std::fs;

use futures::TryStreamExt;

use super::*;
use crate::store::{
    SpoolFile,
    blobs::{result_key, results_prefix, upload_key},
    gc::{delete_blobs, delete_stale_results, jobs_with_blobs},
};

/// A spool file with these bytes.
pub fn spool_file(store: &Store, bytes: &[u8]) -> SpoolFile {
    let path = store.workspace.new_path("test").expect("a path");
    fs::write(&path, bytes).expect("the workspace can be written");
    SpoolFile::temporary(path)
}

/// Stores these bytes as a blob.
pub async fn put_blob(store: &Store, key: &str, bytes: &[u8]) {
    store.blobs.put(key, spool_file(store, bytes)).await.expect("stored");
}

/// The bytes of a blob; `None` when it does not exist.
pub async fn bytes_of_blob(store: &Store, key: &str) -> Option<Vec<u8>> {
    let blob = store.blobs.fetch(key, &store.workspace).await.expect("fetched")?;
    Some(fs::read(blob.path()).expect("the file can be read"))
}

/// True when there is such a blob.
pub async fn is_stored(store: &Store, key: &str) -> bool {
    store.blobs.head(key).await.expect("looked up").is_some()
}

pub async fn a_stored_file_is_the_blob_and_leaves_the_workspace(store: Store) {
    let key = upload_key(Uuid::now_v7());
    let file = spool_file(&store, b"zip");
    let path = file.path().to_owned();
    assert_eq!(store.blobs.head(&key).await.unwrap(), None);
    assert_eq!(bytes_of_blob(&store, &key).await, None);
    store.blobs.put(&key, file).await.unwrap();
    assert!(!path.exists());
    let meta = store.blobs.head(&key).await.unwrap().expect("it is stored");
    assert_eq!((meta.key.as_str(), meta.size), (key.as_str(), 3));
    assert_eq!(bytes_of_blob(&store, &key).await.as_deref(), Some(&b"zip"[..]));
    if let Some(capacity) = store.blobs.capacity().await.unwrap() {
        assert!(capacity.free > 0 && capacity.free <= capacity.total);
    }
    store.blobs.probe().await.expect("blobs can be stored");
}

pub async fn a_blob_is_read_by_range(store: Store) {
    let key = upload_key(Uuid::now_v7());
    let bytes: Vec<u8> = (0..300_000_u32).map(|i| (i % 251) as u8).collect();
    put_blob(&store, &key, &bytes).await;
    for range in [0..300_000_u64, 0..1, 131_071..262_145, 299_999..300_000] {
        let stream = store.blobs.read(&key, range.clone()).await.unwrap().expect("it is stored");
        let read: Vec<bytes::Bytes> = stream.try_collect().await.unwrap();
        assert_eq!(read.concat(), bytes[range.start as usize..range.end as usize], "{range:?}");
    }
    let stream = store.blobs.read(&key, 0..300_000).await.unwrap().expect("it is stored");
    store.blobs.delete(&key).await.unwrap();
    let read: Vec<bytes::Bytes> = stream.try_collect().await.unwrap();
    assert_eq!(read.concat().len(), 300_000, "a stream can be read to its end");
    assert!(store.blobs.read(&key, 0..1).await.unwrap().is_none());
}

pub async fn an_open_blob_is_read_by_offset(store: Store) {
    let key = upload_key(Uuid::now_v7());
    let bytes: Vec<u8> = (0..1_300_000_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    assert!(store.blobs.open(&key, &store.workspace).await.unwrap().is_none());
    put_blob(&store, &key, &bytes).await;
    let blob = store.blobs.open(&key, &store.workspace).await.unwrap().expect("it is stored");
    let reader = blob.bytes();
    assert_eq!(reader.length().unwrap(), 1_300_000);
    let read = move || {
        for (at, length) in [(1_299_990, 10), (0, 4), (400_000, 800_000), (524_287, 2)] {
            let mut part = vec![0; length];
            reader.read_exact_at(&mut part, at).unwrap();
            assert!(part == bytes[at as usize..at as usize + length], "{length} bytes at {at}");
        }
        assert!(reader.read_exact_at(&mut [0; 11], 1_299_990).is_err(), "beyond the end");
    };
    tokio::task::spawn_blocking(read).await.unwrap();
    assert!(blob.failure().is_none());
}

pub async fn blobs_are_listed_by_prefix(store: Store) {
    let (first, second) = (Uuid::now_v7(), Uuid::now_v7());
    let keys = [upload_key(first), result_key(first, 1, "a.png"), result_key(first, 2, "b.png"), upload_key(second)];
    for key in &keys {
        put_blob(&store, key, key.as_bytes()).await;
    }
    let listed = async |prefix: &str| {
        let found: Vec<_> = store.blobs.list(prefix).try_collect().await.unwrap();
        for blob in &found {
            assert_eq!(blob.size, blob.key.len() as u64);
        }
        let mut keys: Vec<String> = found.into_iter().map(|blob| blob.key).collect();
        keys.sort();
        keys
    };
    let sorted = |keys: &[&String]| {
        let mut keys: Vec<String> = keys.iter().map(|key| (*key).clone()).collect();
        keys.sort();
        keys
    };
    assert_eq!(listed("").await, sorted(&keys.each_ref()));
    assert_eq!(listed("uploads/").await, sorted(&[&keys[0], &keys[3]]));
    assert_eq!(listed(&results_prefix(first)).await, sorted(&[&keys[1], &keys[2]]));
    assert_eq!(listed(&results_prefix(second)).await, Vec::<String>::new());
    let jobs: Vec<Uuid> = jobs_with_blobs(&*store.blobs).await.unwrap().into_keys().collect();
    assert_eq!(jobs, [first, second]);
}

pub async fn shared_bytes_stay_until_the_last_blob_is_removed(store: Store) {
    let (first, again) = (Uuid::now_v7(), Uuid::now_v7());
    let none = store.blobs.share(&upload_key(first), &store.workspace).await.unwrap();
    assert!(none.is_none(), "there is no such blob");
    put_blob(&store, &upload_key(first), b"shared").await;
    let shared = store.blobs.share(&upload_key(first), &store.workspace).await.unwrap().expect("it is stored");
    let path = shared.path().to_owned();
    assert_eq!(fs::read(&path).unwrap(), b"shared");
    store.blobs.put(&upload_key(again), shared).await.unwrap();
    assert!(!path.exists());
    delete_blobs(&*store.blobs, first).await.unwrap();
    assert!(!is_stored(&store, &upload_key(first)).await);
    assert_eq!(bytes_of_blob(&store, &upload_key(again)).await.as_deref(), Some(&b"shared"[..]));
}

pub async fn a_key_that_leaves_the_store_is_refused(store: Store) {
    for key in ["../x", "/etc/x", "uploads/../../x", "uploads//x", "", "a/.", "a\\b", "results/.hidden"] {
        let file = spool_file(&store, b"x");
        assert!(store.blobs.put(key, file).await.is_err(), "{key}");
        assert!(store.blobs.fetch(key, &store.workspace).await.is_err(), "{key}");
        assert!(store.blobs.delete(key).await.is_err(), "{key}");
    }
    for prefix in ["", "../", "/", "uploads", "uploads/../../x/"] {
        assert!(store.blobs.delete_prefix(prefix).await.is_err(), "{prefix}");
    }
}

pub async fn deleting_a_job_removes_its_blobs_and_no_others(store: Store) {
    let (gone, kept) = (Uuid::now_v7(), Uuid::now_v7());
    for job in [gone, kept] {
        put_blob(&store, &upload_key(job), b"zip").await;
        put_blob(&store, &result_key(job, 1, "image.png"), b"png").await;
    }
    delete_blobs(&*store.blobs, gone).await.unwrap();
    delete_blobs(&*store.blobs, gone).await.unwrap();
    for (job, stored) in [(gone, false), (kept, true)] {
        assert_eq!(is_stored(&store, &upload_key(job)).await, stored);
        assert_eq!(is_stored(&store, &result_key(job, 1, "image.png")).await, stored);
    }
    let listed: Vec<Uuid> = jobs_with_blobs(&*store.blobs).await.unwrap().into_keys().collect();
    assert_eq!(listed, [kept]);
}

pub async fn only_results_of_older_leases_are_stale(store: Store) {
    let job = Uuid::now_v7();
    for lease in [1, 2, 3, 10] {
        put_blob(&store, &result_key(job, lease, "image.png"), b"png").await;
    }
    delete_stale_results(&*store.blobs, job, 3).await.unwrap();
    for (lease, stored) in [(1, false), (2, false), (3, true), (10, true)] {
        assert_eq!(is_stored(&store, &result_key(job, lease, "image.png")).await, stored, "lease {lease}");
    }
    delete_stale_results(&*store.blobs, job, 11).await.unwrap();
    assert!(jobs_with_blobs(&*store.blobs).await.unwrap().is_empty());
    delete_stale_results(&*store.blobs, job, 11).await.unwrap();
}
