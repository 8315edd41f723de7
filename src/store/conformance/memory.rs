//! A blob store in memory that behaves like a remote object store: no blob has a path, a local file is a copy, and
//! there is no disk that bounds it. The suites run on it to prove that nothing above the store relies on local files.

use std::{
    collections::BTreeMap,
    fs,
    ops::Range,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::SystemTime,
};

use async_trait::async_trait;
use bytes::Bytes;
use futures::{
    FutureExt,
    stream::{BoxStream, StreamExt, iter},
};

use super::line::Line;
use crate::store::{
    BlobStore, SpoolFile, Store, StoreError, StoreResult, Workspace,
    blobs::{BlobMeta, ByteStream, Capacity, LocalBlob, OpenBlob, require_key, require_prefix},
    ranges::Ranges,
};

/// Bytes and time of storage by key.
type Blobs = BTreeMap<String, (Bytes, SystemTime)>;

/// Blobs in memory.
#[derive(Default)]
pub struct MemoryBlobStore {
    blobs: Mutex<Blobs>,
    /// What the bytes that are fetched pass.
    line: Option<Arc<Line>>,
}

impl MemoryBlobStore {
    /// Replaces the blobs of a store.
    pub fn under(store: Store) -> Store {
        Store { blobs: Arc::new(Self::default()), ..store }
    }

    /// The same, where the bytes that are fetched pass a line.
    pub fn behind(line: Line, store: Store) -> Store {
        Store { blobs: Arc::new(Self { line: Some(Arc::new(line)), ..Self::default() }), ..store }
    }

    fn blobs(&self) -> MutexGuard<'_, Blobs> {
        self.blobs.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn get(&self, key: &str) -> StoreResult<Option<(Bytes, SystemTime)>> {
        require_key(key)?;
        Ok(self.blobs().get(key).cloned())
    }

    fn download(&self, key: &str, workspace: &Workspace) -> StoreResult<Option<tempfile::TempPath>> {
        let Some((bytes, _)) = self.get(key)? else { return Ok(None) };
        let cannot = |error| StoreError::of_io(error, format!("cannot download {key}"));
        let path = workspace.new_path("download").map_err(cannot)?;
        fs::write(&path, bytes).map_err(cannot)?;
        Ok(Some(path))
    }
}

#[async_trait]
impl BlobStore for MemoryBlobStore {
    fn is_local(&self) -> bool {
        false
    }

    async fn put(&self, key: &str, file: SpoolFile) -> StoreResult<()> {
        require_key(key)?;
        let cannot = |error| StoreError::of_io(error, format!("cannot upload {key}"));
        let bytes = fs::read(file.path()).map_err(cannot)?;
        self.blobs().insert(key.to_owned(), (bytes.into(), SystemTime::now()));
        fs::remove_file(file.path()).map_err(cannot)
    }

    async fn share(&self, key: &str, workspace: &Workspace) -> StoreResult<Option<SpoolFile>> {
        Ok(self.download(key, workspace)?.map(SpoolFile::temporary))
    }

    async fn head(&self, key: &str) -> StoreResult<Option<BlobMeta>> {
        let found = self.get(key)?;
        Ok(found.map(|(bytes, at)| BlobMeta { key: key.to_owned(), size: bytes.len() as u64, last_modified: at }))
    }

    async fn read(&self, key: &str, range: Range<u64>) -> StoreResult<Option<ByteStream>> {
        let Some((bytes, _)) = self.get(key)? else { return Ok(None) };
        let at = |offset: u64| usize::try_from(offset).unwrap_or(usize::MAX).min(bytes.len());
        let part = bytes.slice(at(range.start)..at(range.end));
        Ok(Some(iter([Ok(part)]).boxed()))
    }

    async fn fetch(&self, key: &str, workspace: &Workspace) -> StoreResult<Option<LocalBlob>> {
        let copy = self.download(key, workspace)?;
        if let (Some(line), Some(blob)) = (&self.line, self.head(key).await?) {
            line.pass(blob.size).await;
        }
        Ok(copy.map(LocalBlob::copy))
    }

    async fn open(&self, key: &str, workspace: &Workspace) -> StoreResult<Option<OpenBlob>> {
        let Some((bytes, _)) = self.get(key)? else { return Ok(None) };
        let (length, line) = (bytes.len() as u64, self.line.clone());
        let source = move |range: Range<u64>| {
            let (part, line) = (bytes.slice(range.start as usize..range.end as usize), line.clone());
            async move {
                if let Some(line) = line {
                    line.pass(part.len() as u64).await;
                }
                Ok(Some(part))
            }
            .boxed()
        };
        let of = |path| Ranges::of(path, length, Box::new(source));
        let ranges = workspace.new_path("download").and_then(of);
        let ranges = ranges.map_err(|error| StoreError::of_io(error, format!("cannot open {key}")))?;
        Ok(Some(OpenBlob::of_ranges(ranges)))
    }

    async fn delete(&self, key: &str) -> StoreResult<()> {
        require_key(key)?;
        self.blobs().remove(key);
        Ok(())
    }

    async fn delete_prefix(&self, prefix: &str) -> StoreResult<()> {
        require_prefix(prefix)?;
        self.blobs().retain(|key, _| !key.starts_with(prefix));
        Ok(())
    }

    fn list(&self, prefix: &str) -> BoxStream<'static, StoreResult<BlobMeta>> {
        let blobs = self.blobs();
        let found = blobs
            .iter()
            .filter(|(key, _)| key.starts_with(prefix))
            .map(|(key, (bytes, at))| Ok(BlobMeta { key: key.clone(), size: bytes.len() as u64, last_modified: *at }));
        iter(found.collect::<Vec<_>>()).boxed()
    }

    async fn remove_leftovers(&self) -> StoreResult<()> {
        Ok(())
    }

    async fn capacity(&self) -> StoreResult<Option<Capacity>> {
        Ok(None)
    }

    async fn probe(&self) -> StoreResult<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use tempfile::TempDir;

    use super::*;
    use crate::store::{ManualClock, conformance::FreshStore, open_with_clock};

    async fn fresh_store() -> (TempDir, FreshStore) {
        let folder = tempfile::tempdir().expect("a folder");
        let clock = Arc::new(ManualClock::default());
        let store = open_with_clock(folder.path(), clock.clone()).await.expect("a store");
        (folder, FreshStore { store: MemoryBlobStore::under(store), clock })
    }

    async fn fresh() -> (TempDir, Store) {
        let (folder, fresh) = fresh_store().await;
        (folder, fresh.store)
    }

    crate::blob_conformance!(crate::store::conformance::memory::tests::fresh);
    crate::upload_parts_conformance!(crate::store::conformance::memory::tests::fresh);
    crate::gc_conformance!(crate::store::conformance::memory::tests::fresh_store);
}
