//! Blobs as files in a folder: `{data_dir}/blobs/{key}`, and the spool beside them on the same file system, so that
//! publishing is a rename.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    io,
    path::{Path, PathBuf},
    time::{Duration, SystemTime},
};

use anyhow::{Context, anyhow};
use async_trait::async_trait;
use uuid::Uuid;

use super::{
    Blobs, JobBlobs, Partial, Room,
    partial::{self, LocalPartial},
    probe,
};
use crate::store::{StoreError, StoreResult, failpoint::step, folder};

/// Folder of the uploads, one file per job.
const UPLOADS: &str = "uploads";
/// Folder of the uploads that arrive in pieces, one file and its lock per upload.
const PARTIALS: &str = "partial";
/// Folder of the results, one folder per job and in it one per lease.
const RESULTS: &str = "results";

/// Blobs in a folder of this machine.
#[derive(Debug)]
pub struct LocalBlobs {
    root: PathBuf,
    spool: PathBuf,
    partials: PathBuf,
    /// Held while this process lives; the kernel lets go of it however the process ends.
    _spool_lock: File,
}

impl LocalBlobs {
    /// Opens (or makes) the folders below `data_dir`, takes a spool folder of its own, and removes the spool folders
    /// that dead processes left. Those of living processes stay.
    ///
    /// # Errors
    /// When the folders cannot be made or written.
    pub fn open(data_dir: impl AsRef<Path>) -> StoreResult<Self> {
        let data_dir = data_dir.as_ref();
        let opened = Self::open_folders(data_dir);
        opened.map_err(|error| StoreError::of_io(error, format!("cannot use the folder {}", data_dir.display())))
    }

    fn open_folders(data_dir: &Path) -> io::Result<Self> {
        let root = data_dir.join("blobs");
        let spools = data_dir.join("spool");
        let partials = data_dir.join(PARTIALS);
        folder::make(data_dir)?;
        for folder in [&root, &root.join(UPLOADS), &root.join(RESULTS), &spools, &partials] {
            step("open.folders")?;
            fs::create_dir_all(folder)?;
            folder::keep_private(folder, folder::FOLDER)?;
        }
        for folder in [&root, data_dir] {
            sync_folder(folder)?;
        }
        // One process at a time looks and makes, so that nobody takes a folder in the making for a dead one.
        step("spool.gate")?;
        let gate = File::options().create(true).truncate(false).write(true).open(data_dir.join("spool.lock"))?;
        gate.lock()?;
        remove_dead_spools(&spools)?;
        let name = Uuid::now_v7().to_string();
        step("spool.lock")?;
        let spool_lock = File::options().create_new(true).write(true).open(spools.join(format!("{name}.lock")))?;
        spool_lock.lock()?;
        let spool = spools.join(name);
        step("spool.folder")?;
        fs::create_dir(&spool)?;
        let blobs = Self { root, spool, partials, _spool_lock: spool_lock };
        blobs.require_one_file_system()?;
        Ok(blobs)
    }

    /// Refuses folders between which nothing can be moved.
    fn require_one_file_system(&self) -> io::Result<()> {
        let (uploads, results) = (self.root.join(UPLOADS), self.root.join(RESULTS));
        probe::same_file_system(&self.spool, &[&self.partials, &uploads, &results])?;
        // two mounts of one file system look like one, but nothing can be moved between them; a full disk is no reason not to
        // serve what is there
        match probe::probe(&self.spool, &[&uploads, &results]) {
            Err(error) if error.kind() == io::ErrorKind::CrossesDevices => Err(error),
            _ => Ok(()),
        }
    }

    /// Where a key lies. Keys are made by us; one that could leave the folder is refused all the same.
    fn path_of(&self, key: &str) -> StoreResult<PathBuf> {
        let safe = |part: &str| {
            !part.is_empty()
                && !part.starts_with('.')
                && part.bytes().all(|b| b.is_ascii_alphanumeric() || b"._-".contains(&b))
        };
        if !key.split('/').all(safe) {
            return Err(StoreError::Other(anyhow!("'{key}' is no key of a blob")));
        }
        Ok(self.root.join(key))
    }
}

/// Removes everything in the spool that no living process holds the lock of.
fn remove_dead_spools(spools: &Path) -> io::Result<()> {
    let mut living = Vec::new();
    for entry in fs::read_dir(spools)? {
        let path = entry?.path();
        if path.extension().is_some_and(|e| e == "lock") && File::open(&path)?.try_lock().is_err() {
            living.push(path.with_extension(""));
        }
    }
    for entry in fs::read_dir(spools)? {
        let path = entry?.path();
        if living.contains(&path.with_extension("")) {
            continue;
        }
        remove(&path)?;
    }
    Ok(())
}

/// Removes a file or a folder with all in it; one that is gone already is fine.
pub(in crate::store) fn remove(path: &Path) -> io::Result<()> {
    step("remove")?;
    let removed = match fs::symlink_metadata(path) {
        Ok(metadata) if metadata.is_dir() => fs::remove_dir_all(path),
        Ok(_) => fs::remove_file(path),
        Err(error) => Err(error),
    };
    match removed {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        other => other,
    }
}

/// Makes the names in a folder durable.
pub(in crate::store) fn sync_folder(folder: &Path) -> io::Result<()> {
    step("folder.sync")?;
    File::open(folder)?.sync_all()
}

/// fsync file, make the folders, rename, fsync every folder up to the root: on return a crash loses nothing.
fn publish(from: &Path, to: &Path, root: &Path) -> io::Result<()> {
    step("publish.sync")?;
    // opened for writing: some file systems refuse to sync a file that is open for reading alone
    File::options().write(true).open(from)?.sync_all()?;
    let folder = to.parent().unwrap_or(root);
    make_and_rename(from, to, folder).or_else(|error| match error.kind() {
        // the clean-up removed the folder while it was still empty
        io::ErrorKind::NotFound => make_and_rename(from, to, folder),
        _ => Err(error),
    })?;
    for folder in folder.ancestors().take_while(|folder| folder.starts_with(root)) {
        sync_folder(folder)?;
    }
    Ok(())
}

/// A second name for the same bytes. File systems that have no hard links (exFAT, some network shares) get a copy.
fn share(from: &Path, to: &Path) -> io::Result<()> {
    step("share.link")?;
    match fs::hard_link(from, to) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => fs::copy(from, to).map(drop),
        linked => linked,
    }
}

fn make_and_rename(from: &Path, to: &Path, folder: &Path) -> io::Result<()> {
    step("publish.folders")?;
    fs::create_dir_all(folder)?;
    step("publish.rename")?;
    fs::rename(from, to)
}

/// Runs file work off the async threads.
pub(super) async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> StoreResult<T> + Send + 'static,
) -> StoreResult<T> {
    tokio::task::spawn_blocking(work).await.context("a file task died")?
}

#[async_trait]
impl Blobs for LocalBlobs {
    fn spool_dir(&self) -> &Path {
        &self.spool
    }

    async fn publish(&self, path: &Path, key: &str) -> StoreResult<()> {
        let to = self.path_of(key)?;
        let (from, root, key) = (path.to_owned(), self.root.clone(), key.to_owned());
        blocking(move || publish(&from, &to, &root).map_err(|e| StoreError::of_io(e, format!("cannot publish {key}"))))
            .await
    }

    async fn share(&self, key: &str, path: &Path) -> StoreResult<bool> {
        let (from, to, key) = (self.path_of(key)?, path.to_owned(), key.to_owned());
        blocking(move || match share(&from, &to) {
            Ok(()) => Ok(true),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
            Err(error) => Err(StoreError::of_io(error, format!("cannot share {key}"))),
        })
        .await
    }

    async fn local_path(&self, key: &str) -> StoreResult<Option<PathBuf>> {
        let path = self.path_of(key)?;
        blocking(move || match fs::metadata(&path) {
            Ok(metadata) if metadata.is_file() => Ok(Some(path)),
            Ok(_) => Ok(None),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(StoreError::of_io(error, "cannot look for a blob".into())),
        })
        .await
    }

    async fn delete_job(&self, id: Uuid) -> StoreResult<()> {
        let upload = self.path_of(&super::upload_key(id))?;
        let results = self.root.join(RESULTS).join(id.to_string());
        blocking(move || {
            let removed = remove(&results).and_then(|()| remove(&upload));
            removed.map_err(|e| StoreError::of_io(e, format!("cannot remove the blobs of job {id}")))
        })
        .await
    }

    async fn delete_upload(&self, id: Uuid) -> StoreResult<()> {
        let upload = self.path_of(&super::upload_key(id))?;
        blocking(move || {
            remove(&upload).map_err(|e| StoreError::of_io(e, format!("cannot remove the upload of job {id}")))
        })
        .await
    }

    async fn delete_stale_results(&self, id: Uuid, first_kept: i64) -> StoreResult<()> {
        let results = self.root.join(RESULTS).join(id.to_string());
        blocking(move || {
            let removed = remove_leases_before(&results, first_kept);
            removed.map_err(|e| StoreError::of_io(e, format!("cannot remove old results of job {id}")))
        })
        .await
    }

    async fn jobs_with_blobs(&self) -> StoreResult<Vec<JobBlobs>> {
        let root = self.root.clone();
        blocking(move || jobs_below(&root).map_err(|e| StoreError::of_io(e, "cannot list the blobs".into()))).await
    }

    async fn room(&self) -> StoreResult<Room> {
        let root = self.root.clone();
        blocking(move || {
            let stat = rustix::fs::statvfs(&root)
                .map_err(|e| StoreError::of_io(e.into(), "cannot ask for disk room".into()))?;
            let bytes = |blocks: u64| blocks.saturating_mul(stat.f_frsize);
            Ok(Room { free: bytes(stat.f_bavail), total: bytes(stat.f_blocks) })
        })
        .await
    }

    async fn probe(&self) -> StoreResult<()> {
        let (spool, root) = (self.spool.clone(), self.root.clone());
        blocking(move || {
            probe::probe(&spool, &[&root.join(UPLOADS), &root.join(RESULTS)])
                .map_err(|e| StoreError::of_io(e, "files cannot be stored".into()))
        })
        .await
    }

    async fn hold_partial(&self, id: Uuid) -> StoreResult<Option<Box<dyn Partial>>> {
        let folder = self.partials.clone();
        blocking(move || {
            LocalPartial::hold(&folder, id).map_err(|e| StoreError::of_io(e, format!("cannot hold upload {id}")))
        })
        .await
        .map(|held| held.map(|partial| Box::new(partial) as Box<dyn Partial>))
    }

    async fn remove_partial(&self, id: Uuid) -> StoreResult<()> {
        let folder = self.partials.clone();
        blocking(move || {
            partial::delete(&folder, id).map_err(|e| StoreError::of_io(e, format!("cannot remove upload {id}")))
        })
        .await
    }

    async fn partials(&self) -> StoreResult<Vec<Uuid>> {
        let folder = self.partials.clone();
        blocking(move || partial::list(&folder).map_err(|e| StoreError::of_io(e, "cannot list the uploads".into())))
            .await
    }
}

fn remove_leases_before(results: &Path, first_kept: i64) -> io::Result<()> {
    let entries = match fs::read_dir(results) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        other => other?,
    };
    let mut kept = false;
    for entry in entries {
        let entry = entry?;
        let lease = entry.file_name().to_str().and_then(|name| name.parse::<i64>().ok());
        if lease.is_some_and(|lease| lease >= first_kept) {
            kept = true;
        } else {
            remove(&entry.path())?;
        }
    }
    if !kept {
        step("results.prune")?;
        // Fails, as it should, when a worker made a new folder in it meanwhile.
        let _ = fs::remove_dir(results);
    }
    Ok(())
}

/// The jobs that have an upload or a folder of results, by id.
fn jobs_below(root: &Path) -> io::Result<Vec<JobBlobs>> {
    let now = SystemTime::now();
    let mut youngest: BTreeMap<Uuid, Duration> = BTreeMap::new();
    for folder in [UPLOADS, RESULTS] {
        for entry in fs::read_dir(root.join(folder))? {
            let entry = entry?;
            let name = entry.file_name();
            let Some(id) = name.to_str().and_then(|n| Uuid::try_parse(n.trim_end_matches(".zip")).ok()) else {
                continue;
            };
            let age = match age(&entry, now) {
                Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
                other => other?,
            };
            youngest.entry(id).and_modify(|known| *known = age.min(*known)).or_insert(age);
        }
    }
    Ok(youngest.into_iter().map(|(id, untouched_for)| JobBlobs { id, untouched_for }).collect())
}

/// Time since the name of a file came to be or a folder changed: the inode's change time, which a rename sets too,
/// unlike the modification time, which may lie hours back when an upload was slow.
fn age(entry: &fs::DirEntry, now: SystemTime) -> io::Result<Duration> {
    use std::os::unix::fs::MetadataExt;
    let metadata = entry.metadata()?;
    let changed = SystemTime::UNIX_EPOCH + Duration::from_secs(u64::try_from(metadata.ctime()).unwrap_or(0));
    Ok(now.duration_since(changed).unwrap_or_default())
}

#[cfg(test)]
#[path = "local_tests.rs"]
mod tests;
