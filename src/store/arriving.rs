//! A blob that is read while it is fetched from an object store.
//!
//! The bytes are kept in a file of the workspace, in blocks. A reader waits for the block that it needs; that block is
//! fetched before all others. Everything else is fetched meanwhile ([`Access::Whole`]) or not at all
//! ([`Access::Parts`]).

use std::{
    fs::File,
    io,
    ops::Range,
    os::unix::fs::FileExt,
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
};

use anyhow::anyhow;
use bytes::Bytes;
use futures::{StreamExt, future::BoxFuture, stream::FuturesUnordered};
use pinstack_science::types::ReadAt;
use tempfile::TempPath;
use tokio::{
    sync::{Notify, OwnedSemaphorePermit},
    task::AbortHandle,
};

use super::{StoreError, StoreResult, blobs::Access, failpoint::step, local::blocking};

/// Bytes of a block: what a reader waits for. The header of a picture is within one, in most cases.
const BLOCK: u64 = 512 << 10;
/// Blocks of one request that no reader waits for. Few, because requests share the line: all that are under way arrive
/// at about the same time.
const RUN: usize = 4;
/// Such requests at a time. Memory: this times [`RUN`] times [`BLOCK`].
const RUNS_AT_ONCE: usize = 4;
/// Requests that readers wait for, beyond those.
const WANTED_AT_ONCE: usize = 4;

/// Fetches a range of the blob; `None` when the blob is gone.
pub(super) type Source = Box<dyn Fn(Range<u64>) -> BoxFuture<'static, StoreResult<Option<Bytes>>> + Send + Sync>;

/// A blob that is being fetched. Dropping it ends that; readers then get an error.
#[derive(Debug)]
pub(super) struct ArrivingFile {
    shared: Arc<Shared>,
    task: AbortHandle,
}

impl ArrivingFile {
    /// Begins to fetch `length` bytes into the file at `path`. `turn` is held until everything is there.
    ///
    /// # Errors
    /// When the file cannot be created.
    pub(super) fn begin(
        path: TempPath,
        length: u64,
        access: Access,
        turn: Option<OwnedSemaphorePermit>,
        source: Source,
    ) -> io::Result<Self> {
        step("s3.download")?;
        let file = File::options().read(true).write(true).create(true).truncate(true).open(&path)?;
        let blocks = usize::try_from(length.div_ceil(BLOCK)).map_err(io::Error::other)?;
        let state = State { blocks: vec![Block::Missing; blocks], ..State::default() };
        let shared = Arc::new(Shared {
            file,
            _path: path,
            length,
            access,
            state: Mutex::new(state),
            changed: Condvar::new(),
            wanted: Notify::new(),
        });
        let fetching = Arc::clone(&shared);
        let task = tokio::spawn(async move {
            let _turn = turn;
            let ending = EndsWithTask(fetching);
            fetch(&ending.0, &source).await;
        });
        Ok(Self { shared, task: task.abort_handle() })
    }

    /// The bytes. Reads wait for them, on a thread that may block.
    pub(super) fn bytes(&self) -> Arc<dyn ReadAt> {
        Arc::clone(&self.shared) as Arc<dyn ReadAt>
    }

    /// Why the bytes cannot be fetched, the first time that it is asked.
    pub(super) fn failure(&self) -> Option<StoreError> {
        match &mut self.shared.state().ended {
            Ended::Failed(error) => error.take(),
            Ended::No | Ended::Closed => None,
        }
    }
}

impl Drop for ArrivingFile {
    fn drop(&mut self) {
        self.task.abort();
        self.shared.end(Ended::Closed);
    }
}

/// Sees to it that no reader waits for a task that has ended, even by a panic.
struct EndsWithTask(Arc<Shared>);

impl Drop for EndsWithTask {
    fn drop(&mut self) {
        self.0.end(Ended::Closed);
    }
}

#[derive(Debug)]
struct Shared {
    file: File,
    _path: TempPath,
    length: u64,
    access: Access,
    state: Mutex<State>,
    /// A block has arrived, or none will.
    changed: Condvar,
    /// A reader waits for a block that is not being fetched yet.
    wanted: Notify,
}

#[derive(Debug, Default)]
struct State {
    blocks: Vec<Block>,
    /// Blocks that readers wait for and that are missing.
    wanted: Vec<usize>,
    /// The block that is read next if reading goes on as it did.
    next: usize,
    ended: Ended,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Block {
    Missing,
    Underway,
    Here,
}

/// Why no more blocks arrive.
#[derive(Debug, Default)]
enum Ended {
    #[default]
    No,
    /// `None` after the error was taken.
    Failed(Option<StoreError>),
    Closed,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn end(&self, ended: Ended) {
        let mut state = self.state();
        if matches!(state.ended, Ended::No) {
            state.ended = ended;
        }
        drop(state);
        self.changed.notify_all();
    }

    /// The blocks of the next request, now marked as being underway. `None` when there are enough requests already.
    fn next_request(&self, running: usize) -> Option<Range<usize>> {
        let mut state = self.state();
        if running < RUNS_AT_ONCE + WANTED_AT_ONCE {
            while let Some(block) = state.wanted.pop() {
                if state.blocks.get(block) == Some(&Block::Missing) {
                    return Some(state.begin(block, 1));
                }
            }
        }
        if self.access == Access::Parts || running >= RUNS_AT_ONCE {
            return None;
        }
        let first = state.missing_from(state.next).or_else(|| state.missing_from(0))?;
        Some(state.begin(first, RUN))
    }

    fn bytes_of(&self, blocks: &Range<usize>) -> Range<u64> {
        blocks.start as u64 * BLOCK..(blocks.end as u64 * BLOCK).min(self.length)
    }

    /// Waits for the block `index`.
    fn wait_for(&self, index: usize) -> io::Result<()> {
        let mut state = self.state();
        state.next = index;
        loop {
            match state.blocks.get(index) {
                Some(Block::Here) => return Ok(()),
                Some(Block::Missing) if !state.wanted.contains(&index) => {
                    state.wanted.push(index);
                    self.wanted.notify_one();
                }
                Some(Block::Missing | Block::Underway) => {}
                None => return Err(io::ErrorKind::UnexpectedEof.into()),
            }
            if !matches!(state.ended, Ended::No) {
                return Err(io::Error::new(io::ErrorKind::NotConnected, "the storage of the service did not send it"));
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

impl State {
    fn missing_from(&self, first: usize) -> Option<usize> {
        let found = self.blocks.iter().skip(first).position(|block| *block == Block::Missing)?;
        Some(first + found)
    }

    /// Marks the missing blocks from `first` on, at most `most`.
    fn begin(&mut self, first: usize, most: usize) -> Range<usize> {
        let rest = self.blocks.iter_mut().skip(first).take(most);
        let marked = rest.take_while(|block| **block == Block::Missing).map(|block| *block = Block::Underway).count();
        first..first + marked
    }

    fn arrived(&mut self, blocks: Range<usize>) {
        for block in self.blocks.get_mut(blocks).unwrap_or_default() {
            *block = Block::Here;
        }
    }
}

impl ReadAt for Shared {
    fn length(&self) -> io::Result<u64> {
        Ok(self.length)
    }

    fn read_at(&self, buffer: &mut [u8], at: u64) -> io::Result<usize> {
        if at >= self.length || buffer.is_empty() {
            return Ok(0);
        }
        let index = at / BLOCK;
        self.wait_for(usize::try_from(index).map_err(io::Error::other)?)?;
        let rest = (self.length.min((index + 1) * BLOCK) - at).min(buffer.len() as u64);
        // at most as long as the buffer
        let within = buffer.get_mut(..rest as usize).unwrap_or_default();
        FileExt::read_at(&self.file, within, at)
    }
}

/// Fetches blocks until all are there, or the first error.
async fn fetch(shared: &Arc<Shared>, source: &Source) {
    let mut running = FuturesUnordered::new();
    loop {
        while let Some(blocks) = shared.next_request(running.len()) {
            running.push(fetch_blocks(shared, source, blocks));
        }
        tokio::select! {
            Some(fetched) = running.next() => {
                if let Err(error) = fetched {
                    return shared.end(Ended::Failed(Some(error)));
                }
            }
            () = shared.wanted.notified() => {}
        }
        if running.is_empty() && shared.state().missing_from(0).is_none() {
            return;
        }
    }
}

async fn fetch_blocks(shared: &Arc<Shared>, source: &Source, blocks: Range<usize>) -> StoreResult<()> {
    let range = shared.bytes_of(&blocks);
    let bytes = source(range.clone()).await?;
    let bytes = bytes.ok_or_else(|| anyhow!("a blob was removed while it was read"))?;
    let (wanted, got) = (range.end - range.start, bytes.len() as u64);
    if got != wanted {
        return Err(StoreError::Unavailable(anyhow!("the bucket sent {got} bytes of a file where it has {wanted}")));
    }
    let to = Arc::clone(shared);
    let write = move || to.file.write_all_at(&bytes, range.start);
    let what = || "cannot write what was downloaded from the bucket".to_owned();
    blocking(move || write().map_err(|error| StoreError::of_io(error, what()))).await?;
    shared.state().arrived(blocks);
    shared.changed.notify_all();
    Ok(())
}

#[cfg(test)]
mod tests;
