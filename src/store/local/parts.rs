//! The bytes of a resumable upload as one file: `{data_dir}/partial/{id}.part`, protected by a lock on `{id}.lock`. The
//! lock is on a file of its own, because the bytes move away when they become a blob.
//!
//! File operations run on a blocking thread that shares the lock. So the lock is not released before the last write has
//! ended, even when the request that started it was cancelled: no late write of one request corrupts the bytes of the
//! next.

use std::{
    fs::{self, File, TryLockError},
    io,
    os::unix::fs::FileExt,
    path::{Path, PathBuf},
    sync::{
        Arc, OnceLock,
        atomic::{AtomicU64, Ordering},
    },
};

use async_trait::async_trait;
use bytes::Bytes;
use uuid::Uuid;

use crate::store::{
    SpoolFile, StoreError, StoreResult, Workspace,
    failpoint::step,
    folder::{blocking, make_private, remove, sync_folder},
    parts::{LockedUpload, UploadParts},
};

/// The parts of uploads in a folder of this machine.
#[derive(Debug)]
pub struct LocalUploadParts {
    folder: PathBuf,
}

impl LocalUploadParts {
    /// Opens (or creates) the folder.
    pub(super) fn open(data_dir: &Path) -> io::Result<Self> {
        let folder = data_dir.join("partial");
        make_private(&folder)?;
        Ok(Self { folder })
    }

    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }
}

#[async_trait]
impl UploadParts for LocalUploadParts {
    async fn lock(&self, id: Uuid) -> StoreResult<Option<Box<dyn LockedUpload>>> {
        let folder = self.folder.clone();
        let locked = blocking(move || {
            LockedFile::lock(&folder, id).map_err(|e| StoreError::of_io(e, format!("cannot lock upload {id}")))
        });
        Ok(locked.await?.map(|locked| Box::new(locked) as Box<dyn LockedUpload>))
    }

    async fn remove(&self, id: Uuid) -> StoreResult<()> {
        let folder = self.folder.clone();
        blocking(move || {
            let removed = remove(&folder.join(format!("{id}.part")));
            let removed = removed.and_then(|()| remove(&folder.join(format!("{id}.lock"))));
            removed.map_err(|e| StoreError::of_io(e, format!("cannot remove upload {id}")))
        })
        .await
    }

    async fn list(&self) -> StoreResult<Vec<Uuid>> {
        let folder = self.folder.clone();
        blocking(move || list(&folder).map_err(|e| StoreError::of_io(e, "cannot list the uploads".into()))).await
    }
}

/// A locked upload.
struct LockedFile {
    path: PathBuf,
    lock: Arc<File>,
    /// `None` before [`LockedUpload::resume_at`].
    open: Option<Arc<OpenFile>>,
}

/// An open file and the lock that protects it.
struct OpenFile {
    file: File,
    /// Offset of the next byte.
    at: AtomicU64,
    /// Set when a write failed: the length of the file is unknown then.
    broken: OnceLock<()>,
    _lock: Arc<File>,
}

impl LockedFile {
    /// Takes the lock, unless it is held.
    fn lock(folder: &Path, id: Uuid) -> io::Result<Option<Self>> {
        step("partial.lock")?;
        let lock = File::options().create(true).truncate(false).write(true).open(folder.join(format!("{id}.lock")))?;
        match lock.try_lock() {
            Ok(()) => Ok(Some(Self { path: folder.join(format!("{id}.part")), lock: Arc::new(lock), open: None })),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(error)) => Err(error),
        }
    }

    /// Runs `work` on the open file, on a blocking thread.
    async fn on_file(
        &self,
        what: &'static str,
        work: impl FnOnce(&OpenFile) -> io::Result<()> + Send + 'static,
    ) -> StoreResult<()> {
        let open = self.open.clone();
        let open = open.ok_or_else(|| anyhow::anyhow!("an upload was written before its offset was set"))?;
        blocking(move || work(&open).map_err(cannot(what))).await
    }
}

impl OpenFile {
    fn write(&self, bytes: &[u8]) -> io::Result<()> {
        step("partial.write")?;
        if self.broken.get().is_some() {
            return Err(io::Error::other("an earlier write failed"));
        }
        let at = self.at.load(Ordering::Relaxed);
        self.file.write_all_at(bytes, at).inspect_err(|_| _ = self.broken.set(()))?;
        self.at.store(at + bytes.len() as u64, Ordering::Relaxed);
        Ok(())
    }

    fn sync(&self) -> io::Result<()> {
        step("partial.sync")?;
        self.file.sync_data()
    }
}

fn cannot(what: &str) -> impl FnOnce(io::Error) -> StoreError {
    let what = format!("cannot {what} an upload");
    move |error| StoreError::of_io(error, what)
}

#[async_trait]
impl LockedUpload for LockedFile {
    fn is_exclusive(&self) -> bool {
        true
    }

    async fn length(&self) -> StoreResult<u64> {
        let path = self.path.clone();
        blocking(move || match fs::metadata(&path) {
            Ok(metadata) => Ok(metadata.len()),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(0),
            Err(error) => Err(cannot("measure")(error)),
        })
        .await
    }

    async fn resume_at(&mut self, offset: u64, _generation: i64) -> StoreResult<bool> {
        self.open = None;
        let (path, lock) = (self.path.clone(), Arc::clone(&self.lock));
        let opened = blocking(move || {
            let file = open(&path, offset).map_err(cannot("open"))?;
            let at = AtomicU64::new(offset);
            Ok(file.map(|file| Arc::new(OpenFile { file, at, broken: OnceLock::new(), _lock: lock })))
        });
        self.open = opened.await?;
        Ok(self.open.is_some())
    }

    async fn append(&mut self, bytes: Bytes) -> StoreResult<()> {
        self.on_file("write", move |open| open.write(&bytes)).await
    }

    async fn sync(&mut self) -> StoreResult<()> {
        self.on_file("sync", OpenFile::sync).await
    }

    async fn assemble(&mut self, length: u64, _workspace: &Workspace) -> StoreResult<Option<SpoolFile>> {
        Ok(self.resume_at(length, 0).await?.then(|| SpoolFile::persistent(self.path.clone())))
    }
}

/// Opens the file and truncates it to `offset` bytes. Offset 0 creates it, with a durable name. `None` when it is
/// shorter.
fn open(path: &Path, offset: u64) -> io::Result<Option<File>> {
    let opened = if offset == 0 {
        step("partial.make")?;
        let file = File::options().create(true).truncate(true).write(true).open(path)?;
        if let Some(folder) = path.parent() {
            sync_folder(folder)?;
        }
        file
    } else {
        match File::options().write(true).open(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            other => other?,
        }
    };
    if opened.metadata()?.len() < offset {
        return Ok(None);
    }
    step("partial.cut")?;
    opened.set_len(offset)?;
    Ok(Some(opened))
}

/// The uploads that have a file or a lock, each once.
fn list(folder: &Path) -> io::Result<Vec<Uuid>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        let id = path.file_stem().and_then(|stem| stem.to_str()).and_then(|stem| Uuid::try_parse(stem).ok());
        found.extend(id);
    }
    found.sort();
    found.dedup();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Waits until `holds`; the other thread runs meanwhile.
    async fn until(mut holds: impl FnMut() -> bool) {
        while !holds() {
            tokio::task::yield_now().await;
        }
    }

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn the_lock_is_held_until_the_last_write_has_ended_even_if_its_request_was_cancelled() {
        let folder = tempfile::tempdir().expect("a folder");
        let id = Uuid::now_v7();
        let lock = || LockedFile::lock(folder.path(), id).expect("the lock can be tried");
        let mut first = lock().expect("it is free");
        assert!(first.resume_at(0, 1).await.expect("opened"));
        // a write that has not ended when its request is cancelled
        let (at_disk, arrived) = std::sync::mpsc::channel();
        let (go_on, resumed) = std::sync::mpsc::channel::<()>();
        let late = async move {
            let written = first.on_file("write", move |file| {
                at_disk.send(()).expect("the test waits");
                resumed.recv().expect("the test resumes it");
                file.write(b"late")
            });
            written.await.expect("it is cancelled before");
        };
        let request = tokio::spawn(late);
        until(|| arrived.try_recv().is_ok()).await;
        request.abort();
        assert!(request.await.expect_err("aborted").is_cancelled());
        assert!(lock().is_none(), "the write has not ended");
        go_on.send(()).expect("the write waits");
        let mut second = None;
        until(|| {
            second = lock();
            second.is_some()
        })
        .await;
        let mut second = second.expect("locked");
        assert!(second.resume_at(2, 2).await.expect("opened"), "the late write is there and can be truncated");
        second.append(Bytes::from_static(b"xyz")).await.expect("written");
        second.sync().await.expect("synced");
        assert_eq!(fs::read(&second.path).expect("the file"), b"laxyz");
    }
}
