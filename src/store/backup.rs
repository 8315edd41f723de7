//! Backup: a copy of a store, taken while a server runs. The copy is a data folder: `verify` checks it, a server can
//! run on it, and restoring it is a backup in the other direction.
//!
//! 1. The metadata is copied as of one moment.
//! 2. The blobs that this copy refers to are copied. A blob never changes, so one that an earlier backup has is kept.
//!    If a blob was deleted meanwhile, step 1 is repeated.
//! 3. The new database replaces that of the earlier backup.
//! 4. Garbage collection removes from the copy what was deleted since the earlier backup.
//!
//! Uploads that are still arriving are not copied: their clients have them.

use std::{collections::HashMap, fs, io, path::Path, sync::Arc, time::Duration};

use anyhow::{Context, anyhow};
use uuid::Uuid;

use super::{
    BlobStore, Job, JobFilter, MetadataStore, PageRequest, Retention, SpoolFile, Store, StoreError, StoreResult,
    Workspace,
    blobs::LocalBlob,
    data_folder::{exists, open, open_database, open_metadata, remove_database, replace_database},
    failpoint::step,
    folder::{self, DATABASE, remove},
    gc, local,
};

/// Marks a folder as a backup, which the next backup may replace. A server or worker that runs on the folder, and a
/// change of its tokens, remove the mark: the folder is a store of its own from then on and must not be overwritten.
pub const MARK: &str = "pinstack.copy";
/// Rows that are read at a time.
const PAGE: u32 = 200;

/// What was copied.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Copied {
    /// Jobs in the backup.
    pub jobs: usize,
    /// Files that were copied.
    pub files: usize,
    /// Their bytes.
    pub bytes: u64,
    /// Files that the earlier backup had.
    pub kept: usize,
    /// Jobs whose row cannot be read. Row and files are copied unchanged.
    pub unreadable: usize,
}

/// Brings the backup in the folder `to` up to date with `store`. The folder is created if it is missing. If this fails,
/// an earlier backup in the folder is still complete.
///
/// # Errors
/// When `to` contains something that is not a backup, a blob that a row refers to is missing, or either side cannot be
/// read or written.
pub async fn copy(store: &Store, to: &Path) -> StoreResult<Copied> {
    let io = |what: &'static str| move |error: io::Error| StoreError::of_io(error, format!("{what} of the backup"));
    require_backup_or_nothing(to).map_err(io("cannot use the folder"))?;
    if exists(to) {
        // one that cannot be replaced is refused before anything is copied
        open_metadata(to).await?.close().await;
    }
    make_marked(to).map_err(io("cannot create the folder"))?;
    let (blobs, _parts, workspace) = local::open(to)?;
    let snapshot = to.join(format!("{DATABASE}.new"));
    let copied = copy_files(store, &blobs, &workspace, &snapshot).await?;
    replace_database(&snapshot, to).await?;
    drop((blobs, workspace));
    let copy = open(to).await?;
    gc::collect(&copy, Duration::ZERO, &Retention::default()).await?;
    copy.metadata.close().await;
    Ok(copied)
}

/// Writes all rows of `store` to the new file `snapshot`, and copies the blobs that they refer to. Blobs that are there
/// are kept, so this can be repeated after an interruption, or while a server still runs to shorten the last time.
///
/// # Errors
/// When a blob that a row refers to is missing, or either side cannot be read or written.
pub async fn copy_files(
    store: &Store,
    blobs: &dyn BlobStore,
    workspace: &Workspace,
    snapshot: &Path,
) -> StoreResult<Copied> {
    let mut backup =
        Backup { store, blobs, workspace, shared: HashMap::new(), files_of: HashMap::new(), copied: Copied::default() };
    while !backup.copy_once(snapshot).await? {
        tracing::info!("a blob was deleted before it was copied; the database is copied again");
    }
    Ok(backup.copied)
}

/// Removes the mark of a backup: the folder is a store of its own from here on.
///
/// # Errors
/// When the folder cannot be written.
pub fn remove_mark(folder: &Path) -> io::Result<()> {
    remove(&folder.join(MARK))
}

fn require_backup_or_nothing(to: &Path) -> io::Result<()> {
    let mut entries = match fs::read_dir(to) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        other => other?,
    };
    if entries.next().is_none() || to.join(MARK).is_file() {
        return Ok(());
    }
    let why = format!(
        "{} is not a backup made by 'pinstack backup', or a server has run on it since; specify an empty or a new folder",
        to.display()
    );
    Err(io::Error::other(why))
}

fn make_marked(to: &Path) -> io::Result<()> {
    folder::make(to)?;
    step("backup.folder")?;
    fs::write(to.join(MARK), "made by pinstack backup; the next backup into this folder replaces it\n")
}

/// A backup in progress.
struct Backup<'a> {
    store: &'a Store,
    /// Blobs of the backup.
    blobs: &'a dyn BlobStore,
    /// Workspace of the backup.
    workspace: &'a Workspace,
    /// Blobs of the backup that share their bytes with others in the store, by the inode in the store.
    shared: HashMap<Inode, String>,
    /// How many files of a job this backup has copied: when the rows are read again, these are no files of an earlier
    /// backup.
    files_of: HashMap<Uuid, usize>,
    copied: Copied,
}

/// Device and inode of a file.
type Inode = (u64, u64);

impl Backup<'_> {
    /// Copies the metadata, and the blobs that it refers to. False when one of them was deleted meanwhile; what was
    /// copied until then is kept for the next try.
    async fn copy_once(&mut self, snapshot: &Path) -> StoreResult<bool> {
        remove_database(snapshot)
            .map_err(|error| StoreError::of_io(error, "cannot clean the folder of the backup".into()))?;
        self.store.metadata.snapshot_to(snapshot).await?;
        let metadata = open_database(snapshot).await?;
        for id in metadata.open_uploads().await? {
            metadata.delete_upload(id).await?;
        }
        (self.copied.jobs, self.copied.kept, self.copied.unreadable) = (0, 0, 0);
        // a file that was deleted since the last pass may have left its inode to another
        self.shared.clear();
        let (readable, unreadable) = all_ids(&metadata).await?;
        for id in unreadable {
            self.copy_unreadable(&metadata, id).await?;
            self.copied.jobs += 1;
            self.copied.unreadable += 1;
        }
        let mut is_complete = true;
        // oldest first: a rerun shares the zip of an older stack, which an earlier backup may have copied
        for id in readable.into_iter().rev() {
            let Some(job) = metadata.job(id).await? else { continue };
            is_complete = self.copy_job(&job).await?;
            self.copied.jobs += 1;
            if !is_complete {
                break;
            }
        }
        // closed, the file is complete and has no journal beside it
        metadata.close().await;
        Ok(is_complete)
    }

    /// Copies the blobs of one job. False when one was deleted meanwhile: the job was, or its zip expired.
    async fn copy_job(&mut self, job: &Job) -> StoreResult<bool> {
        let upload = job.request.own_upload().filter(|_| !job.upload_removed).map(|upload| upload.key.as_str());
        let results = job.outcome.as_ref().map(|outcome| outcome.artifacts()).unwrap_or_default();
        // found there, though this backup has copied them before the rows were read again
        let before = self.files_of.get(&job.id).copied().unwrap_or_default();
        let mut present: usize = 0;
        for key in upload.into_iter().chain(results.iter().map(|artifact| artifact.key.as_str())) {
            if self.blobs.head(key).await?.is_some() {
                // only blobs of this machine share an inode
                if self.store.blobs.is_local()
                    && let Some(from) = self.store.blobs.fetch(key, &self.store.workspace).await?
                    && let Some(inode) = shared_inode(&from).await
                {
                    self.shared.insert(inode, key.to_owned());
                }
                present += 1;
                continue;
            }
            let bytes = match self.store.blobs.fetch(key, &self.store.workspace).await? {
                Some(from) => self.copy_or_share(from, key).await?,
                None => None,
            };
            match bytes {
                Some(bytes) => self.count(job.id, bytes),
                None if self.is_changed(job).await? => return Ok(false),
                None => {
                    let detail = format!("{key} of job {} is missing; 'pinstack verify' finds other damage", job.id);
                    return Err(anyhow!(detail).into());
                }
            }
        }
        self.copied.kept += present.saturating_sub(before);
        Ok(true)
    }

    /// Counts a file of a job that was copied.
    fn count(&mut self, id: Uuid, bytes: u64) {
        *self.files_of.entry(id).or_default() += 1;
        self.copied.files += 1;
        self.copied.bytes += bytes;
    }

    /// True when a job was deleted, or its zip expired, since `job` was read.
    async fn is_changed(&self, job: &Job) -> StoreResult<bool> {
        let now = self.store.metadata.job(job.id).await?;
        Ok(now.is_none_or(|now| now.upload_removed != job.upload_removed))
    }

    /// Copies one blob. Blobs that share their bytes in the store share them in the backup. `None`: it was deleted
    /// meanwhile.
    async fn copy_or_share(&mut self, from: LocalBlob, key: &str) -> StoreResult<Option<u64>> {
        let inode = shared_inode(&from).await;
        if let Some(same) = inode.and_then(|inode| self.shared.get(&inode))
            && let Some(shared) = self.blobs.share(same, self.workspace).await?
        {
            self.blobs.put(key, shared).await?;
            return Ok(Some(0));
        }
        let copied = self.copy_file(from, key).await?;
        if let (Some(inode), Some(_)) = (inode, copied) {
            self.shared.insert(inode, key.to_owned());
        }
        Ok(copied)
    }

    /// Copies what exists of the blobs of a job whose row cannot be read. A missing one does not prevent the backup of
    /// the rest.
    async fn copy_unreadable(&mut self, metadata: &Arc<dyn MetadataStore>, id: Uuid) -> StoreResult<()> {
        let before = self.files_of.get(&id).copied().unwrap_or_default();
        let mut present: usize = 0;
        for key in metadata.blob_keys(id).await? {
            if self.blobs.head(&key).await?.is_some() {
                present += 1;
            } else if let Some(from) = self.store.blobs.fetch(&key, &self.store.workspace).await?
                && let Some(bytes) = self.copy_file(from, &key).await?
            {
                self.count(id, bytes);
            }
        }
        self.copied.kept += present.saturating_sub(before);
        Ok(())
    }

    /// Copies one file, durably. `None`: it was deleted meanwhile.
    async fn copy_file(&self, from: LocalBlob, key: &str) -> StoreResult<Option<u64>> {
        let cannot = |error| StoreError::of_io(error, format!("cannot copy {key}"));
        let to = self.workspace.new_path("copy").map_err(cannot)?;
        let copying = tokio::task::spawn_blocking(move || {
            let copied = step("backup.copy").and_then(|()| fs::copy(from.path(), &to));
            (copied, to)
        });
        let (copied, to) = copying.await.context("the task that copies a file panicked")?;
        let bytes = match copied {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            other => other.map_err(cannot)?,
        };
        self.blobs.put(key, SpoolFile::temporary(to)).await?;
        Ok(Some(bytes))
    }
}

/// The ids of the jobs whose row can be read, newest first, and of those whose row cannot.
async fn all_ids(metadata: &Arc<dyn MetadataStore>) -> StoreResult<(Vec<Uuid>, Vec<Uuid>)> {
    let (mut readable, mut unreadable, mut cursor) = (Vec::new(), Vec::new(), None);
    loop {
        let page = metadata.jobs(&JobFilter::default(), &PageRequest { limit: PAGE, cursor }).await?;
        readable.extend(page.items.iter().map(|job| job.id));
        unreadable.extend(page.skipped.iter().filter_map(|row| Uuid::try_parse(&row.id).ok()));
        cursor = page.next_cursor;
        if cursor.is_none() {
            return Ok((readable, unreadable));
        }
    }
}

/// The inode of a file that has more than one name.
async fn shared_inode(file: &LocalBlob) -> Option<Inode> {
    use std::os::unix::fs::MetadataExt;
    let metadata = tokio::fs::metadata(file.path()).await.ok()?;
    (metadata.nlink() > 1).then(|| (metadata.dev(), metadata.ino()))
}

#[cfg(test)]
mod tests;
