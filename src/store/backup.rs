//! A copy of everything, taken while a server works. It is a data folder itself: `verify` looks at it, a server can
//! run on it, and restoring is copying it back.
//!
//! First the rows, as they are at one moment; then the files that these rows name. Files never change under their key, so
//! what an earlier copy has already is not copied again. What was deleted meanwhile is deleted in the copy too. Uploads
//! that are still arriving are not copied: their clients have them.

use std::{
    collections::HashMap,
    fs, io,
    path::{Path, PathBuf},
    time::Duration,
};

use anyhow::{Context, anyhow};
use uuid::Uuid;

use super::{
    Job, JobFilter, JobQueue, MetadataStore, PageRequest, Retention, StoreError, StoreResult, UploadRecords,
    blobs::{
        Blobs,
        local::{LocalBlobs, remove, sync_folder},
    },
    failpoint::step,
    folder,
    gc::collect,
    sqlite::SqliteMetadata,
};

/// Name of the database in a data folder.
pub const DATABASE: &str = "pinstack.sqlite";
/// Says of a folder that it is a copy, which the next one may replace. Gone once a server works on it: then it is a
/// store of its own, and nothing may be copied over it.
pub const MARK: &str = "pinstack.copy";
/// Rows read at a time.
const PAGE: u32 = 200;

/// What was copied.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Copied {
    /// Jobs in the copy.
    pub jobs: usize,
    /// Files that are new in it.
    pub files: usize,
    /// Their bytes.
    pub bytes: u64,
    /// Files that it had already.
    pub kept: usize,
    /// Jobs whose row cannot be read; row and files are copied as they are.
    pub unreadable: usize,
}

/// Brings the folder `to` up to date with a store: everything in it, nothing else. `to` is made when it is missing.
/// When this ends early the copy that was there before is still whole, or there is none.
///
/// # Errors
/// When `to` holds something else than a copy or an empty folder, a file that a row names is missing, or either side cannot be
/// read or written.
pub async fn copy(rows: &SqliteMetadata, blobs: &dyn Blobs, to: &Path) -> StoreResult<Copied> {
    let io = |what: &'static str| move |error: io::Error| StoreError::of_io(error, format!("{what} of the copy"));
    require_copy_or_nothing(to).map_err(io("cannot use the folder"))?;
    make_marked(to).map_err(io("cannot make the folder"))?;
    let target = LocalBlobs::open(to)?;
    let (database, snapshot) = (to.join(DATABASE), to.join(format!("{DATABASE}.new")));
    let mut copied = Copied::default();
    while !copy_once(rows, blobs, &snapshot, &target, &mut copied).await? {
        tracing::info!("a file was deleted while it was to be copied; the rows are copied again");
    }
    if database.exists() {
        // the journal of a copy that was looked at and not closed must not be taken for one of the new file
        SqliteMetadata::open(&database).await?.close().await;
    }
    put_in_place(&snapshot, &database, to).map_err(io("cannot put the database in place"))?;
    let now = SqliteMetadata::open(&database).await?;
    collect(&now, &target, Duration::ZERO, &Retention::default()).await?;
    now.close().await;
    Ok(copied)
}

/// Copies the rows as they are now, and the files that they name. False when one of these was deleted meanwhile: what is
/// there already stays for the next time.
async fn copy_once(
    rows: &SqliteMetadata,
    blobs: &dyn Blobs,
    snapshot: &Path,
    target: &LocalBlobs,
    copied: &mut Copied,
) -> StoreResult<bool> {
    for left in [snapshot, &beside(snapshot, "-wal"), &beside(snapshot, "-shm")] {
        remove(left).map_err(|error| StoreError::of_io(error, "cannot clean the folder of the copy".into()))?;
    }
    rows.snapshot_to(snapshot).await?;
    let copied_rows = SqliteMetadata::open(snapshot).await?;
    for id in copied_rows.open_uploads().await? {
        copied_rows.delete_upload(id).await?;
    }
    (copied.jobs, copied.unreadable) = (0, 0);
    let mut is_whole = true;
    let mut shared = Shared::new();
    let (jobs, unreadable) = every_job(&copied_rows).await?;
    for id in unreadable {
        copy_unreadable(&copied_rows, blobs, target, id, copied).await?;
        copied.jobs += 1;
        copied.unreadable += 1;
    }
    // the oldest first: a rerun shares the zip of an older stack, which an earlier copy may have brought
    for job in jobs.iter().rev() {
        is_whole = copy_job(rows, blobs, target, job, &mut shared, copied).await?;
        copied.jobs += 1;
        if !is_whole {
            break;
        }
    }
    // closed, the file holds everything and has no journal beside it
    copied_rows.close().await;
    Ok(is_whole)
}

fn require_copy_or_nothing(to: &Path) -> io::Result<()> {
    let mut entries = match fs::read_dir(to) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        other => other?,
    };
    if entries.next().is_none() || to.join(MARK).is_file() {
        return Ok(());
    }
    let why = format!(
        "{} holds something that is no copy made by 'pinstack backup', or that a server has worked on; name an empty or a new \
         folder",
        to.display()
    );
    Err(io::Error::other(why))
}

fn make_marked(to: &Path) -> io::Result<()> {
    folder::make(to)?;
    step("backup.folder")?;
    fs::write(to.join(MARK), "made by pinstack backup; the next copy into this folder replaces it\n")
}

/// What was a copy is a store of its own from here on.
///
/// # Errors
/// When the folder cannot be written.
pub fn forget_copy(folder: &Path) -> io::Result<()> {
    remove(&folder.join(MARK))
}

fn put_in_place(snapshot: &Path, database: &Path, folder: &Path) -> io::Result<()> {
    step("backup.sync")?;
    fs::File::options().write(true).open(snapshot)?.sync_all()?;
    step("backup.rename")?;
    fs::rename(snapshot, database)?;
    sync_folder(folder)
}

fn beside(file: &Path, ending: &str) -> PathBuf {
    let mut name = file.as_os_str().to_owned();
    name.push(ending);
    name.into()
}

/// The jobs, and the ids of those whose row cannot be read.
async fn every_job(rows: &dyn MetadataStore) -> StoreResult<(Vec<Job>, Vec<Uuid>)> {
    let (mut jobs, mut unreadable, mut cursor) = (Vec::new(), Vec::new(), None);
    loop {
        let page = rows.jobs(&JobFilter::default(), &PageRequest { limit: PAGE, cursor }).await?;
        jobs.extend(page.items);
        unreadable.extend(page.skipped.iter().filter_map(|row| Uuid::try_parse(&row.id).ok()));
        cursor = page.next_cursor;
        if cursor.is_none() {
            return Ok((jobs, unreadable));
        }
    }
}

/// Copies the files of one job. False when one was deleted meanwhile, because the job was or its zip's time was over.
async fn copy_job(
    rows: &dyn MetadataStore,
    blobs: &dyn Blobs,
    target: &LocalBlobs,
    job: &Job,
    shared: &mut Shared,
    copied: &mut Copied,
) -> StoreResult<bool> {
    let upload = (!job.upload_removed).then(|| job.request.upload().key.as_str());
    let results = job.outcome.as_ref().map(|outcome| outcome.artifacts()).unwrap_or_default();
    for key in upload.into_iter().chain(results.iter().map(|artifact| artifact.key.as_str())) {
        if target.local_path(key).await?.is_some() {
            if let Some(from) = blobs.local_path(key).await?
                && let Some(inode) = shared_inode(&from).await
            {
                shared.insert(inode, key.to_owned());
            }
            copied.kept += 1;
            continue;
        }
        let there = match blobs.local_path(key).await? {
            Some(from) => copy_or_share(from, target, key, shared).await?,
            None => None,
        };
        match there {
            Some(bytes) => {
                copied.files += 1;
                copied.bytes += bytes;
            }
            None if rows.job(job.id).await?.is_none_or(|now| now.upload_removed != job.upload_removed) => {
                return Ok(false);
            }
            None => {
                let detail =
                    format!("{key} is not there, and job {} needs it; 'pinstack verify' looks for more", job.id);
                return Err(anyhow!(detail).into());
            }
        }
    }
    Ok(true)
}

/// Keys of files in the copy whose bytes more than one key of the store shares, by the inode that they have in the store.
type Shared = HashMap<(u64, u64), String>;

/// Device and inode of a file that has more than one name.
async fn shared_inode(file: &Path) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    let metadata = tokio::fs::metadata(file).await.ok()?;
    (metadata.nlink() > 1).then(|| (metadata.dev(), metadata.ino()))
}

/// Copies one file; what shares its bytes in the store shares them in the copy, too. `None` when it went meanwhile.
async fn copy_or_share(from: PathBuf, target: &LocalBlobs, key: &str, shared: &mut Shared) -> StoreResult<Option<u64>> {
    let inode = shared_inode(&from).await;
    if let Some(same) = inode.and_then(|inode| shared.get(&inode)) {
        let spooled = target.spool_dir().join(Uuid::now_v7().to_string());
        if target.share(same, &spooled).await? {
            target.publish(&spooled, key).await?;
            return Ok(Some(0));
        }
    }
    let copied = copy_file(from, target, key).await?;
    if let (Some(inode), Some(_)) = (inode, copied) {
        shared.insert(inode, key.to_owned());
    }
    Ok(copied)
}

/// Copies what is there of the files that a row names which cannot be read. One that is missing is no reason not to copy the
/// rest.
async fn copy_unreadable(
    rows: &SqliteMetadata,
    blobs: &dyn Blobs,
    target: &LocalBlobs,
    id: Uuid,
    copied: &mut Copied,
) -> StoreResult<()> {
    for key in rows.blob_keys(id).await? {
        if target.local_path(&key).await?.is_some() {
            copied.kept += 1;
        } else if let Some(from) = blobs.local_path(&key).await?
            && let Some(bytes) = copy_file(from, target, &key).await?
        {
            copied.files += 1;
            copied.bytes += bytes;
        }
    }
    Ok(())
}

/// Copies one file, durably. `None` when it went meanwhile.
async fn copy_file(from: PathBuf, target: &LocalBlobs, key: &str) -> StoreResult<Option<u64>> {
    let spooled = target.spool_dir().join(Uuid::now_v7().to_string());
    let to = spooled.clone();
    let copied = tokio::task::spawn_blocking(move || step("backup.copy").and_then(|()| fs::copy(&from, &to)));
    let bytes = match copied.await.context("the task that copies died")? {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        other => other.map_err(|error| StoreError::of_io(error, format!("cannot copy {key}")))?,
    };
    target.publish(&spooled, key).await?;
    Ok(Some(bytes))
}
