//! Blobs as files: `{data_dir}/blobs/{key}`.

use std::{
    fs::{self, File},
    io,
    ops::Range,
    path::{Path, PathBuf},
    time::{Duration, SystemTime},
};

use async_trait::async_trait;
use futures::stream::{BoxStream, StreamExt, poll_fn};
use tokio::{
    io::{AsyncReadExt, AsyncSeekExt},
    sync::mpsc,
};
use tokio_util::io::ReaderStream;

use super::probe;
use crate::store::{
    SpoolFile, StoreError, StoreResult, Workspace,
    blobs::{
        BlobMeta, BlobStore, ByteStream, Capacity, LocalBlob, OpenBlob, RESULTS, UPLOADS, require_key, require_prefix,
    },
    failpoint::step,
    folder::{blocking, make_private, remove, sync_folder},
    workspace::disk_capacity,
};

/// Bytes that are read from the disk at a time.
const CHUNK: usize = 128 << 10;
/// Entries of a list that are read ahead of the consumer.
const LISTED_AHEAD: usize = 256;

/// Blobs in a folder of this machine.
#[derive(Debug)]
pub struct LocalBlobStore {
    root: PathBuf,
    /// The workspace of this process, for [`BlobStore::probe`].
    spool: PathBuf,
}

impl LocalBlobStore {
    /// Creates the folders and returns the root of the blobs.
    pub(super) fn make_folders(data_dir: &Path) -> io::Result<PathBuf> {
        let root = data_dir.join("blobs");
        for folder in [&root, &root.join(UPLOADS), &root.join(RESULTS)] {
            make_private(folder)?;
        }
        sync_folder(&root)?;
        Ok(root)
    }

    /// Opens the store, unless a file of the workspace or of `parts` cannot be renamed into it.
    pub(super) fn open(root: PathBuf, workspace: &Workspace, parts: &Path) -> io::Result<Self> {
        let spool = workspace.path().to_owned();
        let (uploads, results) = (root.join(UPLOADS), root.join(RESULTS));
        probe::same_file_system(&spool, &[parts, &uploads, &results])?;
        // two mounts of one file system have the same device, but a rename between them fails; a full disk is no reason
        // not to serve what is stored
        match probe::probe(&spool, &[&uploads, &results]) {
            Err(error) if error.kind() == io::ErrorKind::CrossesDevices => Err(error),
            _ => Ok(Self { root, spool }),
        }
    }

    /// The path of a key.
    fn path_of(&self, key: &str) -> StoreResult<PathBuf> {
        require_key(key)?;
        Ok(self.root.join(key))
    }

    /// The folder of a prefix.
    fn folder_of(&self, prefix: &str) -> StoreResult<PathBuf> {
        require_prefix(prefix)?;
        Ok(self.root.join(prefix.trim_end_matches('/')))
    }
}

#[async_trait]
impl BlobStore for LocalBlobStore {
    fn is_local(&self) -> bool {
        true
    }

    async fn put(&self, key: &str, file: SpoolFile) -> StoreResult<()> {
        let to = self.path_of(key)?;
        let (root, key) = (self.root.clone(), key.to_owned());
        blocking(move || {
            publish(file.path(), &to, &root).map_err(|e| StoreError::of_io(e, format!("cannot store the blob {key}")))
        })
        .await
    }

    async fn share(&self, key: &str, workspace: &Workspace) -> StoreResult<Option<SpoolFile>> {
        let cannot = |error| StoreError::of_io(error, format!("cannot share the blob {key}"));
        let from = self.path_of(key)?;
        // the guard comes first, so that the file is removed also when the caller gives up
        let to = workspace.new_path("shared").map_err(cannot)?;
        let (linked, to) = blocking(move || Ok((link(&from, &to), to))).await?;
        match linked {
            Ok(()) => Ok(Some(SpoolFile::temporary(to))),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(cannot(error)),
        }
    }

    async fn head(&self, key: &str) -> StoreResult<Option<BlobMeta>> {
        let (path, key) = (self.path_of(key)?, key.to_owned());
        blocking(move || match fs::metadata(&path) {
            Ok(metadata) if metadata.is_file() => Ok(Some(meta_of(key, &metadata))),
            Ok(_) => Ok(None),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(StoreError::of_io(error, format!("cannot look up the blob {key}"))),
        })
        .await
    }

    async fn read(&self, key: &str, range: Range<u64>) -> StoreResult<Option<ByteStream>> {
        let cannot = |error| StoreError::of_io(error, format!("cannot read the blob {key}"));
        let mut file = match tokio::fs::File::open(self.path_of(key)?).await {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            other => other.map_err(cannot)?,
        };
        file.seek(io::SeekFrom::Start(range.start)).await.map_err(cannot)?;
        let part = file.take(range.end.saturating_sub(range.start));
        Ok(Some(ReaderStream::with_capacity(part, CHUNK).boxed()))
    }

    async fn open(&self, key: &str, _workspace: &Workspace) -> StoreResult<Option<OpenBlob>> {
        let (path, key) = (self.path_of(key)?, key.to_owned());
        blocking(move || match File::open(&path) {
            Ok(file) => Ok(Some(OpenBlob::of_file(file))),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(StoreError::of_io(error, format!("cannot open the blob {key}"))),
        })
        .await
    }

    async fn fetch(&self, key: &str, _workspace: &Workspace) -> StoreResult<Option<LocalBlob>> {
        let path = self.path_of(key)?;
        Ok(self.head(key).await?.map(|_| LocalBlob::in_place(path)))
    }

    async fn delete(&self, key: &str) -> StoreResult<()> {
        let (path, key) = (self.path_of(key)?, key.to_owned());
        blocking(move || remove(&path).map_err(|e| StoreError::of_io(e, format!("cannot remove the blob {key}")))).await
    }

    async fn delete_prefix(&self, prefix: &str) -> StoreResult<()> {
        let (folder, root, prefix) = (self.folder_of(prefix)?, self.root.clone(), prefix.to_owned());
        blocking(move || {
            let removed = remove(&folder).and_then(|()| remove_empty_parents(&folder, &root));
            removed.map_err(|e| StoreError::of_io(e, format!("cannot remove the blobs below {prefix}")))
        })
        .await
    }

    fn list(&self, prefix: &str) -> BoxStream<'static, StoreResult<BlobMeta>> {
        let folder = match prefix {
            "" => self.root.clone(),
            prefix => match self.folder_of(prefix) {
                Ok(folder) => folder,
                Err(error) => return futures::stream::iter([Err(error)]).boxed(),
            },
        };
        let (found, mut listed) = mpsc::channel(LISTED_AHEAD);
        let root = self.root.clone();
        tokio::task::spawn_blocking(move || {
            if let Err(error) = walk(&folder, &root, &found) {
                // fails when the list is not read any more
                let _ = found.blocking_send(Err(StoreError::of_io(error, "cannot list the blobs".into())));
            }
        });
        poll_fn(move |context| listed.poll_recv(context)).boxed()
    }

    async fn remove_leftovers(&self) -> StoreResult<()> {
        let results = self.root.join(RESULTS);
        blocking(move || {
            remove_empty_below(&results).map_err(|e| StoreError::of_io(e, "cannot remove empty folders".into()))
        })
        .await
    }

    async fn capacity(&self) -> StoreResult<Option<Capacity>> {
        disk_capacity(self.root.clone()).await.map(Some)
    }

    async fn probe(&self) -> StoreResult<()> {
        let (spool, root) = (self.spool.clone(), self.root.clone());
        blocking(move || {
            probe::probe(&spool, &[&root.join(UPLOADS), &root.join(RESULTS)])
                .map_err(|e| StoreError::of_io(e, "files cannot be stored".into()))
        })
        .await
    }
}

/// Stores a file: fsync the file, create the folders, rename, fsync every folder up to the root.
fn publish(from: &Path, to: &Path, root: &Path) -> io::Result<()> {
    step("publish.sync")?;
    // opened for writing: some file systems refuse to sync a file that is open for reading only
    File::options().write(true).open(from)?.sync_all()?;
    let folder = to.parent().unwrap_or(root);
    make_and_rename(from, to, folder).or_else(|error| match error.kind() {
        // garbage collection removed the folder while it was still empty
        io::ErrorKind::NotFound => make_and_rename(from, to, folder),
        _ => Err(error),
    })?;
    for folder in folder.ancestors().take_while(|folder| folder.starts_with(root)) {
        sync_folder(folder)?;
    }
    Ok(())
}

fn make_and_rename(from: &Path, to: &Path, folder: &Path) -> io::Result<()> {
    step("publish.folders")?;
    fs::create_dir_all(folder)?;
    step("publish.rename")?;
    fs::rename(from, to)
}

/// A second name for the same bytes. File systems without hard links (exFAT, some network shares) get a copy.
fn link(from: &Path, to: &Path) -> io::Result<()> {
    step("share.link")?;
    match fs::hard_link(from, to) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => fs::copy(from, to).map(drop),
        linked => linked,
    }
}

/// Removes the folders above `folder` that are empty, but not the first level below the root.
fn remove_empty_parents(folder: &Path, root: &Path) -> io::Result<()> {
    let is_below = |path: &Path| path.parent().is_some_and(|above| above != root && above.starts_with(root));
    for parent in folder.ancestors().skip(1).take_while(|parent| is_below(parent)) {
        step("results.prune")?;
        // fails, as intended, when it is not empty: a worker may have added a folder meanwhile
        if fs::remove_dir(parent).is_err() {
            break;
        }
    }
    Ok(())
}

/// Removes every empty folder below `folder`.
fn remove_empty_below(folder: &Path) -> io::Result<()> {
    for entry in entries(folder)? {
        let entry = entry?;
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            remove_empty_below(&entry.path())?;
            if fs::read_dir(entry.path()).is_ok_and(|mut inside| inside.next().is_none()) {
                step("results.prune")?;
                // fails, as intended, when a worker has added a file meanwhile
                let _ = fs::remove_dir(entry.path());
            }
        }
    }
    Ok(())
}

/// Sends every file below `folder`, with its key relative to `root`. Stops when the list is not read any more.
fn walk(folder: &Path, root: &Path, found: &mpsc::Sender<StoreResult<BlobMeta>>) -> io::Result<()> {
    for entry in entries(folder)?.take_while(|_| !found.is_closed()) {
        let entry = entry?;
        let metadata = match entry.metadata() {
            // removed meanwhile
            Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
            other => other?,
        };
        let path = entry.path();
        if metadata.is_dir() {
            walk(&path, root, found)?;
        } else if let Some(key) = path.strip_prefix(root).ok().and_then(Path::to_str)
            && found.blocking_send(Ok(meta_of(key.to_owned(), &metadata))).is_err()
        {
            return Ok(());
        }
    }
    Ok(())
}

/// The entries of a folder; none when it does not exist.
fn entries(folder: &Path) -> io::Result<impl Iterator<Item = io::Result<fs::DirEntry>>> {
    match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None.into_iter().flatten()),
        other => Ok(Some(other?).into_iter().flatten()),
    }
}

/// Size and age of a file. Its age is that of its inode (ctime), which a rename resets; the modification time may be
/// hours older when an upload was slow.
fn meta_of(key: String, metadata: &fs::Metadata) -> BlobMeta {
    use std::os::unix::fs::MetadataExt;
    let seconds = u64::try_from(metadata.ctime()).unwrap_or(0);
    BlobMeta { key, size: metadata.len(), last_modified: SystemTime::UNIX_EPOCH + Duration::from_secs(seconds) }
}
