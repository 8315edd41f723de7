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

mod making;
#[cfg(test)]
mod tests;

use std::{
    collections::HashMap,
    path::Path,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
};

use tempfile::NamedTempFile;
use tokio::sync::{Semaphore, watch};

use super::pyramid::Colours;
use crate::{
    contract::{Fault, artifact::FileFormat, options::StackOptions},
    http::{
        background,
        problem::{ApiError, ApiResult},
        state::App,
    },
};
use pinstack_science::types::profile::ProfileInput;

/// Most bytes of cached files.
const KEEP_BYTES: u64 = 2 << 30;
/// Most cached files.
const KEEP_FILES: usize = 64;

/// A converted file, removed when the last reference is dropped.
#[derive(Debug)]
pub struct Converted {
    file: NamedTempFile,
    /// Key of the stored picture.
    source: String,
    /// Its size, bytes.
    pub length: u64,
}

impl Converted {
    /// Its path.
    pub fn path(&self) -> &Path {
        self.file.path()
    }
}

/// What a stored picture is converted to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Form {
    /// A file of another format.
    File(FileFormat),
    /// All resolutions, for a viewer.
    Pyramid(Colours),
    /// The same of the slice with this index in the order of fusion.
    Slice(usize),
}

/// What a slice of a stack is warped with.
#[derive(Debug)]
pub struct SliceRecipe {
    /// The revision of the profile that the stack was fused with.
    pub profile: ProfileInput,
    /// The options of the stack.
    pub options: StackOptions,
    /// Index of the slice in the order of fusion.
    pub index: usize,
}

/// How a file is made.
#[derive(Debug, Clone)]
pub enum Conversion {
    /// The stored picture in another format.
    File(FileFormat),
    /// The pyramid of the stored picture.
    Pyramid(Colours),
    /// The pyramid of a slice in the stored zip.
    Slice(Arc<SliceRecipe>),
}

impl Conversion {
    fn form(&self) -> Form {
        match self {
            Self::File(format) => Form::File(*format),
            Self::Pyramid(colours) => Form::Pyramid(*colours),
            Self::Slice(recipe) => Form::Slice(recipe.index),
        }
    }
}

/// Digest of the stored picture, or the stack of a slice; and the requested form.
type Key = (String, Form);

/// The result of a conversion. A fault is reported to all waiting requests.
type Outcome = Result<Arc<Converted>, Fault>;

#[derive(Debug)]
enum Entry {
    /// Being made by a task.
    InProgress(watch::Receiver<Option<Outcome>>),
    /// Cached, with the time of its last use in ticks of a counter.
    Kept(Arc<Converted>, u64),
}

/// The conversions of one process.
#[derive(Debug)]
pub struct Conversions {
    entries: Mutex<(HashMap<Key, Entry>, u64)>,
    /// Each conversion needs a whole picture in memory: one at a time.
    turn: Semaphore,
    begun: AtomicUsize,
}

impl Default for Conversions {
    fn default() -> Self {
        Self { entries: Mutex::default(), turn: Semaphore::new(1), begun: AtomicUsize::new(0) }
    }
}

impl Conversions {
    /// The picture with this digest, stored under the key `source`, as `conversion` says. Made when it is not cached.
    /// For a slice, `source` is the key of the zip and `digest` the id of the stack, from which all that it is warped
    /// with follows.
    ///
    /// # Errors
    /// `insufficient_storage` when the disk is full; `internal` when the picture cannot be read; what is wrong with a
    /// slice.
    pub async fn get(
        self: &Arc<Self>,
        app: &App,
        source: &str,
        digest: &str,
        conversion: Conversion,
    ) -> ApiResult<Arc<Converted>> {
        let key = (digest.to_owned(), conversion.form());
        let mut waiting = {
            let mut entries = self.entries();
            let (map, clock) = &mut *entries;
            if let Some(file) = used(map, clock, &key) {
                return Ok(file);
            }
            match map.get(&key) {
                // a task that panicked leaves its entry behind
                Some(Entry::InProgress(waiting)) if waiting.has_changed().is_ok() => waiting.clone(),
                _ => {
                    let (result, waiting) = watch::channel(None);
                    map.insert(key.clone(), Entry::InProgress(waiting.clone()));
                    let (this, app, source) = (Arc::clone(self), app.clone(), source.to_owned());
                    background::spawn(async move { this.make(&app, source, key, conversion, result).await });
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
        let mut entries = self.entries();
        let (map, clock) = &mut *entries;
        used(map, clock, &(digest.to_owned(), form))
    }

    /// Drops the files whose picture was deleted.
    pub async fn forget_deleted(&self, app: &App) {
        let kept: Vec<(Key, String)> = self.entries().0.iter().filter_map(kept_source).collect();
        for (key, source) in kept {
            // an error does not mean that it was deleted
            if matches!(app.store.blobs.head(&source).await, Ok(None)) {
                let mut entries = self.entries();
                if matches!(entries.0.get(&key), Some(Entry::Kept(file, _)) if file.source == source) {
                    entries.0.remove(&key);
                }
            }
        }
    }

    /// Number of conversions begun since the start of the process.
    pub fn begun(&self) -> usize {
        self.begun.load(Ordering::Relaxed)
    }

    async fn make(
        &self,
        app: &App,
        source: String,
        key: Key,
        conversion: Conversion,
        result: watch::Sender<Option<Outcome>>,
    ) {
        let Ok(_turn) = self.turn.acquire().await else { return };
        {
            let mut entries = self.entries();
            // the entry itself holds one receiver: no request is waiting
            if result.receiver_count() <= 1 {
                entries.0.remove(&key);
                return;
            }
        }
        self.begun.fetch_add(1, Ordering::Relaxed);
        let outcome = making::made(app, source, conversion).await;
        {
            let mut entries = self.entries();
            match &outcome {
                Ok(file) => {
                    entries.1 += 1;
                    let now = entries.1;
                    entries.0.insert(key, Entry::Kept(Arc::clone(file), now));
                }
                Err(_) => _ = entries.0.remove(&key),
            }
            result.send_replace(Some(outcome));
        }
        self.forget_deleted(app).await;
        evict(&mut self.entries().0);
    }

    fn entries(&self) -> MutexGuard<'_, (HashMap<Key, Entry>, u64)> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The key of the stored picture that a cached file was made of.
fn kept_source((key, entry): (&Key, &Entry)) -> Option<(Key, String)> {
    match entry {
        Entry::Kept(file, _) => Some((key.clone(), file.source.clone())),
        Entry::InProgress(_) => None,
    }
}

/// The cached file of an entry, which is used now.
fn used(map: &mut HashMap<Key, Entry>, clock: &mut u64, key: &Key) -> Option<Arc<Converted>> {
    let Some(Entry::Kept(file, last)) = map.get_mut(key) else { return None };
    *clock += 1;
    *last = *clock;
    Some(Arc::clone(file))
}

/// Drops the least recently used files until the limits hold. At least one stays.
fn evict(map: &mut HashMap<Key, Entry>) {
    loop {
        let kept = map.iter().filter_map(|(key, entry)| match entry {
            Entry::Kept(file, used) => Some((*used, file.length, key)),
            Entry::InProgress(_) => None,
        });
        let (files, bytes) = kept.clone().fold((0, 0), |(n, sum), (_, length, _)| (n + 1, sum + length));
        if files <= 1 || (files <= KEEP_FILES && bytes <= KEEP_BYTES) {
            return;
        }
        let Some(oldest) = kept.min_by_key(|(used, ..)| *used).map(|(_, _, key)| key.clone()) else { return };
        map.remove(&oldest);
    }
}
