//! Writes an upload to a spool file, counted and hashed.

use bytes::Bytes;
use futures::{Stream, StreamExt};
use sha2::{Digest, Sha256};
use tokio::io::AsyncWriteExt;

use super::{
    quota::QuotaClaim,
    reservation::{UploadReservation, disk_full},
};
use crate::{
    contract::{Code, request::Upload},
    http::{ApiError, ApiResult, App},
    store::{SpoolFile, digest::hex, failpoint::step, is_full},
};

/// A complete zip in the workspace. Dropping it removes the file, unless the file has become a blob.
pub struct SpooledZip {
    /// The file.
    pub file: SpoolFile,
    /// Size, bytes.
    pub bytes: u64,
    /// SHA-256, hex.
    pub sha256: String,
    /// File name that the client gave.
    pub filename: Option<String>,
    /// To be held until the store counts the bytes.
    pub quota: QuotaClaim,
}

impl SpooledZip {
    /// The stored zip of a job, as a spool file that shares its bytes. `None` when the blob is gone.
    ///
    /// # Errors
    /// `insufficient_storage` when it is in a bucket and does not fit on the disk; when the blob store cannot share it.
    pub async fn of_stored(app: &App, upload: &Upload) -> ApiResult<Option<Self>> {
        let _space =
            app.disk.reserve_copy(upload.bytes).await?.granted().map_err(|state| disk_full(upload.bytes, 0, &state))?;
        let Some(file) = app.store.blobs.share(&upload.key, &app.store.workspace).await? else { return Ok(None) };
        let Upload { bytes, sha256, filename, .. } = upload.clone();
        // the store checks the quota
        Ok(Some(Self { file, bytes, sha256, filename, quota: QuotaClaim::default() }))
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
    let made =
        tempfile::Builder::new().prefix("upload-").tempfile_in(app.store.workspace.path()).map_err(cannot_write)?;
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
    Ok(SpooledZip { file: SpoolFile::temporary(path), bytes, sha256, filename, quota: reservation.into_quota() })
}

fn cannot_write(error: std::io::Error) -> ApiError {
    if is_full(&error) {
        let detail = "the disk of the server became full during the upload; nothing was stored; send it again when \
                      there is free space";
        return ApiError::new(Code::InsufficientStorage, detail);
    }
    ApiError::internal(format!("spool file: {error}"))
}
