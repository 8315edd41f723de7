//! Backups: of a running service, verified, restored, and interrupted.

use std::{fs, path::Path};

use rustix::process::{Pid, Signal, kill_process};
use tempfile::TempDir;

use crate::{
    service::{LOOK, armed_child, armed_command, command, is_stopped, text},
    story::Story,
};

/// Failpoints of a backup.
pub const STEPS: [&str; 5] = ["backup.folder", "backup.copy", "backup.snapshot", "backup.sync", "backup.rename"];

fn backup(data: &Path, to: &Path) -> String {
    let done = command(data, &["backup", "--to", to.to_str().expect("UTF-8")]);
    assert!(done.status.success(), "{}", text(&done));
    text(&done)
}

fn verified(data: &Path) -> String {
    let done = command(data, &["verify"]);
    assert!(done.status.success(), "{}", text(&done));
    text(&done)
}

async fn with_two_stacks() -> (Story, [String; 2], String) {
    let mut story = Story::begin("").await;
    story.profile().await.expect("a profile");
    let stacks = [story.post("a").await.expect("a stack"), story.post("b").await.expect("a stack")];
    let image = story.image(&stacks[0]).await.expect("an image");
    assert_eq!(story.image(&stacks[1]).await.expect("an image"), image);
    (story, stacks, image)
}

#[tokio::test]
async fn a_backup_of_a_running_service_is_complete_and_can_be_restored_and_served() {
    let (mut story, [first, second], image) = with_two_stacks().await;
    story.begin_upload().await.expect("an upload that is never continued");
    let folder = TempDir::new().expect("a folder");
    let (copy, restored) = (folder.path().join("copy"), folder.path().join("restored"));
    let told = backup(&story.data(), &copy);
    assert!(told.starts_with("2 jobs; 12 files copied"), "{told}");
    assert!(verified(&copy).starts_with("2 jobs, 12 files"));

    // the second backup adds what is new, removes what was deleted, and keeps the rest
    story.delete(&first).await.expect("deleted");
    let third = story.post("c").await.expect("a stack");
    story.image(&third).await.expect("an image");
    let told = backup(&story.data(), &copy);
    assert!(told.starts_with("2 jobs; 6 files copied") && told.contains("6 were there already"), "{told}");
    assert!(verified(&copy).contains("; files of 0 unknown jobs"));

    let done = command(&restored, &["restore", "--from", copy.to_str().expect("UTF-8")]);
    assert!(done.status.success(), "{}", text(&done));
    let again = command(&restored, &["restore", "--from", copy.to_str().expect("UTF-8")]);
    assert!(!again.status.success() && text(&again).contains("has a database"), "{}", text(&again));
    let mut served = Story::on(&restored).await;
    assert_eq!(served.image(&second).await.expect("an image"), image);
    assert_eq!(served.count().await.expect("a list"), 2);
    served.delete(&first).await.expect("it was gone before");
    let fourth = served.post("d").await.expect("a stack");
    assert_eq!(served.image(&fourth).await.expect("an image"), image, "and the service continues to work");
}

/// The rows are read again then. Files that were copied until then are no files of an earlier backup.
#[tokio::test]
async fn a_stack_that_is_deleted_during_a_backup_is_omitted() {
    let (mut story, [_, second], _) = with_two_stacks().await;
    let folder = TempDir::new().expect("a folder");
    let copy = folder.path().join("copy");
    let to = ["backup", "--to", copy.to_str().expect("UTF-8")];
    // at the third of the six files of the first stack
    let backup = armed_child(&story.data(), &to, "backup.copy=2*off->1*return(stop)->off");
    while !is_stopped(&backup) {
        tokio::time::sleep(LOOK).await;
    }
    story.delete(&second).await.expect("deleted");
    kill_process(Pid::from_child(&backup), Signal::CONT).expect("it continues");
    let done = backup.wait_with_output().expect("it ends");
    let told = text(&done);
    assert!(told.contains("1 jobs; 6 files copied") && told.contains("0 were there already"), "{told}");
    assert!(verified(&copy).starts_with("1 jobs, 6 files"));
}

#[tokio::test]
async fn stacks_that_share_a_zip_share_it_in_the_backup() {
    let (mut story, [first, second], image) = with_two_stacks().await;
    let folder = TempDir::new().expect("a folder");
    let copy = folder.path().join("copy");
    backup(&story.data(), &copy);
    // one rerun of a stack that the backup has, one of a stack that is new in it
    let again = story.rerun(&first, "again").await.expect("a stack");
    let third = story.post("c").await.expect("a stack");
    let third_again = story.rerun(&third, "third again").await.expect("a stack");
    for stack in [&again, &third, &third_again] {
        assert_eq!(story.image(stack).await.expect("an image"), image);
    }
    backup(&story.data(), &copy);
    assert!(verified(&copy).starts_with("5 jobs, 30 files"));
    let inode = |stack: &str| {
        use std::os::unix::fs::MetadataExt;
        let id = stack.rsplit('/').next().expect("an id");
        fs::metadata(copy.join(format!("blobs/uploads/{id}.zip"))).expect("a zip").ino()
    };
    assert_eq!((inode(&first), inode(&third)), (inode(&again), inode(&third_again)));
    assert_ne!(inode(&first), inode(&second), "the same bytes, sent twice, are two files");
}

#[tokio::test]
async fn a_backup_killed_at_any_failpoint_leaves_the_earlier_one_complete_and_can_be_repeated() {
    let (mut story, _, _) = with_two_stacks().await;
    let folder = TempDir::new().expect("a folder");
    let copy = folder.path().join("copy");
    let to = ["backup", "--to", copy.to_str().expect("UTF-8")];
    for has_one_before in [false, true] {
        for step in STEPS {
            for fault in ["kill", "full"] {
                let third = story.post(&format!("{has_one_before} {step} {fault}")).await.expect("a stack");
                story.image(&third).await.expect("an image");
                let broken = armed_command(&story.data(), &to, &format!("{step}=return({fault})"));
                assert!(!broken.status.success(), "{step}: {}", text(&broken));
                if has_one_before {
                    verified(&copy);
                } else {
                    assert!(!copy.join("pinstack.sqlite").exists(), "there is no copy yet");
                }
            }
        }
        backup(&story.data(), &copy);
        assert!(verified(&copy).contains("; files of 0 unknown jobs"));
    }
}

#[tokio::test]
async fn a_folder_with_other_content_is_not_used_for_a_backup() {
    let (story, _, _) = with_two_stacks().await;
    let folder = TempDir::new().expect("a folder");
    fs::write(folder.path().join("thesis.tex"), "x").expect("written");
    let done = command(&story.data(), &["backup", "--to", folder.path().to_str().expect("UTF-8")]);
    assert!(!done.status.success() && text(&done).contains("not a backup"), "{}", text(&done));
    // above all not the store itself, or another store
    let data = story.data();
    let onto_itself = command(&data, &["backup", "--to", data.to_str().expect("UTF-8")]);
    assert!(!onto_itself.status.success() && text(&onto_itself).contains("not a backup"), "{}", text(&onto_itself));
    let nowhere = command(&folder.path().join("mistyped"), &["verify"]);
    assert!(!nowhere.status.success() && text(&nowhere).contains("--data-dir"), "{}", text(&nowhere));
}

/// A store of its own from then on: the next backup must not replace what was changed in it.
#[tokio::test]
async fn a_backup_whose_tokens_were_changed_is_not_overwritten() {
    let (story, _, _) = with_two_stacks().await;
    let folder = TempDir::new().expect("a folder");
    let copy = folder.path().join("copy");
    backup(&story.data(), &copy);
    let listed = command(&copy, &["token", "list"]);
    assert!(listed.status.success(), "{}", text(&listed));
    backup(&story.data(), &copy);
    for failing in [&["token", "add", "not a name", "--scope", "read"][..], &["token", "revoke", "ann"]] {
        assert!(!command(&copy, failing).status.success());
    }
    backup(&story.data(), &copy);
    let added = command(&copy, &["token", "add", "ann", "--scope", "read"]);
    assert!(added.status.success(), "{}", text(&added));
    let again = command(&story.data(), &["backup", "--to", copy.to_str().expect("UTF-8")]);
    assert!(!again.status.success() && text(&again).contains("not a backup"), "{}", text(&again));
}

#[tokio::test]
async fn missing_and_changed_files_are_reported() {
    let (story, [first, second], _) = with_two_stacks().await;
    let data = story.data();
    verified(&data);
    let id = |path: &str| path.rsplit('/').next().expect("an id").to_owned();
    let mask = data.join(format!("blobs/results/{}/1/mask.png", id(&first)));
    let mut bytes = fs::read(&mask).expect("a mask");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&mask, bytes).expect("a bit flipped");
    fs::remove_file(data.join(format!("blobs/uploads/{}.zip", id(&second)))).expect("removed");
    let found = command(&data, &["verify"]);
    let said = text(&found);
    assert!(!found.status.success(), "{said}");
    for part in
        [&format!("job {}: mask", id(&first)), "its bytes have changed", &format!("job {}: the upload", id(&second))]
    {
        assert!(said.contains(part), "{part}: {said}");
    }
    let quick = command(&data, &["verify", "--quick"]);
    assert!(!text(&quick).contains("have changed") && text(&quick).contains("is missing"), "{}", text(&quick));
    let copied = command(&data, &["backup", "--to", data.with_extension("copy").to_str().expect("UTF-8")]);
    assert!(!copied.status.success() && text(&copied).contains(&id(&second)), "{}", text(&copied));
}

#[tokio::test]
async fn an_unreadable_row_is_reported_and_does_not_prevent_verify_backup_and_restore() {
    let (mut story, [first, second], image) = with_two_stacks().await;
    let id = first.rsplit('/').next().expect("an id").to_owned();
    let url = format!("sqlite://{}", story.data().join("pinstack.sqlite").display());
    let rows = sqlx::SqlitePool::connect(&url).await.expect("the database");
    // as stored by a version without the check: infinity, which is null in JSON
    for sql in [
        "DROP TRIGGER revisions_never_change",
        "UPDATE revisions SET body = json_set(body, '$.slices[1].shift_px[0]', null)",
        // of the first one
        "UPDATE jobs SET outcome = json_set(outcome, '$.image.width', null) WHERE seq = (SELECT MIN(seq) FROM jobs)",
    ] {
        sqlx::query(sql).execute(&rows).await.expect(sql);
    }
    rows.close().await;
    assert_eq!(story.count().await.expect("a list"), 1, "lists omit it");
    let found = command(&story.data(), &["verify"]);
    let said = text(&found);
    assert!(!found.status.success() && said.starts_with("2 jobs, 6 files"), "{said}");
    for part in [format!("job {id} cannot be read"), "profile rig/lens?revision=1 cannot be read".to_owned()] {
        assert!(said.contains(&part), "{part}: {said}");
    }

    let folder = TempDir::new().expect("a folder");
    let (copy, restored) = (folder.path().join("copy"), folder.path().join("restored"));
    let told = backup(&story.data(), &copy);
    assert!(told.starts_with("2 jobs; 12 files copied") && told.contains("1 jobs cannot be read"), "{told}");
    let done = command(&restored, &["restore", "--from", copy.to_str().expect("UTF-8")]);
    assert!(done.status.success() && text(&done).contains(&id), "{}", text(&done));
    let mut served = Story::on(&restored).await;
    assert_eq!(served.image(&second).await.expect("an image"), image);
    served.delete(&first).await.expect("it can be deleted");
    served.delete("/v1/profiles/rig/lens").await.expect("it can be deleted");
}
