//! Blobs as objects: `{prefix}/{key}`.

use std::{
    io,
    ops::Range,
    path::Path,
    sync::{Arc, Mutex, PoisonError},
    time::{Duration, Instant},
};

use async_trait::async_trait;
use futures::{
    FutureExt,
    stream::{BoxStream, StreamExt, TryStreamExt, iter},
};
use object_store::{ObjectMeta, signer::SignedUrlOptions};
use tempfile::TempPath;

use super::{bucket::Bucket, owner::MARK};
use crate::store::{
    SpoolFile, StoreError, StoreResult, Workspace,
    blobs::{
        BlobMeta, BlobStore, ByteStream, Capacity, LocalBlob, OpenBlob, RESULTS, SignedAnswer, UPLOADS, require_key,
        require_prefix,
    },
    folder::{blocking, remove},
    ranges::Ranges,
};

/// Key of the object that [`BlobStore::probe`] writes.
const PROBE: &str = "pinstack.probe";
/// Between two writes of it. Probes in between only ask: `/readyz` is asked every few seconds, and writes cost money.
const PROBE_EVERY: Duration = Duration::from_secs(60);

/// Blobs in a bucket.
pub struct S3BlobStore {
    bucket: Arc<Bucket>,
    /// When the last probe was written.
    probed: Mutex<Option<Instant>>,
}

impl S3BlobStore {
    pub(super) fn new(bucket: Arc<Bucket>) -> Self {
        Self { bucket, probed: Mutex::default() }
    }

    /// A copy of a blob in the workspace. `None` when there is no such blob.
    async fn download(&self, key: &str, workspace: &Workspace) -> StoreResult<Option<TempPath>> {
        let Some(object) = self.bucket.head(key).await? else { return Ok(None) };
        let path = workspace.new_path("download").map_err(|error| cannot_use(error, key))?;
        let whole = self.bucket.download(vec![(key.to_owned(), 0..object.size)], &path).await?;
        Ok(whole.then_some(path))
    }

    fn probe_is_due(&self) -> bool {
        let probed = self.probed.lock().unwrap_or_else(PoisonError::into_inner);
        probed.is_none_or(|at| at.elapsed() >= PROBE_EVERY)
    }
}

#[async_trait]
impl BlobStore for S3BlobStore {
    fn is_local(&self) -> bool {
        false
    }

    async fn put(&self, key: &str, file: SpoolFile) -> StoreResult<()> {
        let copied = match file.origin() {
            Some(origin) => self.bucket.copy(origin, key, size_of(file.path(), key).await?).await?,
            None => false,
        };
        if !copied {
            self.bucket.put_file(key, file.path()).await?;
        }
        let (path, key) = (file.path().to_owned(), key.to_owned());
        blocking(move || remove(&path).map_err(|error| cannot_use(error, &key))).await
    }

    async fn signed_url(&self, key: &str, valid: Duration, answer: &SignedAnswer) -> StoreResult<Option<String>> {
        let options = SignedUrlOptions::new().with_query([
            ("response-content-type", answer.media_type.as_str()),
            ("response-content-disposition", answer.disposition.as_str()),
            // as the service says it: the file can be deleted
            ("response-cache-control", "private, no-cache"),
        ]);
        self.bucket.signed_url(key, valid, &options).await.map(Some)
    }

    async fn share(&self, key: &str, workspace: &Workspace) -> StoreResult<Option<SpoolFile>> {
        require_key(key)?;
        Ok(self.download(key, workspace).await?.map(|path| SpoolFile::copy_of(path, key)))
    }

    async fn head(&self, key: &str) -> StoreResult<Option<BlobMeta>> {
        Ok(self.bucket.head(key).await?.map(|object| meta_of(key.to_owned(), &object)))
    }

    async fn read(&self, key: &str, range: Range<u64>) -> StoreResult<Option<ByteStream>> {
        self.bucket.read(key, range).await
    }

    async fn fetch(&self, key: &str, workspace: &Workspace) -> StoreResult<Option<LocalBlob>> {
        require_key(key)?;
        Ok(self.download(key, workspace).await?.map(LocalBlob::copy))
    }

    async fn open(&self, key: &str, workspace: &Workspace) -> StoreResult<Option<OpenBlob>> {
        let Some(object) = self.bucket.head(key).await? else { return Ok(None) };
        let (bucket, name) = (Arc::clone(&self.bucket), key.to_owned());
        let source = move |range: Range<u64>| {
            let (bucket, name) = (Arc::clone(&bucket), name.clone());
            async move { bucket.get(&name, range).await }.boxed()
        };
        let of = |path| Ranges::of(path, object.size, Box::new(source));
        let ranges = workspace.new_path("download").and_then(of).map_err(|error| cannot_use(error, key))?;
        Ok(Some(OpenBlob::of_ranges(ranges)))
    }

    async fn delete(&self, key: &str) -> StoreResult<()> {
        self.bucket.delete(key).await
    }

    async fn delete_prefix(&self, prefix: &str) -> StoreResult<()> {
        require_prefix(prefix)?;
        self.bucket.delete_below(prefix.trim_end_matches('/')).await
    }

    fn list(&self, prefix: &str) -> BoxStream<'static, StoreResult<BlobMeta>> {
        // the bucket has other objects besides blobs
        let prefixes = if prefix.is_empty() { vec![UPLOADS, RESULTS] } else { vec![prefix] };
        let mut lists = Vec::new();
        for prefix in prefixes {
            let bucket = Arc::clone(&self.bucket);
            let listed = require_prefix(prefix).and_then(|()| bucket.list(prefix.trim_end_matches('/')));
            lists.push(match listed {
                Err(error) => iter([Err(error)]).boxed(),
                Ok(listed) => listed
                    .try_filter_map(move |object| {
                        let blob = bucket.key_of(&object).map(|key| meta_of(key, &object));
                        std::future::ready(Ok(blob))
                    })
                    .boxed(),
            });
        }
        iter(lists).flatten().boxed()
    }

    async fn remove_leftovers(&self) -> StoreResult<()> {
        // uploads of objects that were not completed are for the lifecycle rule of the bucket
        Ok(())
    }

    async fn capacity(&self) -> StoreResult<Option<Capacity>> {
        Ok(None)
    }

    async fn probe(&self) -> StoreResult<()> {
        if !self.probe_is_due() {
            return self.bucket.head(MARK).await.map(drop);
        }
        self.bucket.put(PROBE, "a probe of /readyz".into()).await?;
        *self.probed.lock().unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
        Ok(())
    }
}

async fn size_of(path: &Path, key: &str) -> StoreResult<u64> {
    let metadata = tokio::fs::metadata(path).await.map_err(|error| cannot_use(error, key))?;
    Ok(metadata.len())
}

fn cannot_use(error: io::Error, key: &str) -> StoreError {
    StoreError::of_io(error, format!("cannot use the local file of {key}"))
}

fn meta_of(key: String, object: &ObjectMeta) -> BlobMeta {
    BlobMeta { key, size: object.size, last_modified: object.last_modified.into() }
}
