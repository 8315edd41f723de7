//! A disk that is really full: a small file system of its own. Mounting one needs privileges that root lacks in many
//! containers.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use tempfile::TempDir;

use reqwest::{Client, StatusCode};

use crate::{
    input::profile,
    service::{LOOK, command, text},
    story::Story,
};

/// Large enough for what a small job may write and the space that the service reserves for deletions, not much larger,
/// MiB.
const SIZE: u32 = 64;

/// Free bytes on the full disk: the database can write, a job cannot.
const FOR_ROWS: u64 = 4 << 20;

/// A file system in memory, unmounted when dropped.
pub struct SmallDisk(TempDir);

impl SmallDisk {
    pub fn mount(mib: u32) -> Self {
        let folder = TempDir::new().expect("a folder");
        let mounted = Command::new("mount")
            .args(["-t", "tmpfs", "-o", &format!("size={mib}m"), "tmpfs"])
            .arg(folder.path())
            .output();
        let mounted = mounted.expect("mount can be started");
        assert!(mounted.status.success(), "no file system can be mounted here: {mounted:?}");
        Self(folder)
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }

    pub fn data(&self) -> PathBuf {
        self.0.path().join("data")
    }

    /// Fills it, except for what the database needs: the service keeps `min_free_bytes` for it.
    fn fill(&self) -> Ballast {
        self.fill_except(FOR_ROWS)
    }

    /// Fills it, except for some bytes.
    pub fn fill_except(&self, free: u64) -> Ballast {
        use std::io::Write;
        let path = self.0.path().join(format!("ballast-{}", uuid::Uuid::now_v7()));
        let mut file = fs::File::create(&path).expect("a file");
        while file.write_all(&[1; 4096]).is_ok() {}
        let length = file.metadata().expect("its length").len();
        file.set_len(length.saturating_sub(free)).expect("cut");
        Ballast(path)
    }

    /// Free bytes.
    fn free(&self) -> u64 {
        let disk = rustix::fs::statvfs(self.0.path()).expect("a file system");
        disk.f_bavail * disk.f_frsize
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("--lazy").arg(self.0.path()).status();
    }
}

pub struct Ballast(PathBuf);

impl Ballast {
    pub fn remove(self) {
        fs::remove_file(self.0).expect("removed");
    }
}

fn spooled(data: &Path) -> usize {
    let folders = fs::read_dir(data.join("spool")).expect("the spool");
    let files = folders.filter_map(|entry| fs::read_dir(entry.expect("an entry").path()).ok()).flatten();
    files.count()
}

#[tokio::test]
#[ignore = "needs the right to mount a file system"]
async fn on_a_full_disk_uploads_are_refused_jobs_wait_and_nothing_is_lost() {
    let disk = SmallDisk::mount(SIZE);
    fs::create_dir(disk.data()).expect("a folder");
    let mut serving = Story::on_with(&disk.data(), &["--workers", "0"]).await;
    serving.profile().await.expect("a profile");
    let waiting = serving.post("before").await.expect("there is room");

    let ballast = disk.fill();
    let detail = serving.refused("/v1/stacks?rig=rig&lens=lens", false).await;
    assert!(detail.contains(" are free"), "with figures: {detail}");
    serving.refused("/v1/stacks?rig=rig&lens=lens", true).await;
    assert_eq!(spooled(&disk.data()), 0, "no partial file is left");
    assert_eq!(serving.count().await.expect("reading goes on"), 1);
    serving.end_without_looking().await;

    let mut working = Story::on_with(&disk.data(), &[]).await;
    loop {
        let stack = working.shown(&waiting).await;
        if stack["progress"]["stage"] == "waiting for disk space" {
            break;
        }
        assert!(["queued", "running"].iter().any(|state| stack["state"] == *state), "{stack}");
        tokio::time::sleep(LOOK).await;
    }
    ballast.remove();
    working.image(&waiting).await.expect("an image");
    let after = working.post("after").await.expect("there is room again");
    working.image(&after).await.expect("an image");
    working.end().await;
}

/// Fills the last byte, and stores profiles until one is refused: the database has space of its own at first.
async fn fill_to_the_last_byte(disk: &SmallDisk, client: &Client, url: &str) -> Vec<Ballast> {
    let mut all = Vec::new();
    for i in 0.. {
        all.push(disk.fill_except(0));
        let put = client.put(format!("{url}/v1/profiles/rig/lens-{i}")).json(&profile()).send().await;
        let put = put.expect("an answer");
        if put.status() == StatusCode::INSUFFICIENT_STORAGE {
            break;
        }
        assert_eq!(put.status(), StatusCode::CREATED, "{}", put.text().await.expect("a text"));
    }
    all
}

#[tokio::test]
#[ignore = "needs the right to mount a file system"]
async fn on_a_disk_without_a_free_byte_everything_can_be_deleted_and_all_is_well_afterwards() {
    let disk = SmallDisk::mount(SIZE);
    fs::create_dir(disk.data()).expect("a folder");
    let mut story = Story::on_with(&disk.data(), &[]).await;
    let (client, url) = (Client::builder().no_proxy().build().expect("a client"), story.url().to_owned());
    story.profile().await.expect("a profile");
    let kept = story.post("kept").await.expect("there is room");
    let deleted = story.post("deleted").await.expect("there is room");
    let image = story.image(&kept).await.expect("an image");
    story.image(&deleted).await.expect("an image");
    let upload = story.begin_upload().await.expect("there is room");

    let mut ballast = fill_to_the_last_byte(&disk, &client, &url).await;
    let ready = async || client.get(format!("{url}/readyz")).send().await.expect("an answer").status();
    assert_eq!(ready().await, StatusCode::SERVICE_UNAVAILABLE);
    for path in [deleted.as_str(), upload.as_str(), "/v1/profiles/rig/lens-0"] {
        // each on a disk that is full again: what the one before freed is gone
        ballast.push(disk.fill_except(0));
        let answer = client.delete(format!("{url}{path}")).header("tus-resumable", "1.0.0").send().await;
        let answer = answer.expect("an answer");
        assert!(
            [StatusCode::NO_CONTENT, StatusCode::NOT_FOUND].contains(&answer.status()),
            "{path}: {}",
            answer.text().await.expect("a text")
        );
        // the others have rows alone, of which nothing is left but free pages of the database
        assert!(path != deleted || disk.free() > 0, "the files of the stack are freed");
    }
    ballast.push(disk.fill_except(0));
    let collected = command(&disk.data(), &["gc", "--clock-is-right"]);
    assert!(collected.status.success(), "{}", text(&collected));

    ballast.into_iter().for_each(Ballast::remove);
    while ready().await != StatusCode::OK {
        tokio::time::sleep(LOOK).await;
    }
    let after = story.post("after").await.expect("there is room again");
    assert_eq!(story.image(&after).await.expect("an image"), image);
    assert_eq!(story.image(&kept).await.expect("an image"), image, "what was not deleted is there");
    assert_eq!(story.count().await.expect("a list"), 2);
    story.end().await;
}
