//! The conformance suites on a bucket, and what only a bucket can do wrong.

use std::{fs, sync::Arc};

use tempfile::TempDir;
use uuid::Uuid;

use super::{
    S3Location, S3Url,
    bucket::Bucket,
    open,
    test_server::{self, server},
};
use crate::store::{
    ManualClock, SpoolFile, Store, StoreError,
    blobs::upload_key,
    conformance::{
        FreshStore,
        blobs::{bytes_of_blob, put_blob, spool_file},
    },
    open_with_clock,
};

/// A location in a bucket of its own.
fn location(prefix: &str) -> (TempDir, S3Location) {
    let server = server();
    let folder = tempfile::tempdir().expect("a folder");
    let credentials = folder.path().join("credentials");
    fs::write(&credentials, test_server::credentials()).expect("a file");
    let location = S3Location {
        url: S3Url::new(format!("s3://{}{prefix}", server.bucket())),
        endpoint: Some(server.endpoint.clone()),
        region: None,
        ca_file: None,
        credentials_file: std::env::var("AWS_ACCESS_KEY_ID").is_err().then_some(credentials),
    };
    (folder, location)
}

async fn fresh_store() -> (TempDir, FreshStore) {
    let (folder, location) = location("/lab/scans");
    let clock = Arc::new(ManualClock::default());
    let local = open_with_clock(folder.path(), clock.clone()).await.expect("a store");
    let (blobs, parts) = open(&location, Uuid::now_v7()).await.expect("a bucket");
    let store = Store { blobs: Arc::new(blobs), parts: Arc::new(parts), ..local };
    (folder, FreshStore { store, clock })
}

async fn fresh() -> (TempDir, Store) {
    let (folder, fresh) = fresh_store().await;
    (folder, fresh.store)
}

crate::blob_conformance!(crate::store::s3::tests::fresh, "needs moto, curl");
crate::upload_parts_conformance!(crate::store::s3::tests::fresh, "needs moto, curl");
crate::gc_conformance!(crate::store::s3::tests::fresh_store, "needs moto, curl");

#[tokio::test]
#[ignore = "needs moto, curl"]
async fn an_upload_of_several_requests_becomes_a_blob_within_the_bucket() {
    let (_guard, store) = fresh().await;
    let bytes: Vec<u8> = (0..31_000_001_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    let (id, key) = (Uuid::now_v7(), upload_key(Uuid::now_v7()));
    let mut upload = store.parts.lock(id).await.unwrap().expect("it is free");
    // requests that were cut off after few bytes, or whose last bytes were never recorded
    let requests = [(0, 17_000_000), (16_900_000, 17_100_000), (17_100_000, 17_100_003), (17_000_002, 31_000_001)];
    for (generation, (from, to)) in (1..).zip(requests) {
        assert!(upload.resume_at(from as u64, generation).await.unwrap());
        for piece in bytes[from..to].chunks(100_000) {
            upload.append(bytes::Bytes::copy_from_slice(piece)).await.unwrap();
        }
        upload.sync().await.unwrap();
    }
    assert!(upload.become_blob(31_000_001, &key).await.unwrap());
    assert!(bytes_of_blob(&store, &key).await.expect("it is stored") == bytes);
    // once more, as after a crash
    assert!(upload.become_blob(31_000_001, &key).await.unwrap());
    drop(upload);
    store.parts.remove(id).await.unwrap();
    assert!(bytes_of_blob(&store, &key).await.expect("it is a blob of its own") == bytes);
}

#[tokio::test]
#[ignore = "needs moto, curl"]
async fn a_large_file_is_stored_in_parts_and_comes_back() {
    let (_guard, store) = fresh().await;
    let bytes: Vec<u8> = (0..21_000_001_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    let key = upload_key(Uuid::now_v7());
    put_blob(&store, &key, &bytes).await;
    assert_eq!(store.blobs.head(&key).await.unwrap().expect("it is stored").size, 21_000_001);
    assert!(bytes_of_blob(&store, &key).await.expect("it is stored") == bytes);
}

#[tokio::test]
#[ignore = "needs moto, curl"]
async fn a_bucket_that_sends_too_few_bytes_is_unavailable() {
    let (folder, location) = location("");
    let bucket = Bucket::connect(&location).expect("a bucket");
    let (key, path) = (upload_key(Uuid::now_v7()), folder.path().join("copy"));
    bucket.put(&key, "zip".into()).await.unwrap();
    assert!(bucket.download(vec![(key.clone(), 0..3)], &path).await.unwrap());
    assert_eq!(fs::read(&path).unwrap(), b"zip");
    let refused = bucket.download(vec![(key, 0..4)], &path).await.expect_err("it has three bytes");
    assert!(matches!(refused, StoreError::Unavailable(_)), "{refused}");
    assert!(refused.to_string().contains("sent 3 bytes of a file where it has 4"), "{refused}");
}

#[tokio::test]
#[ignore = "needs moto, curl"]
async fn a_bucket_belongs_to_the_first_database_that_opens_it() {
    let (_guard, location) = location("");
    let ours = Uuid::now_v7();
    open(&location, ours).await.expect("it is free");
    open(&location, ours).await.expect("it is ours");
    let refused = open(&location, Uuid::now_v7()).await.err().expect("it is not theirs").to_string();
    assert!(refused.contains("belongs to another database"), "{refused}");
    let beside = S3Location { url: S3Url::new(format!("{}/beside", location.url)), ..location };
    open(&beside, Uuid::now_v7()).await.expect("another prefix is free");
}

#[tokio::test]
#[ignore = "needs moto, curl"]
async fn a_bucket_that_does_not_exist_or_answer_is_unavailable() {
    let (_guard, location) = location("");
    let missing = S3Location { url: S3Url::new("s3://there-is-none"), ..location.clone() };
    assert!(matches!(open(&missing, Uuid::now_v7()).await, Err(StoreError::Unavailable(_))));
    let wrong = S3Location { endpoint: Some("ftp://example".into()), ..location };
    let refused = open(&wrong, Uuid::now_v7()).await.err().expect("no such scheme").to_string();
    assert!(refused.contains("storage_endpoint must begin with"), "{refused}");
}

#[tokio::test]
#[ignore = "needs moto, curl"]
async fn a_rerun_copies_its_zip_within_the_bucket_even_if_the_first_one_is_removed_meanwhile() {
    let (_guard, store) = fresh().await;
    let (first, again, late) = (upload_key(Uuid::now_v7()), upload_key(Uuid::now_v7()), upload_key(Uuid::now_v7()));
    put_blob(&store, &first, b"zip").await;
    let shared = async || store.blobs.share(&first, &store.workspace).await.unwrap().expect("it is stored");
    let (one, other) = (shared().await, shared().await);
    assert_eq!(one.origin(), Some(first.as_str()));
    store.blobs.put(&again, one).await.unwrap();
    store.blobs.delete(&first).await.unwrap();
    store.blobs.put(&late, other).await.unwrap();
    for key in [&again, &late] {
        assert_eq!(bytes_of_blob(&store, key).await.as_deref(), Some(&b"zip"[..]), "{key}");
    }
}

#[tokio::test]
#[ignore = "needs moto, curl"]
async fn two_processes_that_write_one_upload_do_not_mix_their_bytes() {
    let (_guard, location) = location("");
    let owner = Uuid::now_v7();
    let (_, one) = open(&location, owner).await.unwrap();
    let (_, other) = open(&location, owner).await.unwrap();
    use crate::store::UploadParts;
    let id = Uuid::now_v7();
    let mut older = one.lock(id).await.unwrap().expect("it is free");
    assert!(older.resume_at(0, 1).await.unwrap());
    older.append("0123".into()).await.unwrap();
    older.sync().await.unwrap();
    // the other process takes the upload over, and the first one does not know yet
    let mut newer = other.lock(id).await.unwrap().expect("no process locks it for another");
    assert!(!newer.is_exclusive());
    assert!(newer.resume_at(4, 2).await.unwrap());
    newer.append("abcdef".into()).await.unwrap();
    older.append("45".into()).await.unwrap();
    newer.sync().await.unwrap();
    older.sync().await.unwrap();
    let (_folder, store) = fresh().await;
    let whole = newer.assemble(10, &store.workspace).await.unwrap().expect("it is whole");
    assert_eq!(fs::read(whole.path()).unwrap(), b"0123abcdef");
    assert!(newer.assemble(11, &store.workspace).await.unwrap().is_none());
}

#[tokio::test]
#[ignore = "needs moto, curl"]
async fn a_put_that_the_bucket_did_not_keep_is_an_error() {
    let (_guard, store) = fresh().await;
    let file = spool_file(&store, b"zip");
    let path = file.path().to_owned();
    // the object is there, and has another size than the bucket acknowledged
    let key = upload_key(Uuid::now_v7());
    put_blob(&store, &key, b"other bytes").await;
    let shorter = SpoolFile::copy_of(store.workspace.new_path("x").unwrap(), &key);
    fs::write(shorter.path(), b"zip").unwrap();
    let refused = store.blobs.put(&upload_key(Uuid::now_v7()), shorter).await.expect_err("the sizes differ");
    assert!(matches!(refused, StoreError::Unavailable(_)), "{refused}");
    assert!(path.exists(), "the file of a put that failed stays");
    drop(file);
}
