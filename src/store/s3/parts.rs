//! The bytes of resumable uploads as objects: `parts/{upload}/{first byte}-{end}-{generation}`.
//!
//! A bucket has no locks. Requests to one process exclude each other here; those to different processes are told apart
//! by the generation of the upload, which each request increments in the row before it begins (`take_over_upload`):
//!
//! - An offset is recorded only for the newest generation ([`LockedUpload::is_exclusive`] is false), so bytes that an
//!   older request stores after a newer one has begun are never acknowledged.
//! - A request begins at the offset in the row, read after it has incremented the generation. So whatever it stores
//!   replaces, from its first byte on, what older generations stored there: see [`composed`].
//!
//! Any process can therefore continue any upload, and a request that was cut off cannot damage it later.

use std::{
    collections::{BTreeMap, HashSet},
    ops::Range,
    sync::{Arc, Mutex, PoisonError},
};

use anyhow::{Context, anyhow};
use async_trait::async_trait;
use bytes::{Bytes, BytesMut};
use futures::TryStreamExt;
use tokio::task::JoinHandle;
use uuid::Uuid;

use super::{
    bucket::Bucket,
    compose::{Composed, Piece},
};
use crate::store::{
    SpoolFile, StoreError, StoreResult, Workspace,
    parts::{LockedUpload, UploadParts},
};

/// Fewest bytes of an object, but for the last of a request or of a checkpoint: so many that the bucket can copy it as
/// a part of the whole upload. A request holds at most three times as many in memory.
const PIECE: usize = 5 << 20;

/// The parts of uploads in a bucket.
pub struct S3UploadParts {
    bucket: Arc<Bucket>,
    locked: Locked,
}

/// The uploads that this process has locked.
type Locked = Arc<Mutex<HashSet<Uuid>>>;

impl S3UploadParts {
    pub(super) fn new(bucket: Arc<Bucket>) -> Self {
        Self { bucket, locked: Locked::default() }
    }
}

#[async_trait]
impl UploadParts for S3UploadParts {
    async fn lock(&self, id: Uuid) -> StoreResult<Option<Box<dyn LockedUpload>>> {
        if !self.locked.lock().unwrap_or_else(PoisonError::into_inner).insert(id) {
            return Ok(None);
        }
        let lock = Lock { id, locked: Arc::clone(&self.locked) };
        Ok(Some(Box::new(LockedObjects { bucket: Arc::clone(&self.bucket), lock, writer: None })))
    }

    async fn remove(&self, id: Uuid) -> StoreResult<()> {
        self.bucket.delete_below(&folder(id)).await
    }

    async fn list(&self) -> StoreResult<Vec<Uuid>> {
        let names = self.bucket.names_below("parts").await?;
        Ok(names.iter().filter_map(|name| Uuid::try_parse(name).ok()).collect())
    }
}

fn folder(id: Uuid) -> String {
    format!("parts/{id}")
}

/// Frees the upload when dropped.
struct Lock {
    id: Uuid,
    locked: Locked,
}

impl Drop for Lock {
    fn drop(&mut self) {
        self.locked.lock().unwrap_or_else(PoisonError::into_inner).remove(&self.id);
    }
}

/// A locked upload.
struct LockedObjects {
    bucket: Arc<Bucket>,
    lock: Lock,
    /// `None` before [`LockedUpload::resume_at`], and after an error.
    writer: Option<Writer>,
}

/// The bytes of one request that are not stored yet.
struct Writer {
    generation: i64,
    /// Offset of the first byte in `waiting`.
    at: u64,
    waiting: BytesMut,
    /// The object that is being stored.
    running: Option<JoinHandle<StoreResult<()>>>,
}

/// An object with bytes of an upload.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Part {
    range: Range<u64>,
    generation: i64,
}

impl Part {
    /// The key. Objects are listed in the order of their first bytes.
    fn key(&self, id: Uuid) -> String {
        let Range { start, end } = self.range;
        format!("{}/{start:020}-{end:020}-{}", folder(id), self.generation)
    }

    fn of_key(key: &str) -> Option<Self> {
        let mut numbers = key.rsplit('/').next()?.splitn(3, '-');
        let mut next = || numbers.next();
        let range = next()?.parse().ok()?..next()?.parse().ok()?;
        Some(Self { range, generation: next()?.parse().ok()? }).filter(|part| !part.range.is_empty())
    }
}

/// The parts that hold the upload from its first byte on, without gaps: each generation replaces, from its first byte
/// on, what older ones stored. The range of a part whose end was replaced is shorter than its object.
fn composed(parts: impl IntoIterator<Item = Part>) -> Vec<(Part, u64)> {
    let mut generations = BTreeMap::<i64, Vec<Part>>::new();
    for part in parts {
        generations.entry(part.generation).or_default().push(part);
    }
    let mut whole: Vec<(Part, u64)> = Vec::new();
    for mut parts in generations.into_values() {
        parts.sort_by_key(|part| part.range.start);
        let Some(first) = parts.first().map(|part| part.range.start) else { continue };
        if whole.last().map_or(0, |(_, end)| *end) < first {
            // what comes before it is missing
            continue;
        }
        whole.retain(|(part, _)| part.range.start < first);
        if let Some((_, end)) = whole.last_mut() {
            *end = first.min(*end);
        }
        for part in parts {
            if whole.last().map_or(0, |(_, end)| *end) == part.range.start {
                let end = part.range.end;
                whole.push((part, end));
            }
        }
    }
    whole
}

impl LockedObjects {
    async fn composed(&self) -> StoreResult<Vec<(Part, u64)>> {
        let objects = self.bucket.list(&folder(self.lock.id))?;
        let found = objects.try_filter_map(|object| {
            let part = self.bucket.key_of(&object).and_then(|key| Part::of_key(&key));
            std::future::ready(Ok(part))
        });
        Ok(composed(found.try_collect::<Vec<_>>().await?))
    }

    /// The ranges of objects that hold the first `length` bytes. `None` when fewer are stored.
    async fn pieces(&self, length: u64) -> StoreResult<Option<Vec<Piece>>> {
        let parts = self.composed().await?;
        if parts.last().map_or(0, |(_, end)| *end) < length {
            return Ok(None);
        }
        let parts = parts.into_iter().filter(|(part, _)| part.range.start < length);
        let pieces = parts.map(|(part, end)| (part.key(self.lock.id), 0..end.min(length) - part.range.start));
        Ok(Some(pieces.collect()))
    }
}

impl Writer {
    /// Begins to store `length` of the bytes that wait, as soon as the object before is stored. The next ones can
    /// arrive meanwhile.
    async fn store(&mut self, bucket: &Arc<Bucket>, id: Uuid, length: usize) -> StoreResult<()> {
        self.stored().await?;
        let bytes = self.waiting.split_to(length).freeze();
        let end = self.at + length as u64;
        let key = Part { range: self.at..end, generation: self.generation }.key(id);
        let bucket = Arc::clone(bucket);
        self.running = Some(tokio::spawn(async move { bucket.put(&key, bytes).await }));
        self.at = end;
        Ok(())
    }

    async fn stored(&mut self) -> StoreResult<()> {
        match self.running.take() {
            Some(running) => running.await.context("the task that stores a part of an upload panicked")?,
            None => Ok(()),
        }
    }

    /// Stores pieces, and leaves enough for another one, or stores everything.
    async fn flush(&mut self, bucket: &Arc<Bucket>, id: Uuid, everything: bool) -> StoreResult<()> {
        while self.waiting.len() >= 2 * PIECE {
            self.store(bucket, id, PIECE).await?;
        }
        if !everything {
            return Ok(());
        }
        if !self.waiting.is_empty() {
            self.store(bucket, id, self.waiting.len()).await?;
        }
        self.stored().await
    }
}

#[async_trait]
impl LockedUpload for LockedObjects {
    fn is_exclusive(&self) -> bool {
        false
    }

    async fn length(&self) -> StoreResult<u64> {
        Ok(self.composed().await?.last().map_or(0, |(_, end)| *end))
    }

    async fn resume_at(&mut self, offset: u64, generation: i64) -> StoreResult<bool> {
        self.writer = None;
        if offset > 0 && self.length().await? < offset {
            return Ok(false);
        }
        self.writer = Some(Writer { generation, at: offset, waiting: BytesMut::new(), running: None });
        Ok(true)
    }

    async fn append(&mut self, bytes: Bytes) -> StoreResult<()> {
        // after an error it stays away: what follows would leave a gap
        let mut writer = self.writer.take().ok_or_else(not_begun)?;
        writer.waiting.extend_from_slice(&bytes);
        writer.flush(&self.bucket, self.lock.id, false).await?;
        self.writer = Some(writer);
        Ok(())
    }

    async fn sync(&mut self) -> StoreResult<()> {
        let mut writer = self.writer.take().ok_or_else(not_begun)?;
        writer.flush(&self.bucket, self.lock.id, true).await?;
        self.writer = Some(writer);
        Ok(())
    }

    async fn become_blob(&mut self, length: u64, key: &str) -> StoreResult<bool> {
        let Some(pieces) = self.pieces(length).await? else { return Ok(false) };
        match self.bucket.compose(key, pieces).await? {
            Composed::Done => Ok(true),
            Composed::Gone | Composed::Unable => Ok(false),
        }
    }

    async fn assemble(&mut self, length: u64, workspace: &Workspace) -> StoreResult<Option<SpoolFile>> {
        let Some(pieces) = self.pieces(length).await? else { return Ok(None) };
        let path = workspace
            .new_path("assembled")
            .map_err(|error| StoreError::of_io(error, "cannot assemble an upload".into()))?;
        let whole = self.bucket.download(pieces, &path).await?;
        Ok(whole.then(|| SpoolFile::temporary(path)))
    }
}

fn not_begun() -> StoreError {
    anyhow!("an upload was written before its offset was set, or after an error").into()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(start: u64, end: u64, generation: i64) -> Part {
        Part { range: start..end, generation }
    }

    fn ends(parts: &[Part]) -> Vec<(u64, u64, i64)> {
        // in any order
        let forwards = composed(parts.to_vec());
        assert_eq!(forwards, composed(parts.iter().rev().cloned().collect::<Vec<_>>()));
        forwards.into_iter().map(|(part, end)| (part.range.start, end, part.generation)).collect()
    }

    #[test]
    fn a_key_says_what_it_holds() {
        let id = Uuid::now_v7();
        let one = part(8 << 20, 20_000_000_000, 12);
        assert_eq!(Part::of_key(&one.key(id)), Some(one));
        for other in ["parts/x/1-2", "parts/x/2-2-1", "parts/x/a-b-c", ""] {
            assert_eq!(Part::of_key(other), None, "{other}");
        }
    }

    #[test]
    fn a_newer_request_replaces_what_an_older_one_stored_from_its_first_byte_on() {
        assert_eq!(ends(&[part(0, 8, 1), part(8, 16, 1)]), [(0, 8, 1), (8, 16, 1)]);
        // the second piece of the first request was stored after the second request had begun
        assert_eq!(ends(&[part(0, 8, 1), part(8, 16, 1), part(8, 12, 2)]), [(0, 8, 1), (8, 12, 2)]);
        assert_eq!(ends(&[part(0, 8, 1), part(6, 9, 2)]), [(0, 6, 1), (6, 9, 2)]);
        assert_eq!(ends(&[part(0, 8, 1), part(0, 4, 2)]), [(0, 4, 2)]);
    }

    #[test]
    fn nothing_counts_beyond_a_gap() {
        assert_eq!(ends(&[part(8, 16, 1)]), []);
        assert_eq!(ends(&[part(0, 8, 1), part(9, 16, 1)]), [(0, 8, 1)]);
        assert_eq!(ends(&[part(0, 8, 1), part(12, 16, 2), part(8, 10, 3)]), [(0, 8, 1), (8, 10, 3)]);
    }
}
