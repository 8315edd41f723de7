//! The end of an upload: all bytes are here, and it becomes a job. Each step can be repeated after a crash, because upload
//! and job have the same id.

use std::path::{Path, PathBuf};

use super::{digest::RunningDigest, lock::UploadLock, metadata::Metadata};
use crate::{
    contract::JobKind,
    http::{
        ingest::{
            submission::Submission,
            submit::{IncomingZip, Origin, submit},
        },
        problem::{ApiError, ApiResult, is_permanent},
        state::App,
    },
    store::{blobs::upload_key, gc::gc_upload, uploads::UploadState},
};

/// Makes the job if all bytes are here and it does not exist yet, and sets `locked.upload.state`. A zip that can never
/// become a job is refused permanently. After a temporary failure, such as a full queue, the client can ask again.
///
/// # Errors
/// What [`Submission::read`] and [`submit`] refuse.
pub async fn complete_if_whole(app: &App, locked: &mut UploadLock) -> ApiResult<()> {
    let upload = &locked.upload;
    if upload.state != UploadState::Receiving || upload.offset < upload.length {
        return Ok(());
    }
    let metadata = Metadata::parse(&upload.metadata)?;
    let kind = metadata.purpose()?;
    let made = make_job(app, locked, kind, &metadata).await;
    let id = locked.upload.id;
    let outcome = match made {
        Ok(()) => {
            locked.upload.state = UploadState::Complete(kind);
            Ok(())
        }
        Err(error) if is_permanent(error.fault().code) => {
            app.rows.refuse_upload(id, error.fault()).await?;
            locked.upload.state = UploadState::Refused(Box::new(error.fault().clone()));
            Err(error)
        }
        Err(error) => return Err(error),
    };
    if let Err(error) = gc_upload(&*app.rows, &*app.blobs, id).await {
        tracing::warn!(?error, %id, "files of an upload are left to garbage collection");
    }
    outcome
}

async fn make_job(app: &App, locked: &mut UploadLock, kind: JobKind, metadata: &Metadata) -> ApiResult<()> {
    let submission = Submission::read(app, kind, &metadata.fields()).await?;
    let id = locked.upload.id;
    let (file, is_published) = whole_file(app, locked, &upload_key(id)).await?;
    let zip = IncomingZip {
        id,
        file,
        is_published,
        bytes: locked.upload.length,
        sha256: RunningDigest::resume(&locked.upload.digest)?.finish(),
        filename: metadata.filename(),
        origin: Origin::ResumableUpload,
    };
    submit(app, &submission, zip).await?;
    Ok(())
}

/// The file with all bytes, and whether it is published already: a crash may have come between publishing and the job.
async fn whole_file(app: &App, locked: &mut UploadLock, key: &str) -> ApiResult<(PathBuf, bool)> {
    if locked.partial.start_at(locked.upload.length).await? {
        return Ok((Path::to_owned(locked.partial.path()), false));
    }
    match app.blobs.local_path(key).await? {
        Some(path) => Ok((path, true)),
        None => Err(ApiError::internal(format!("the bytes of upload {} are missing", locked.upload.id))),
    }
}
