//! The workspace: local scratch of one process.
//!
//! It holds uploads while they arrive, the scratch folders of running jobs, and converted images. Every process has a
//! folder of its own, protected by a lock, so that the next process can remove what a dead one left and nothing else.
//! With blobs on local disk it must be on the file system of the blobs, because storing a blob is a rename.

use std::{
    fs::{self, File},
    io,
    path::{Path, PathBuf},
};

use tempfile::TempPath;
use uuid::Uuid;

use super::{
    StoreError, StoreResult,
    failpoint::step,
    folder::{self, blocking, remove},
};

/// Free space of a store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Capacity {
    /// Bytes that can still be written.
    pub free: u64,
    /// Size in bytes.
    pub total: u64,
}

/// The scratch folder of this process, `{data_dir}/spool/{uuid}`.
#[derive(Debug)]
pub struct Workspace {
    path: PathBuf,
    /// Held while this process lives. The kernel releases it however the process ends.
    _lock: File,
}

impl Workspace {
    /// Creates a scratch folder for this process, and removes those of dead processes.
    ///
    /// # Errors
    /// When the folders cannot be created or removed.
    pub fn open(data_dir: &Path) -> io::Result<Self> {
        let folders = data_dir.join("spool");
        step("open.folders")?;
        fs::create_dir_all(&folders)?;
        folder::keep_private(&folders, folder::FOLDER)?;
        // one process at a time, so that none takes a folder that another one is creating for a dead one
        step("spool.gate")?;
        let gate = File::options().create(true).truncate(false).write(true).open(data_dir.join("spool.lock"))?;
        gate.lock()?;
        remove_folders_of_the_dead(&folders)?;
        let name = Uuid::now_v7().to_string();
        step("spool.lock")?;
        let lock = File::options().create_new(true).write(true).open(folders.join(format!("{name}.lock")))?;
        lock.lock()?;
        let path = folders.join(name);
        step("spool.folder")?;
        fs::create_dir(&path)?;
        Ok(Self { path, _lock: lock })
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Path of a new file that does not exist yet. The file is removed when the path is dropped.
    ///
    /// # Errors
    /// When the current folder cannot be determined and the data folder is a relative path.
    pub fn new_path(&self, prefix: &str) -> io::Result<TempPath> {
        TempPath::try_from_path(self.path.join(format!("{prefix}-{}", Uuid::now_v7())))
    }

    /// Free and total bytes of the file system that the workspace is on.
    ///
    /// # Errors
    /// When the file system cannot be queried.
    pub async fn capacity(&self) -> StoreResult<Capacity> {
        disk_capacity(self.path.clone()).await
    }
}

/// Free and total bytes of the file system that `path` is on.
pub(super) async fn disk_capacity(path: PathBuf) -> StoreResult<Capacity> {
    blocking(move || {
        let stat = rustix::fs::statvfs(&path)
            .map_err(|error| StoreError::of_io(error.into(), "cannot determine the free disk space".into()))?;
        let bytes = |blocks: u64| blocks.saturating_mul(stat.f_frsize);
        Ok(Capacity { free: bytes(stat.f_bavail), total: bytes(stat.f_blocks) })
    })
    .await
}

/// Removes everything that does not belong to a lock that a living process holds.
fn remove_folders_of_the_dead(folders: &Path) -> io::Result<()> {
    let mut living = Vec::new();
    for entry in fs::read_dir(folders)? {
        let path = entry?.path();
        // to be locked, a file on NFS must be open for writing
        let is_locked = || io::Result::Ok(File::options().write(true).open(&path)?.try_lock().is_err());
        if path.extension().is_some_and(|e| e == "lock") && is_locked()? {
            living.push(path.with_extension(""));
        }
    }
    for entry in fs::read_dir(folders)? {
        let path = entry?.path();
        if living.contains(&path.with_extension("")) {
            continue;
        }
        remove(&path)?;
    }
    Ok(())
}
