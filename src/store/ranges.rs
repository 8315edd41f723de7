//! A blob of an object store of which only parts are read: the headers of its pictures, or one of its slices.
//!
//! In: its length, and a function that fetches a range. Out: its bytes by offset. The blocks that were read are kept in
//! a file of the workspace, so each is fetched about once: two readers that want it at the same time both fetch it.

use std::{
    fs::File,
    io,
    ops::Range,
    os::unix::fs::FileExt,
    sync::{Mutex, MutexGuard, PoisonError},
};

use anyhow::anyhow;
use bytes::Bytes;
use futures::future::BoxFuture;
use pinstack_science::types::ReadAt;
use tempfile::TempPath;
use tokio::runtime::Handle;

use super::{StoreError, StoreResult, failpoint::step};

/// Bytes of a block. The header of a picture is within one, in most cases.
const BLOCK: u64 = 512 << 10;

/// Fetches a range of the blob; `None` when the blob is gone.
pub(super) type Source = Box<dyn Fn(Range<u64>) -> BoxFuture<'static, StoreResult<Option<Bytes>>> + Send + Sync>;

/// The bytes of the blob. A failure ends them: no reader waits for the storage again.
pub(super) struct Ranges {
    source: Source,
    /// Where the requests run, while a reader waits on a thread that may block.
    runtime: Handle,
    length: u64,
    file: File,
    _path: TempPath,
    state: Mutex<State>,
}

struct State {
    /// Whether a block is in the file.
    here: Vec<bool>,
    has_failed: bool,
    /// Why, until it was told.
    failure: Option<StoreError>,
}

impl std::fmt::Debug for Ranges {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Ranges").field("length", &self.length).finish_non_exhaustive()
    }
}

impl Ranges {
    /// Prepares to read a blob of `length` bytes, with the file at `path` for its blocks.
    pub(super) fn of(path: TempPath, length: u64, source: Source) -> io::Result<Self> {
        step("s3.download")?;
        let file = File::options().read(true).write(true).create(true).truncate(true).open(&path)?;
        let blocks = usize::try_from(length.div_ceil(BLOCK)).map_err(io::Error::other)?;
        let state = Mutex::new(State { here: vec![false; blocks], has_failed: false, failure: None });
        Ok(Self { source, runtime: Handle::current(), length, file, _path: path, state })
    }

    /// Why a read failed, if the storage is to blame. Tells it once.
    pub(super) fn failure(&self) -> Option<StoreError> {
        self.state().failure.take()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sees to it that the block `index` is in the file.
    fn require(&self, index: u64) -> io::Result<()> {
        let at = usize::try_from(index).map_err(io::Error::other)?;
        let (is_here, has_failed) = {
            let state = self.state();
            (state.here.get(at) == Some(&true), state.has_failed)
        };
        if is_here {
            return Ok(());
        }
        let range = index * BLOCK..self.length.min((index + 1) * BLOCK);
        if !has_failed {
            let fetched = self.runtime.block_on(self.fetch(range));
            let mut state = self.state();
            match fetched {
                Ok(()) => {
                    state.here.get_mut(at).into_iter().for_each(|here| *here = true);
                    return Ok(());
                }
                Err(error) => (state.has_failed, state.failure) = (true, Some(error)),
            }
        }
        Err(io::Error::new(io::ErrorKind::NotConnected, "the storage of the service did not send it"))
    }

    async fn fetch(&self, range: Range<u64>) -> StoreResult<()> {
        let bytes = (self.source)(range.clone()).await?;
        let bytes = bytes.ok_or_else(|| anyhow!("a blob was removed while it was read"))?;
        let (wanted, got) = (range.end - range.start, bytes.len() as u64);
        if got != wanted {
            return Err(StoreError::Unavailable(anyhow!(
                "the bucket sent {got} bytes of a file where it has {wanted}"
            )));
        }
        let written = self.file.write_all_at(&bytes, range.start);
        written.map_err(|error| StoreError::of_io(error, "cannot write what was downloaded from the bucket".into()))
    }
}

impl ReadAt for Ranges {
    fn length(&self) -> io::Result<u64> {
        Ok(self.length)
    }

    fn read_at(&self, buffer: &mut [u8], at: u64) -> io::Result<usize> {
        if at >= self.length || buffer.is_empty() {
            return Ok(0);
        }
        let index = at / BLOCK;
        self.require(index)?;
        let rest = (self.length.min((index + 1) * BLOCK) - at).min(buffer.len() as u64);
        // at most as long as the buffer
        let within = buffer.get_mut(..rest as usize).unwrap_or_default();
        FileExt::read_at(&self.file, within, at)
    }
}

#[cfg(test)]
mod tests;
