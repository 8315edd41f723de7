//! Conversions of stored pictures: one at a time, shared by all who ask for the same, and kept for the next.
//!
//! In: a stored picture, its digest, the wanted media type. Out: a file. Why not in the request: a client that hangs up ends
//! its request and not the work, so the work has a task of its own, which holds the turn until the file is made. Requests
//! wait for the task. A client that leaves before the turn has come leaves nothing behind; a file that was made stays, because
//! a browser that reloads asks again.
//!
//! Kept files lie in the spool folder. They go when their picture is deleted, when [`KEEP_BYTES`] or [`KEEP_FILES`] are
//! exceeded (the one used longest ago first), and with the process. Before a file is made its room is reserved in the disk
//! budget; what is written counts as used, also while a client still reads it.

use std::{
    collections::HashMap,
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
};

use tempfile::NamedTempFile;
use tokio::sync::{Semaphore, watch};

use super::convert::{convert, most_bytes};
use crate::{
    contract::{Code, Fault},
    http::{
        background,
        problem::{ApiError, ApiResult},
        state::App,
    },
    store::failpoint::step,
};

/// Most bytes of converted files that are kept.
const KEEP_BYTES: u64 = 2 << 30;
/// Most converted files that are kept.
const KEEP_FILES: usize = 64;

/// A converted file: removed when the last who needs it lets go of it.
#[derive(Debug)]
pub struct Converted {
    file: NamedTempFile,
    source: PathBuf,
    /// Its size.
    pub length: u64,
}

impl Converted {
    /// Where it lies.
    pub fn path(&self) -> &Path {
        self.file.path()
    }
}

/// Digest of the stored picture, and the media type that is wanted.
type Key = (String, &'static str);

/// What a conversion came to; the fault is told to all who wait.
type Outcome = Result<Arc<Converted>, Fault>;

#[derive(Debug)]
enum Entry {
    /// Somebody makes it.
    Making(watch::Receiver<Option<Outcome>>),
    /// It is there; the number grows with each use of any.
    Kept(Arc<Converted>, u64),
}

/// The conversions of one process.
#[derive(Debug)]
pub struct Conversions {
    entries: Mutex<(HashMap<Key, Entry>, u64)>,
    /// Each conversion holds a whole picture in memory: one at a time.
    turn: Semaphore,
    begun: AtomicUsize,
}

impl Default for Conversions {
    fn default() -> Self {
        Self { entries: Mutex::default(), turn: Semaphore::new(1), begun: AtomicUsize::new(0) }
    }
}

impl Conversions {
    /// The picture with this digest, stored at `source`, as `media_type`; made when it is not kept.
    ///
    /// # Errors
    /// `insufficient_storage` when there is no room for it; `internal` when the picture cannot be read.
    pub async fn get(
        self: &Arc<Self>,
        app: &App,
        source: PathBuf,
        digest: &str,
        media_type: &'static str,
    ) -> ApiResult<Arc<Converted>> {
        let key = (digest.to_owned(), media_type);
        let mut waiting = {
            let mut entries = self.entries();
            let (map, clock) = &mut *entries;
            match map.get_mut(&key) {
                Some(Entry::Kept(file, used)) => {
                    *clock += 1;
                    *used = *clock;
                    return Ok(Arc::clone(file));
                }
                // a task that died leaves its entry behind
                Some(Entry::Making(waiting)) if waiting.has_changed().is_ok() => waiting.clone(),
                _ => {
                    let (told, waiting) = watch::channel(None);
                    map.insert(key.clone(), Entry::Making(waiting.clone()));
                    let (this, app) = (Arc::clone(self), app.clone());
                    background::spawn(async move { this.make(&app, source, key, told).await });
                    waiting
                }
            }
        };
        // the borrow must not live across anything that waits
        let outcome = waiting.wait_for(Option::is_some).await.ok().and_then(|outcome| outcome.clone());
        match outcome {
            Some(Ok(file)) => Ok(file),
            Some(Err(fault)) => Err(fault.into()),
            None => Err(ApiError::internal("a conversion ended without a file")),
        }
    }

    /// One that is there already.
    pub fn kept(&self, digest: &str, media_type: &'static str) -> Option<Arc<Converted>> {
        match self.entries().0.get(&(digest.to_owned(), media_type)) {
            Some(Entry::Kept(file, _)) => Some(Arc::clone(file)),
            _ => None,
        }
    }

    /// Lets go of what was made of pictures that are gone.
    pub fn forget_deleted(&self) {
        drop_deleted(&mut self.entries().0);
    }

    /// Conversions that were begun since the start of the process.
    pub fn begun(&self) -> usize {
        self.begun.load(Ordering::Relaxed)
    }

    async fn make(&self, app: &App, source: PathBuf, key: Key, told: watch::Sender<Option<Outcome>>) {
        let Ok(_turn) = self.turn.acquire().await else { return };
        {
            let mut entries = self.entries();
            // the entry holds one receiver: nobody else waits any more
            if told.receiver_count() <= 1 {
                entries.0.remove(&key);
                return;
            }
        }
        self.begun.fetch_add(1, Ordering::Relaxed);
        let outcome = made(app, source, key.1).await;
        let mut entries = self.entries();
        match &outcome {
            Ok(file) => {
                entries.1 += 1;
                let now = entries.1;
                entries.0.insert(key, Entry::Kept(Arc::clone(file), now));
                make_room(&mut entries.0);
            }
            Err(_) => _ = entries.0.remove(&key),
        }
        told.send_replace(Some(outcome));
    }

    fn entries(&self) -> MutexGuard<'_, (HashMap<Key, Entry>, u64)> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Drops the files whose picture was deleted.
fn drop_deleted(map: &mut HashMap<Key, Entry>) {
    map.retain(|_, entry| match entry {
        Entry::Kept(file, _) => file.source.exists(),
        Entry::Making(_) => true,
    });
}

/// Drops the files whose picture was deleted, and then those used longest ago until the limits hold. The one used last stays.
fn make_room(map: &mut HashMap<Key, Entry>) {
    drop_deleted(map);
    loop {
        let kept = map.iter().filter_map(|(key, entry)| match entry {
            Entry::Kept(file, used) => Some((*used, file.length, key)),
            Entry::Making(_) => None,
        });
        let (files, bytes) = kept.clone().fold((0, 0), |(n, sum), (_, length, _)| (n + 1, sum + length));
        if files <= 1 || (files <= KEEP_FILES && bytes <= KEEP_BYTES) {
            return;
        }
        let Some(oldest) = kept.min().map(|(_, _, key)| key.clone()) else { return };
        map.remove(&oldest);
    }
}

async fn made(app: &App, source: PathBuf, media_type: &'static str) -> Outcome {
    let path = source.clone();
    let most = blocking(move || most_bytes(&path)).await?;
    let reserved = app.disk.reserve(most).await.map_err(|error| ApiError::from(error).fault().clone())?;
    let Ok(mut room) = reserved else { return Err(no_room()) };
    let spool = app.blobs.spool_dir().to_owned();
    blocking(move || {
        step("convert.make")?;
        let file = tempfile::Builder::new().prefix("converted-").tempfile_in(&spool)?;
        let length = convert(&source, file.as_file(), media_type)?;
        room.written(length);
        Ok(Arc::new(Converted { file, source, length }))
    })
    .await
}

async fn blocking<T: Send + 'static>(work: impl FnOnce() -> anyhow::Result<T> + Send + 'static) -> Result<T, Fault> {
    let worked = background::spawn_blocking(work).await;
    worked.map_err(|error| internal(&error.into()))?.map_err(|error| cannot(&error))
}

fn cannot(error: &anyhow::Error) -> Fault {
    use std::io::ErrorKind::{QuotaExceeded, StorageFull};
    let is_full = |cause: &std::io::Error| matches!(cause.kind(), StorageFull | QuotaExceeded);
    match error.chain().filter_map(|cause| cause.downcast_ref()).any(is_full) {
        true => no_room(),
        false => internal(error),
    }
}

fn no_room() -> Fault {
    let detail = "the disk of the server has no room to convert the picture; ask for it as it is stored (no Accept), or make \
                  room";
    Fault::new(Code::InsufficientStorage, detail)
}

fn internal(error: &anyhow::Error) -> Fault {
    ApiError::internal(format!("a picture cannot be converted: {error:#}")).fault().clone()
}
