//! What a backup checks before it copies anything.

use sqlx::{Connection, SqliteConnection, sqlite::SqliteConnectOptions};

use super::*;
use crate::store::{
    blobs::upload_key,
    conformance::{self, accept, blobs::put_blob, stack_with},
};

#[tokio::test]
async fn an_earlier_backup_that_cannot_be_migrated_is_refused_before_anything_is_copied() {
    let (data, folder) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    let to = folder.path().join("copy");
    let store = open(data.path()).await.expect("a store");
    copy(&store, &to).await.expect("a first backup");
    copy(&store, &to).await.expect("a second one in its place");
    // as a program from before the first release left it
    let options = SqliteConnectOptions::new().filename(to.join(DATABASE));
    let mut database = SqliteConnection::connect_with(&options).await.expect("the database of the backup");
    let older = sqlx::query(
        "UPDATE _sqlx_migrations SET version = 1 WHERE version = (SELECT min(version) FROM _sqlx_migrations)",
    )
    .execute(&mut database);
    assert_eq!(older.await.expect("an older schema").rows_affected(), 1);
    database.close().await.expect("closed");
    conformance::put(&*store.metadata, "rig", "lens", 1.5).await;
    let key = upload_key(Uuid::now_v7());
    put_blob(&store, &key, b"zip").await;
    accept(&*store.metadata, &stack_with(|request| request.upload.key.clone_from(&key))).await;

    let refused = copy(&store, &to).await.expect_err("it cannot be replaced").to_string();
    assert!(refused.contains("before the first release"), "{refused}");
    assert!(!to.join("blobs").join(&key).exists(), "no file was copied");
    assert!(!to.join(format!("{DATABASE}.new")).exists(), "nor the rows");
}

#[tokio::test]
async fn a_backup_is_the_same_service() {
    let (data, folder) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    let to = folder.path().join("copy");
    let store = open(data.path()).await.expect("a store");
    copy(&store, &to).await.expect("a backup");
    let restored = open(&to).await.expect("a copy is a data folder");
    let id = store.metadata.service_id().await.expect("an identity");
    assert_eq!(restored.metadata.service_id().await.expect("an identity"), id);
    let other = tempfile::tempdir().expect("a folder");
    let other = open(other.path()).await.expect("a store");
    assert_ne!(other.metadata.service_id().await.expect("an identity"), id);
}
