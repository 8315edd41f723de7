//! Space for the database on a disk without a free byte: files beside it, which are given up one by one, so that rows
//! can be deleted and jobs can end there.
//!
//! A transaction appends to the journal of SQLite, also one that deletes. Ordinary writes fail on a full disk; those
//! that free space or end work are repeated with a file of the reserve less. The garbage collection makes the reserve,
//! and it is filled again once there is space. All files together are larger than the journal becomes before SQLite
//! begins it anew (4 MiB), and the pages that it then adds to the database.
//!
//! Whole files, because some file systems free nothing of a file that becomes shorter. Random bytes, because others
//! compress. No byte of them is ever read, so it does not matter where a crash interrupts this.

use std::{
    fs, io,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

use crate::store::{
    StoreError, StoreResult,
    folder::{blocking, make_private},
};

/// Number of files.
const PIECES: usize = 8;
/// Bytes of a file.
const PIECE: u64 = 1 << 20;
/// The reserve is made only if this much stays free besides it.
const BESIDE: u64 = PIECES as u64 * PIECE;

/// The reserve of one database.
#[derive(Debug, Clone)]
pub(super) struct Reserve {
    folder: PathBuf,
    /// This process gave up a part of it.
    is_short: Arc<AtomicBool>,
}

impl Reserve {
    /// The reserve of a database: the folder `reserve` beside it.
    pub(super) fn beside(database: &Path) -> Self {
        Self { folder: database.with_file_name("reserve"), is_short: Arc::default() }
    }

    /// Runs an operation that frees space or ends work. While the disk is full it is repeated with less reserve.
    pub(super) async fn freeing<T, F>(&self, operation: impl Fn() -> F) -> StoreResult<T>
    where
        F: Future<Output = StoreResult<T>>,
    {
        if self.is_short.load(Ordering::Relaxed) {
            self.fill().await;
        }
        loop {
            match operation().await {
                Err(StoreError::DiskFull(_)) if self.give_up_one().await => {}
                result => return result,
            }
        }
    }

    /// Makes what is missing of it, if there is space.
    pub(super) async fn fill(&self) {
        let folder = self.folder.clone();
        match blocking(move || Ok(fill(&folder))).await {
            Ok(Ok(is_whole)) => self.is_short.store(!is_whole, Ordering::Relaxed),
            failed => tracing::warn!(?failed, "the space that is reserved for deletions on a full disk cannot be made"),
        }
    }

    /// Removes a file of it. False when there is none.
    async fn give_up_one(&self) -> bool {
        let folder = self.folder.clone();
        let given_up =
            blocking(move || Ok((0..PIECES).rev().any(|i| fs::remove_file(piece(&folder, i)).is_ok()))).await;
        let given_up = given_up.unwrap_or(false);
        if given_up {
            self.is_short.store(true, Ordering::Relaxed);
            tracing::warn!(bytes = PIECE, "the disk is full: reserved space is given up, to free space or to end work");
        }
        given_up
    }
}

fn piece(folder: &Path, i: usize) -> PathBuf {
    folder.join(i.to_string())
}

/// Makes the missing files. False when there is too little space for them.
fn fill(folder: &Path) -> io::Result<bool> {
    let is_whole = |path: &PathBuf| fs::metadata(path).is_ok_and(|file| file.len() == PIECE);
    let missing: Vec<PathBuf> = (0..PIECES).map(|i| piece(folder, i)).filter(|path| !is_whole(path)).collect();
    if missing.is_empty() {
        return Ok(true);
    }
    let disk = rustix::fs::statvfs(folder.parent().unwrap_or(folder))?;
    if disk.f_bavail.saturating_mul(disk.f_frsize) < missing.len() as u64 * PIECE + BESIDE {
        return Ok(false);
    }
    make_private(folder)?;
    let mut bytes = vec![0; PIECE as usize];
    getrandom::fill(&mut bytes).map_err(|error| io::Error::other(error.to_string()))?;
    for path in missing {
        fs::write(path, &bytes)?;
    }
    Ok(true)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicUsize;

    use super::*;

    /// Fails with a full disk until `left` files are left.
    async fn until_left(reserve: &Reserve, left: usize) -> StoreResult<usize> {
        let calls = AtomicUsize::new(0);
        reserve
            .freeing(|| async {
                let calls = calls.fetch_add(1, Ordering::Relaxed) + 1;
                let files = fs::read_dir(&reserve.folder).map_or(0, Iterator::count);
                if files > left || files == 0 { Err(StoreError::DiskFull("full".into())) } else { Ok(calls) }
            })
            .await
    }

    #[tokio::test]
    async fn as_much_is_given_up_as_an_operation_needs_and_made_again_afterwards() {
        let data = tempfile::tempdir().expect("a folder");
        let reserve = Reserve::beside(&data.path().join("pinstack.sqlite"));
        assert!(until_left(&reserve, 8).await.is_err(), "there is none before it is made");
        reserve.fill().await;
        let bytes: u64 = (0..PIECES).map(|i| fs::metadata(piece(&reserve.folder, i)).expect("made").len()).sum();
        assert_eq!(bytes, 8 << 20);
        assert_eq!(until_left(&reserve, 8).await.expect("it fits"), 1, "nothing is given up without need");
        assert_eq!(until_left(&reserve, 5).await.expect("it fits then"), 4, "three files are given up");
        assert_eq!(until_left(&reserve, 8).await.expect("it fits"), 1, "the reserve is whole again");
        assert!(until_left(&reserve, 0).await.is_err(), "all of it is not enough");
        assert_eq!(fs::read_dir(&reserve.folder).expect("a folder").count(), 0);
    }
}
