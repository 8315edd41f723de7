//! A disk that is really full: a small file system of its own. Mounting one needs privileges that root lacks in many
//! containers.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use tempfile::TempDir;

use crate::{service::LOOK, story::Story};

/// Large enough for what a small job may write, and no larger.
const SIZE: &str = "size=48m";

/// Free bytes on the full disk: the database can write, a job cannot.
const FOR_ROWS: u64 = 4 << 20;

/// A file system in memory, unmounted when dropped.
struct SmallDisk(TempDir);

impl SmallDisk {
    fn mount() -> Self {
        let folder = TempDir::new().expect("a folder");
        let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", SIZE, "tmpfs"]).arg(folder.path()).output();
        let mounted = mounted.expect("mount can be started");
        assert!(mounted.status.success(), "no file system can be mounted here: {mounted:?}");
        Self(folder)
    }

    fn data(&self) -> PathBuf {
        self.0.path().join("data")
    }

    /// Fills it, except for what the database needs: the service keeps `min_free_bytes` for it.
    fn fill(&self) -> Ballast {
        use std::io::Write;
        let path = self.0.path().join("ballast");
        let mut file = fs::File::create(&path).expect("a file");
        while file.write_all(&[1; 4096]).is_ok() {}
        let length = file.metadata().expect("its length").len();
        file.set_len(length - FOR_ROWS).expect("cut");
        Ballast(path)
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("--lazy").arg(self.0.path()).status();
    }
}

struct Ballast(PathBuf);

impl Ballast {
    fn remove(self) {
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
    let disk = SmallDisk::mount();
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
