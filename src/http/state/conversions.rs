//! Converts stored pictures to other file formats and to pyramids for viewers, with a cache. A slice of a stored zip,
//! warped to the reference slice, is such a picture too.
//!
//! In: a stored picture, its digest, the form. Out: a file. Conversions run one at a time, because each needs a whole
//! picture in memory. Requests for the same picture and format share one conversion.
//!
//! A conversion runs in a task of its own, not in the request: a client that disconnects must not stop work that others
//! wait for. A conversion that no request waits for when its turn comes is dropped. A converted file is kept, because a
//! browser that reloads asks again.
//!
//! Cached files are in the workspace. They are removed when their picture is deleted, when [`KEEP_BYTES`] or
//! [`KEEP_FILES`] is exceeded (least recently used first), and when the process ends. Disk space is reserved before a
//! file is written; what is written counts as used while a client still reads it.

pub mod conversion;
mod convert;
mod making;
pub mod pyramid;
#[cfg(test)]
mod tests;

use std::{
    collections::HashMap,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
};

use tokio::sync::{Semaphore, watch};

use self::{
    conversion::{Conversion, Converted, Form, Outcome},
    making::Maker,
};
use crate::{
    disk_budget::DiskBudget,
    http::{ApiError, ApiResult, background},
    store::Store,
};
use pinstack_science::archive::ArchiveLimits;

/// Most bytes of cached files.
const KEEP_BYTES: u64 = 2 << 30;
/// Most cached files.
const KEEP_FILES: usize = 64;

/// Digest of the stored picture, or the stack of a slice; and the requested form.
type Key = (String, Form);

#[derive(Debug)]
enum Entry {
    /// Being made by a task.
    InProgress(watch::Receiver<Option<Outcome>>),
    /// Cached, with the time of its last use in ticks of a counter.
    Kept(Arc<Converted>, u64),
}

/// The files by key, and the counter of their uses.
#[derive(Debug, Default)]
struct Cache {
    entries: HashMap<Key, Entry>,
    clock: u64,
}

/// The conversions of one process.
pub struct Conversions {
    cache: Mutex<Cache>,
    maker: Maker,
    /// Each conversion needs a whole picture in memory: one at a time.
    turn: Semaphore,
    begun: AtomicUsize,
}

impl Conversions {
    /// Nothing is converted yet. `limits`: those of the zip of a slice.
    pub fn new(store: &Store, disk: &Arc<DiskBudget>, limits: ArchiveLimits) -> Arc<Self> {
        let maker = Maker { store: store.clone(), disk: Arc::clone(disk), limits };
        Arc::new(Self { cache: Mutex::default(), maker, turn: Semaphore::new(1), begun: AtomicUsize::new(0) })
    }

    /// The picture with this digest, stored under the key `source`, as `conversion` says. Made when it is not cached.
    /// For a slice, `source` is the key of the zip and `digest` the id of the stack, from which all that it is warped
    /// with follows.
    ///
    /// # Errors
    /// `insufficient_storage` when the disk is full; `internal` when the picture cannot be read; what is wrong with a
    /// slice.
    pub async fn get(
        self: &Arc<Self>,
        source: &str,
        digest: &str,
        conversion: Conversion,
    ) -> ApiResult<Arc<Converted>> {
        let key = (digest.to_owned(), conversion.form());
        let mut waiting = {
            let mut cache = self.cache();
            if let Some(file) = cache.used(&key) {
                return Ok(file);
            }
            match cache.entries.get(&key) {
                // a task that panicked leaves its entry behind
                Some(Entry::InProgress(waiting)) if waiting.has_changed().is_ok() => waiting.clone(),
                _ => {
                    let (result, waiting) = watch::channel(None);
                    cache.entries.insert(key.clone(), Entry::InProgress(waiting.clone()));
                    let (this, source) = (Arc::clone(self), source.to_owned());
                    background::spawn(async move { this.make(source, key, conversion, result).await });
                    waiting
                }
            }
        };
        // the borrow must not be held across an await
        let outcome = waiting.wait_for(Option::is_some).await.ok().and_then(|outcome| outcome.clone());
        match outcome {
            Some(Ok(file)) => Ok(file),
            Some(Err(fault)) => Err(fault.into()),
            None => Err(ApiError::internal("a conversion ended without a file")),
        }
    }

    /// The converted file, if it is cached. This is a use of it.
    pub fn kept(&self, digest: &str, form: Form) -> Option<Arc<Converted>> {
        self.cache().used(&(digest.to_owned(), form))
    }

    /// Drops the files whose picture was deleted.
    pub async fn forget_deleted(&self) {
        let kept: Vec<(Key, String)> = self.cache().entries.iter().filter_map(kept_source).collect();
        for (key, source) in kept {
            // an error does not mean that it was deleted
            if matches!(self.maker.store.blobs.head(&source).await, Ok(None)) {
                let mut cache = self.cache();
                if matches!(cache.entries.get(&key), Some(Entry::Kept(file, _)) if file.source == source) {
                    cache.entries.remove(&key);
                }
            }
        }
    }

    /// Number of conversions begun since the start of the process.
    pub fn begun(&self) -> usize {
        self.begun.load(Ordering::Relaxed)
    }

    async fn make(&self, source: String, key: Key, conversion: Conversion, result: watch::Sender<Option<Outcome>>) {
        let Ok(_turn) = self.turn.acquire().await else { return };
        {
            let mut cache = self.cache();
            // the entry itself holds one receiver: no request is waiting
            if result.receiver_count() <= 1 {
                cache.entries.remove(&key);
                return;
            }
        }
        self.begun.fetch_add(1, Ordering::Relaxed);
        let outcome = self.maker.make(source, conversion).await;
        {
            let mut cache = self.cache();
            match &outcome {
                Ok(file) => cache.keep(key, Arc::clone(file)),
                Err(_) => _ = cache.entries.remove(&key),
            }
            result.send_replace(Some(outcome));
        }
        self.forget_deleted().await;
        self.cache().evict();
    }

    fn cache(&self) -> MutexGuard<'_, Cache> {
        self.cache.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The key of the stored picture that a cached file was made of.
fn kept_source((key, entry): (&Key, &Entry)) -> Option<(Key, String)> {
    match entry {
        Entry::Kept(file, _) => Some((key.clone(), file.source.clone())),
        Entry::InProgress(_) => None,
    }
}

impl Cache {
    /// The cached file of an entry, which is used now.
    fn used(&mut self, key: &Key) -> Option<Arc<Converted>> {
        let Some(Entry::Kept(file, last)) = self.entries.get_mut(key) else { return None };
        self.clock += 1;
        *last = self.clock;
        Some(Arc::clone(file))
    }

    fn keep(&mut self, key: Key, file: Arc<Converted>) {
        self.clock += 1;
        self.entries.insert(key, Entry::Kept(file, self.clock));
    }

    /// Drops the least recently used files until the limits hold. At least one stays.
    fn evict(&mut self) {
        loop {
            let kept = self.entries.iter().filter_map(|(key, entry)| match entry {
                Entry::Kept(file, used) => Some((*used, file.length, key)),
                Entry::InProgress(_) => None,
            });
            let (files, bytes) = kept.clone().fold((0, 0), |(n, sum), (_, length, _)| (n + 1, sum + length));
            if files <= 1 || (files <= KEEP_FILES && bytes <= KEEP_BYTES) {
                return;
            }
            let Some(oldest) = kept.min_by_key(|(used, ..)| *used).map(|(_, _, key)| key.clone()) else { return };
            self.entries.remove(&oldest);
        }
    }
}
