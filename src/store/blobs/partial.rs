//! The file of an upload that arrives in pieces: `{data_dir}/partial/{id}.part`, held by whoever has the lock on
//! `{id}.lock`. The lock is a file of its own, because the upload itself moves away when it is published.

use std::{
    fs::{self, File, TryLockError},
    io,
    path::{Path, PathBuf},
};

use async_trait::async_trait;
use bytes::Bytes;
use tokio::io::{AsyncSeekExt, AsyncWriteExt};
use uuid::Uuid;

use super::{
    Partial,
    local::{blocking, remove, sync_folder},
};
use crate::store::{StoreError, StoreResult, step::step};

/// A held upload.
pub(super) struct LocalPartial {
    path: PathBuf,
    /// `None` before [`Partial::start_at`].
    file: Option<tokio::fs::File>,
    _lock: File,
}

impl LocalPartial {
    /// Takes the lock, if nobody has it.
    pub(super) fn hold(folder: &Path, id: Uuid) -> io::Result<Option<Self>> {
        step("partial.lock")?;
        let lock = File::options().create(true).truncate(false).write(true).open(folder.join(format!("{id}.lock")))?;
        match lock.try_lock() {
            Ok(()) => Ok(Some(Self { path: folder.join(format!("{id}.part")), file: None, _lock: lock })),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(error)) => Err(error),
        }
    }

    fn file(&mut self) -> StoreResult<&mut tokio::fs::File> {
        self.file
            .as_mut()
            .ok_or_else(|| StoreError::Other(anyhow::anyhow!("an upload was written before it was opened")))
    }
}

fn cannot(what: &str) -> impl FnOnce(io::Error) -> StoreError {
    let what = format!("cannot {what} an upload");
    move |error| StoreError::of_io(error, what)
}

#[async_trait]
impl Partial for LocalPartial {
    async fn start_at(&mut self, offset: u64) -> StoreResult<bool> {
        self.file = None;
        let path = self.path.clone();
        let opened = blocking(move || open(&path, offset).map_err(cannot("open"))).await?;
        let Some(file) = opened else { return Ok(false) };
        let mut file = tokio::fs::File::from_std(file);
        file.seek(io::SeekFrom::Start(offset)).await.map_err(cannot("open"))?;
        self.file = Some(file);
        Ok(true)
    }

    async fn write(&mut self, bytes: Bytes) -> StoreResult<()> {
        step("partial.write").map_err(cannot("write"))?;
        self.file()?.write_all(&bytes).await.map_err(cannot("write"))
    }

    async fn sync(&mut self) -> StoreResult<()> {
        let file = self.file()?;
        file.flush().await.map_err(cannot("write"))?;
        step("partial.sync").map_err(cannot("sync"))?;
        file.sync_data().await.map_err(cannot("sync"))
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
