//! Writes an upload to a spool file, counted and hashed.

use std::path::Path;

use bytes::Bytes;
use futures::{Stream, StreamExt};
use sha2::{Digest, Sha256};
use tempfile::TempPath;
use tokio::io::AsyncWriteExt;
use uuid::Uuid;

use super::{quota::QuotaClaim, reservation::UploadReservation};
use crate::{
    contract::{Code, request::Upload},
    http::{
        problem::{ApiError, ApiResult},
        state::App,
    },
    store::{digest::hex, failpoint::step},
};

/// A complete zip in the spool folder. Dropping it removes the file, unless the file has become a blob.
pub struct SpooledZip {
    path: TempPath,
    /// Size, bytes.
    pub bytes: u64,
    /// SHA-256, hex.
    pub sha256: String,
    /// File name that the client gave.
    pub filename: Option<String>,
    /// Held until the store counts the bytes.
    _quota: QuotaClaim,
}

impl SpooledZip {
    /// The stored zip of a job, as a file in the spool folder that shares its bytes. `None` when the blob is gone.
    ///
    /// # Errors
    /// When the blob store cannot share it.
    pub async fn of_stored(app: &App, upload: &Upload) -> ApiResult<Option<Self>> {
        let path = app.blobs.spool_dir().join(format!("rerun-{}", Uuid::now_v7()));
        // from here on the file is removed on drop, also when the request is cancelled
        let path = TempPath::try_from_path(path).map_err(cannot_write)?;
        if !app.blobs.share(&upload.key, &path).await? {
            return Ok(None);
        }
        let Upload { bytes, sha256, filename, .. } = upload.clone();
        // the store checks the quota
        Ok(Some(Self { path, bytes, sha256, filename, _quota: QuotaClaim::default() }))
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// Writes a stream to a new spool file, one chunk at a time: memory does not grow with its length.
///
/// # Errors
/// `broken(error)` when the stream ends with an error; `insufficient_storage` when the disk is full.
pub async fn spool<E>(
    app: &App,
    mut chunks: impl Stream<Item = Result<Bytes, E>> + Unpin,
    mut reservation: UploadReservation,
    filename: Option<String>,
    broken: impl Fn(E) -> ApiError,
) -> ApiResult<SpooledZip> {
    step("upload.make").map_err(cannot_write)?;
    let made = tempfile::Builder::new().prefix("upload-").tempfile_in(app.blobs.spool_dir()).map_err(cannot_write)?;
    let (file, path) = made.into_parts();
    let mut file = tokio::fs::File::from_std(file);
    let mut hash = Sha256::new();
    let mut bytes = 0;
    while let Some(chunk) = chunks.next().await {
        let chunk = chunk.map_err(&broken)?;
        let length = chunk.len() as u64;
        reservation.require(length).await?;
        hash.update(&chunk);
        step("upload.write").map_err(cannot_write)?;
        file.write_all(&chunk).await.map_err(cannot_write)?;
        bytes += length;
        reservation.written(length);
    }
    step("upload.flush").map_err(cannot_write)?;
    file.flush().await.map_err(cannot_write)?;
    let sha256 = hex(&hash.finalize());
    Ok(SpooledZip { path, bytes, sha256, filename, _quota: reservation.into_quota() })
}

fn cannot_write(error: std::io::Error) -> ApiError {
    use std::io::ErrorKind::{QuotaExceeded, StorageFull};
    if matches!(error.kind(), StorageFull | QuotaExceeded) {
        let detail = "the disk of the server became full during the upload; nothing was stored; send it again when \
                      there is free space";
        return ApiError::new(Code::InsufficientStorage, detail);
    }
    ApiError::internal(format!("spool file: {error}"))
}
