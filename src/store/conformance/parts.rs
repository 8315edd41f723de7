//! Bytes of resumable uploads.

use super::{blobs::bytes_of_blob, *};
use crate::store::blobs::upload_key;

pub async fn an_upload_is_locked_by_one_request_at_a_time(store: Store) {
    let parts = &store.parts;
    let (id, other) = (Uuid::now_v7(), Uuid::now_v7());
    let locked = parts.lock(id).await.unwrap().expect("it is free");
    assert!(parts.lock(id).await.unwrap().is_none());
    assert!(parts.lock(other).await.unwrap().is_some(), "another upload is free");
    drop(locked);
    assert!(parts.lock(id).await.unwrap().is_some(), "it is free again");
}

pub async fn uploads_with_bytes_are_listed_until_they_are_removed(store: Store) {
    let parts = &store.parts;
    let (id, other) = (Uuid::now_v7(), Uuid::now_v7());
    for id in [id, other] {
        let mut upload = parts.lock(id).await.unwrap().expect("it is free");
        assert!(upload.resume_at(0, 1).await.unwrap());
        upload.append("0123".into()).await.unwrap();
        upload.sync().await.unwrap();
    }
    let mut listed = parts.list().await.unwrap();
    listed.sort();
    assert_eq!(listed, [id, other]);
    parts.remove(id).await.unwrap();
    parts.remove(id).await.unwrap();
    assert_eq!(parts.list().await.unwrap(), [other]);
    let mut removed = parts.lock(id).await.unwrap().expect("it is free");
    assert_eq!(removed.length().await.unwrap(), 0);
    assert!(removed.assemble(4, &store.workspace).await.unwrap().is_none());
}

pub async fn bytes_after_the_offset_are_discarded_and_missing_bytes_are_reported(store: Store) {
    let id = Uuid::now_v7();
    let mut upload = store.parts.lock(id).await.unwrap().expect("it is free");
    assert_eq!(upload.length().await.unwrap(), 0);
    assert!(upload.append("x".into()).await.is_err(), "no offset is set");
    assert!(!upload.resume_at(4, 1).await.unwrap(), "there are no 4 bytes");
    assert!(upload.resume_at(0, 1).await.unwrap());
    for piece in ["0123", "4567"] {
        upload.append(piece.into()).await.unwrap();
    }
    upload.sync().await.unwrap();
    assert_eq!(upload.length().await.unwrap(), 8);
    assert!(!upload.resume_at(9, 2).await.unwrap(), "there are 8 bytes");
    assert!(upload.resume_at(6, 2).await.unwrap());
    upload.append("ab".into()).await.unwrap();
    upload.sync().await.unwrap();
    assert!(upload.assemble(9, &store.workspace).await.unwrap().is_none(), "there are 8 bytes");
    let key = upload_key(Uuid::now_v7());
    assert!(!upload.become_blob(9, &key).await.unwrap(), "there are 8 bytes");
    // the parts stay, so the file can still be made
    if upload.become_blob(7, &key).await.unwrap() {
        assert_eq!(bytes_of_blob(&store, &key).await.as_deref(), Some(&b"012345a"[..]));
    }
    let file = upload.assemble(7, &store.workspace).await.unwrap().expect("there are 8 bytes");
    assert_eq!(std::fs::read(file.path()).unwrap(), b"012345a");
    store.blobs.put(&upload_key(id), file).await.unwrap();
    assert_eq!(bytes_of_blob(&store, &upload_key(id)).await.as_deref(), Some(&b"012345a"[..]));
    drop(upload);
    store.parts.remove(id).await.unwrap();
    assert_eq!(bytes_of_blob(&store, &upload_key(id)).await.as_deref(), Some(&b"012345a"[..]), "it is a blob now");
}
