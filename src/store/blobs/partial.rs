//! The file of an upload that arrives in pieces: `{data_dir}/partial/{id}.part`, held by whoever has the lock on
//! `{id}.lock`. The lock is a file of its own, because the upload itself moves away when it is published.
//!
//! Whatever touches the file runs on a blocking thread that shares the lock. So the lock is not released before the
//! last write has ended, also when the request that started it was cancelled: no late write of one request lands in
//! what the next one writes.

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

use super::{
    Partial,
    local::{blocking, remove, sync_folder},
};
use crate::store::{StoreError, StoreResult, failpoint::step};

/// A held upload.
pub(super) struct LocalPartial {
    path: PathBuf,
    lock: Arc<File>,
    /// `None` before [`Partial::start_at`].
    open: Option<Arc<OpenFile>>,
}

/// The open file, with the lock that protects it.
struct OpenFile {
    file: File,
    /// Where the next byte goes.
    at: AtomicU64,
    /// Set when a write failed: where the file ends is unknown then.
    broken: OnceLock<()>,
    _lock: Arc<File>,
}

impl LocalPartial {
    /// Takes the lock, if nobody has it.
    pub(super) fn hold(folder: &Path, id: Uuid) -> io::Result<Option<Self>> {
        step("partial.lock")?;
        let lock = File::options().create(true).truncate(false).write(true).open(folder.join(format!("{id}.lock")))?;
        match lock.try_lock() {
            Ok(()) => Ok(Some(Self { path: folder.join(format!("{id}.part")), lock: Arc::new(lock), open: None })),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(error)) => Err(error),
        }
    }

    /// Runs `work` on the open file where it may block.
    async fn on_file(
        &self,
        what: &'static str,
        work: impl FnOnce(&OpenFile) -> io::Result<()> + Send + 'static,
    ) -> StoreResult<()> {
        let open = self.open.clone();
        let open = open.ok_or_else(|| anyhow::anyhow!("an upload was written before it was opened"))?;
        blocking(move || work(&open).map_err(cannot(what))).await
    }
}

impl OpenFile {
    fn write(&self, bytes: &[u8]) -> io::Result<()> {
        step("partial.write")?;
        if self.broken.get().is_some() {
            return Err(io::Error::other("a write before this one failed"));
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
impl Partial for LocalPartial {
    async fn start_at(&mut self, offset: u64) -> StoreResult<bool> {
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

    async fn write(&mut self, bytes: Bytes) -> StoreResult<()> {
        self.on_file("write", move |open| open.write(&bytes)).await
    }

    async fn sync(&mut self) -> StoreResult<()> {
        self.on_file("sync", OpenFile::sync).await
    }

    fn path(&self) -> &Path {
        &self.path
    }
}

/// The file with `offset` bytes; it is made (and its name made durable) when none are wanted.
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

/// Removes file and lock.
pub(super) fn delete(folder: &Path, id: Uuid) -> io::Result<()> {
    remove(&folder.join(format!("{id}.part")))?;
    remove(&folder.join(format!("{id}.lock")))
}

/// The uploads that have a file or a lock here, each once.
pub(super) fn list(folder: &Path) -> io::Result<Vec<Uuid>> {
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
    async fn the_lock_is_held_until_the_last_write_has_ended_though_its_request_is_gone() {
        let folder = tempfile::tempdir().expect("a folder");
        let id = Uuid::now_v7();
        let hold = || LocalPartial::hold(folder.path(), id).expect("the lock can be tried");
        let mut first = hold().expect("nobody has it");
        assert!(first.start_at(0).await.expect("opened"));
        // a write that is on its way to the disk when its request is cancelled
        let (at_disk, arrived) = std::sync::mpsc::channel();
        let (go_on, told) = std::sync::mpsc::channel::<()>();
        let late = async move {
            let written = first.on_file("write", move |file| {
                at_disk.send(()).expect("the test waits");
                told.recv().expect("the test says when");
                file.write(b"late")
            });
            written.await.expect("it is cancelled before");
        };
        let request = tokio::spawn(late);
        until(|| arrived.try_recv().is_ok()).await;
        request.abort();
        assert!(request.await.expect_err("aborted").is_cancelled());
        assert!(hold().is_none(), "the write has not ended");
        go_on.send(()).expect("the write waits");
        let mut second = None;
        until(|| {
            second = hold();
            second.is_some()
        })
        .await;
        let mut second = second.expect("held");
        assert!(second.start_at(2).await.expect("opened"), "what was written late is there and can be cut");
        second.write(Bytes::from_static(b"xyz")).await.expect("written");
        second.sync().await.expect("synced");
        assert_eq!(fs::read(second.path()).expect("the file"), b"laxyz");
    }
}
