//! A data folder moves to Postgres and back.

use std::path::Path;

use sqlx::{AssertSqlSafe, Connection, Executor, PgConnection};
use tempfile::TempDir;

use crate::{
    service::{armed_command_on, command_on, text},
    story::Story,
    test_server::{in_schema, url},
};

/// Failpoints of moving to Postgres.
pub const STEPS: [&str; 1] = ["restore.commit"];

fn shown(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// A database of its own on the server for tests.
async fn new_database() -> String {
    let server = url();
    let (database, schema) = in_schema(server);
    let mut connection = PgConnection::connect(server).await.expect("the server for tests");
    connection.execute(AssertSqlSafe(format!("CREATE SCHEMA {schema}"))).await.expect("a schema");
    database
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql"]
async fn a_data_folder_moves_to_postgres_and_back() {
    let database = new_database().await;
    let folder = TempDir::new().expect("a folder");
    let (old, new, copy) = (folder.path().join("old"), folder.path().join("new"), folder.path().join("copy"));
    std::fs::create_dir(&old).expect("a folder");
    let mut story = Story::on(&old).await;
    story.profile().await.expect("a profile");
    let first = story.post("a").await.expect("a stack");
    let image = story.image(&first).await.expect("an image");
    let from = ["restore", "--from", shown(&old)];

    // files while the server runs, and the rest when it does not
    let done = command_on(&database, &new, &[&from[..], &["--files-only"]].concat());
    assert!(done.status.success() && text(&done).starts_with("1 jobs; 6 files copied"), "{}", text(&done));
    let second = story.post("b").await.expect("a stack");
    story.image(&second).await.expect("an image");
    story.end_without_looking().await;
    let killed = armed_command_on(&database, &new, &from, "restore.commit=return(kill)");
    assert!(!killed.status.success(), "{}", text(&killed));
    let done = command_on(&database, &new, &from);
    assert!(done.status.success(), "{}", text(&done));
    assert!(text(&done).starts_with("2 jobs; 0 files copied (0 bytes), 12 were there already"), "{}", text(&done));
    let again = command_on(&database, &new, &from);
    assert!(!again.status.success() && text(&again).contains("has rows already"), "{}", text(&again));

    let mut moved = Story::on_database(&new, &database).await;
    assert_eq!(moved.image(&first).await.expect("an image"), image);
    assert_eq!(moved.post("b").await.expect("the same stack"), second, "also the keys of requests have moved");
    let third = moved.post("c").await.expect("a stack");
    assert_eq!(moved.image(&third).await.expect("an image"), image);

    // and back, while it runs
    let done = command_on(&database, &new, &["backup", "--to", shown(&copy)]);
    assert!(done.status.success() && text(&done).starts_with("3 jobs; 18 files copied"), "{}", text(&done));
    moved.end_without_looking().await;
    let mut back = Story::on(&copy).await;
    for stack in [&first, &second, &third] {
        assert_eq!(back.image(stack).await.expect("an image"), image);
    }
    let broke = back.end().await;
    assert!(broke.is_empty(), "{broke:?}");
}
