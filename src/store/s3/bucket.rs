//! The bucket: what the engine asks of it, with keys of the service instead of paths, and errors of the store.
//!
//! Every error but "there is no such object" is [`StoreError::Unavailable`]: the bucket is on another machine, and what
//! it refuses (a key that expired, a quota) is for the operator to mend, while jobs wait and clients try again.

use std::{fs::File, ops::Range, os::unix::fs::FileExt, path::Path as FilePath, sync::Arc, time::Duration};

use anyhow::{Context, anyhow, bail};
use bytes::Bytes;
use futures::{
    StreamExt, TryStreamExt,
    stream::{self, BoxStream, FuturesUnordered},
};
use object_store::{
    BackoffConfig, GetOptions, GetRange, MultipartUpload, ObjectMeta, ObjectStore, ObjectStoreExt, PutMode, PutOptions,
    RetryConfig, UploadPart,
    aws::{AmazonS3, AmazonS3Builder, AmazonS3ConfigKey},
    client::HttpClient,
    path::Path,
    signer::{Method, SignedUrlOptions, Signer},
};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::{S3Location, credentials, http::Connector};
use crate::store::{
    StoreError, StoreResult,
    blobs::{ByteStream, require_key},
    failpoint::step,
    folder::blocking,
};

/// Bytes of one request, unless the object would have too many parts. S3 requires at least 5 MiB.
const PART: u64 = 8 << 20;
/// Most parts of an object; S3 allows 10,000.
pub(super) const MOST_PARTS: u64 = 9_000;
/// Requests of one file at a time. Memory of a file: this times the size of a part, and one part more.
const AT_ONCE: usize = 4;
/// Files that a process sends or fetches in parts at a time; others wait. Bounds the memory of all.
const FILES_AT_ONCE: usize = 8;
/// How long a request is repeated before the bucket counts as unavailable.
pub(super) const RETRY: Duration = Duration::from_secs(20);

/// A bucket, or the part of it below a prefix.
pub(super) struct Bucket {
    pub(super) store: AmazonS3,
    /// For requests that `store` has no call for; it signs them.
    pub(super) http: HttpClient,
    /// Its name.
    pub(super) name: String,
    /// False when the environment demands checksums of parts: a part that the server copies has none.
    pub(super) composes: bool,
    /// Empty, or ends with `/`.
    prefix: String,
    /// One permit per file of [`FILES_AT_ONCE`].
    files: Arc<Semaphore>,
}

impl Bucket {
    /// Prepares the connection; the first request makes it.
    ///
    /// # Errors
    /// When the settings are contradictory, or a file cannot be read.
    pub(super) fn connect(location: &S3Location) -> anyhow::Result<Self> {
        let (bucket, prefix) = location.url.parts()?;
        let retry = RetryConfig {
            backoff: BackoffConfig { max_backoff: Duration::from_secs(3), ..BackoffConfig::default() },
            max_retries: 10,
            retry_timeout: RETRY,
        };
        let connector = Connector::new(location.ca_file.as_deref())?;
        let http = connector.client();
        // keys of the environment or the machine, as other programs use them
        let mut builder =
            AmazonS3Builder::from_env().with_http_connector(connector).with_retry(retry).with_bucket_name(bucket);
        if let Some(region) = &location.region {
            builder = builder.with_region(region);
        }
        if let Some(endpoint) = &location.endpoint {
            let is_plain = endpoint.starts_with("http://");
            if !is_plain && !endpoint.starts_with("https://") {
                bail!("storage_endpoint must begin with https:// or http://, for example https://s3.lab.example:9000");
            }
            // with an endpoint of its own, the name of the bucket is in the path
            builder = builder.with_endpoint(endpoint.trim_end_matches('/')).with_allow_http(is_plain);
        }
        if let Some(file) = &location.credentials_file {
            let key = credentials::read(file)?;
            builder = builder.with_access_key_id(key.id).with_secret_access_key(key.secret);
            if let Some(token) = key.token {
                builder = builder.with_token(token);
            }
        }
        let composes = builder.get_config_value(&AmazonS3ConfigKey::Checksum).is_none();
        let store = builder.build().map_err(|error| anyhow!(error).context("storage_url: cannot use the bucket"))?;
        let prefix = if prefix.is_empty() { String::new() } else { format!("{prefix}/") };
        Ok(Self {
            store,
            http,
            name: bucket.to_owned(),
            composes,
            prefix,
            files: Arc::new(Semaphore::new(FILES_AT_ONCE)),
        })
    }

    pub(super) fn path(&self, key: &str) -> StoreResult<Path> {
        require_key(key)?;
        Ok(Path::from(format!("{}{key}", self.prefix)))
    }

    /// The key of an object below the prefix.
    pub(super) fn key_of(&self, object: &ObjectMeta) -> Option<String> {
        object.location.as_ref().strip_prefix(&self.prefix).map(str::to_owned)
    }

    /// Waits until this process may send or fetch one more file in parts.
    pub(super) async fn turn(&self) -> StoreResult<OwnedSemaphorePermit> {
        Ok(Arc::clone(&self.files).acquire_owned().await.context("the bucket is closed")?)
    }

    /// What the bucket says of an object; `None` when there is none.
    pub(super) async fn head(&self, key: &str) -> StoreResult<Option<ObjectMeta>> {
        found(self.store.head(&self.path(key)?).await, || format!("look up {key}"))
    }

    /// Bytes of an object as they arrive; `None` when there is none.
    pub(super) async fn read(&self, key: &str, range: Range<u64>) -> StoreResult<Option<ByteStream>> {
        if range.is_empty() {
            return Ok(self.head(key).await?.map(|_| stream::empty().boxed()));
        }
        let options = GetOptions { range: Some(GetRange::Bounded(range)), ..GetOptions::default() };
        let answer = found(self.store.get_opts(&self.path(key)?, options).await, || format!("read {key}"))?;
        Ok(answer.map(|answer| answer.into_stream().map_err(std::io::Error::other).boxed()))
    }

    /// Bytes of a small object, or of a part of one; `None` when there is none.
    pub(super) async fn get(&self, key: &str, range: Range<u64>) -> StoreResult<Option<Bytes>> {
        found(self.store.get_range(&self.path(key)?, range).await, || format!("read {key}"))
    }

    /// A URL of an object that is valid for some time, without a request.
    pub(super) async fn signed_url(
        &self,
        key: &str,
        valid: Duration,
        options: &SignedUrlOptions,
    ) -> StoreResult<String> {
        let url = self.store.signed_url_opts(Method::GET, &self.path(key)?, valid, options).await;
        url.map(String::from).map_err(cannot(|| format!("sign a URL of {key}")))
    }

    /// Stores a small object, in place of one that is there.
    pub(super) async fn put(&self, key: &str, bytes: Bytes) -> StoreResult<()> {
        step("s3.put").map_err(cannot_change)?;
        self.store.put(&self.path(key)?, bytes.into()).await.map(drop).map_err(cannot(|| format!("store {key}")))
    }

    /// Stores a small object unless there is one. False: there is one.
    pub(super) async fn create(&self, key: &str, bytes: Bytes) -> StoreResult<bool> {
        step("s3.create").map_err(cannot_change)?;
        let options = PutOptions { mode: PutMode::Create, ..PutOptions::default() };
        match self.store.put_opts(&self.path(key)?, bytes.into(), options).await {
            Ok(_) => Ok(true),
            Err(object_store::Error::AlreadyExists { .. } | object_store::Error::Precondition { .. }) => Ok(false),
            Err(error) => Err(cannot(|| format!("store {key}"))(error)),
        }
    }

    /// Stores a file as an object, in parts if it is large, and compares its size with what the bucket then says. A
    /// bucket that acknowledges and does not store is noticed here.
    pub(super) async fn put_file(&self, key: &str, file: &FilePath) -> StoreResult<()> {
        let what = || format!("cannot read the file for {key}");
        let file = File::open(file).and_then(|file| Ok((file.metadata()?.len(), Arc::new(file))));
        let (size, file) = file.map_err(|error| StoreError::of_io(error, what()))?;
        if size <= PART {
            self.put(key, read_at(&file, 0..size, key).await?).await?;
        } else {
            let path = self.path(key)?;
            let _turn = self.turn().await?;
            step("s3.begin").map_err(cannot_change)?;
            let begun = self.store.put_multipart(&path).await;
            let mut upload = begun.map_err(cannot(|| format!("begin to store {key}")))?;
            if let Err(error) = put_parts(&mut *upload, &file, size, key).await {
                // what remains is removed by the lifecycle rule of the bucket
                if let Err(error) = upload.abort().await {
                    tracing::warn!(%error, key, "the parts of a failed upload stay in the bucket");
                }
                return Err(error);
            }
        }
        self.require_size(key, size).await
    }

    pub(super) async fn require_size(&self, key: &str, size: u64) -> StoreResult<()> {
        let stored = self.head(key).await?.map(|object| object.size);
        if stored == Some(size) {
            return Ok(());
        }
        let stored = stored.map_or("does not have it".to_owned(), |stored| format!("has {stored} bytes of it"));
        Err(StoreError::Unavailable(anyhow!("the bucket acknowledged {key} with {size} bytes, and then {stored}")))
    }

    /// Removes an object, if it exists.
    pub(super) async fn delete(&self, key: &str) -> StoreResult<()> {
        step("s3.remove").map_err(cannot_change)?;
        found(self.store.delete(&self.path(key)?).await, || format!("remove {key}")).map(drop)
    }

    /// Removes every object whose key begins with `prefix`, a key without `/` at its end.
    pub(super) async fn delete_below(&self, prefix: &str) -> StoreResult<()> {
        let locations = self.list(prefix)?.map_ok(|object| object.location).try_collect::<Vec<_>>().await?;
        step("s3.remove").map_err(cannot_change)?;
        let mut removed = self.store.delete_stream(stream::iter(locations.into_iter().map(Ok)).boxed());
        while let Some(one) = removed.next().await {
            found(one, || format!("remove what is below {prefix}"))?;
        }
        Ok(())
    }

    /// Every object whose key begins with `prefix`, a key without `/` at its end.
    pub(super) fn list(&self, prefix: &str) -> StoreResult<BoxStream<'static, StoreResult<ObjectMeta>>> {
        let prefix = self.path(prefix)?;
        let listed = self.store.list(Some(&prefix));
        Ok(listed.map_err(move |error| cannot(|| format!("list {prefix}"))(error)).boxed())
    }

    /// The names directly below `prefix`, a key without `/` at its end.
    pub(super) async fn names_below(&self, prefix: &str) -> StoreResult<Vec<String>> {
        let listed = self.store.list_with_delimiter(Some(&self.path(prefix)?)).await;
        let listed = listed.map_err(cannot(|| format!("list {prefix}")))?;
        Ok(listed.common_prefixes.iter().filter_map(|path| path.filename().map(str::to_owned)).collect())
    }

    /// The same bytes; fewer or more than were asked for are an error.
    async fn whole(&self, key: &str, range: Range<u64>) -> StoreResult<Option<Bytes>> {
        let wanted = range.end - range.start;
        let bytes = self.get(key, range).await?;
        match bytes.as_ref().map(|bytes| bytes.len() as u64).filter(|got| *got != wanted) {
            None => Ok(bytes),
            Some(got) => {
                Err(StoreError::Unavailable(anyhow!("the bucket sent {got} bytes of a file where it has {wanted}")))
            }
        }
    }

    /// Writes pieces of objects one after the other into a new file. False when one of them is gone.
    pub(super) async fn download(&self, pieces: Vec<(String, Range<u64>)>, to: &FilePath) -> StoreResult<bool> {
        let what = || "cannot write what was downloaded from the bucket".to_owned();
        let _turn = self.turn().await?;
        let file = step("s3.download").and_then(|()| File::create(to));
        let file = file.map_err(|error| StoreError::of_io(error, what()))?;
        let (file, mut at) = (Arc::new(file), 0);
        let pieces = pieces.into_iter().flat_map(|(key, range)| cut(range).map(move |range| (key.clone(), range)));
        let mut arriving =
            stream::iter(pieces).map(|(key, range)| async move { self.whole(&key, range).await }).buffered(AT_ONCE);
        while let Some(bytes) = arriving.try_next().await? {
            let Some(bytes) = bytes else { return Ok(false) };
            let (file, offset) = (Arc::clone(&file), at);
            at += bytes.len() as u64;
            blocking(move || file.write_all_at(&bytes, offset).map_err(|error| StoreError::of_io(error, what())))
                .await?;
        }
        Ok(true)
    }
}

/// A range in pieces of at most [`PART`].
fn cut(range: Range<u64>) -> impl Iterator<Item = Range<u64>> {
    let end = range.end;
    std::iter::successors(Some(range.start), |start| Some(start + PART))
        .take_while(move |start| *start < end)
        .map(move |start| start..end.min(start + PART))
}

async fn put_parts(upload: &mut dyn MultipartUpload, file: &Arc<File>, size: u64, key: &str) -> StoreResult<()> {
    let part = size.div_ceil(MOST_PARTS).next_multiple_of(1 << 20).max(PART);
    let mut running: FuturesUnordered<UploadPart> = FuturesUnordered::new();
    let mut start = 0;
    while start < size {
        if running.len() == AT_ONCE
            && let Some(done) = running.next().await
        {
            done.map_err(cannot(|| format!("store a part of {key}")))?;
        }
        let end = size.min(start + part);
        step("s3.part").map_err(cannot_change)?;
        let bytes = read_at(file, start..end, key).await?;
        running.push(upload.put_part(bytes.into()));
        start = end;
    }
    while let Some(done) = running.next().await {
        done.map_err(cannot(|| format!("store a part of {key}")))?;
    }
    drop(running);
    step("s3.complete").map_err(cannot_change)?;
    upload.complete().await.map(drop).map_err(cannot(|| format!("complete {key}")))
}

async fn read_at(file: &Arc<File>, range: Range<u64>, key: &str) -> StoreResult<Bytes> {
    let (file, what) = (Arc::clone(file), format!("cannot read the file for {key}"));
    blocking(move || {
        let length = usize::try_from(range.end - range.start).context("a part does not fit into memory")?;
        let mut bytes = vec![0; length];
        file.read_exact_at(&mut bytes, range.start).map_err(|error| StoreError::of_io(error, what))?;
        Ok(bytes.into())
    })
    .await
}

/// What a test injects before a request that changes the bucket.
pub(super) fn cannot_change(error: std::io::Error) -> StoreError {
    StoreError::of_io(error, "the bucket cannot be changed".into())
}

/// `None` for "there is no such object".
pub(super) fn found<T>(answer: object_store::Result<T>, what: impl FnOnce() -> String) -> StoreResult<Option<T>> {
    match answer {
        Ok(answer) => Ok(Some(answer)),
        Err(object_store::Error::NotFound { .. }) => Ok(None),
        Err(error) => Err(cannot(what)(error)),
    }
}

pub(super) fn cannot(what: impl FnOnce() -> String) -> impl FnOnce(object_store::Error) -> StoreError {
    move |error| StoreError::Unavailable(anyhow!(error).context(format!("the bucket: cannot {}", what())))
}
