//! The end of an upload: all bytes are here, and it becomes a job. Each step can be repeated after a crash, because
//! upload and job have the same id.

use super::{digest::RunningDigest, lock::UploadLock, metadata::Metadata};
use crate::{
    contract::{JobKind, UploadPurpose},
    http::{
        App,
        auth::Caller,
        ingest::{
            many::ManyOrigin,
            receivable::Receivable,
            reservation::disk_full,
            scan_views::group,
            submission::{Submission, scan::ScanSubmission},
            submit::{IncomingZip, Origin, ZipFile, submit},
        },
        problem::{ApiError, ApiResult, is_permanent},
    },
    store::{
        SpoolFile,
        blobs::{OpenBlob, upload_key},
        gc::gc_upload,
        uploads::{PartialUpload, UploadState},
    },
    telemetry::traces,
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
    let purpose = metadata.purpose()?;
    let made = match purpose {
        UploadPurpose::Stack => make_job(app, locked, JobKind::Stack, &metadata).await,
        UploadPurpose::Calibration => make_job(app, locked, JobKind::Calibration, &metadata).await,
        UploadPurpose::Scan => make_stacks(app, locked, &metadata).await,
    };
    let id = locked.upload.id;
    let outcome = match made {
        Ok(()) => {
            locked.upload.state = UploadState::Complete(purpose);
            Ok(())
        }
        Err(error) if is_permanent(error.fault().code) => {
            app.store.metadata.refuse_upload(id, error.fault()).await?;
            locked.upload.state = UploadState::Refused(Box::new(error.fault().clone()));
            Err(error)
        }
        Err(error) => return Err(error),
    };
    if let Err(error) = gc_upload(&app.store, id).await {
        tracing::warn!(?error, %id, "files of an upload are left to garbage collection");
    }
    outcome
}

async fn make_job(app: &App, locked: &mut UploadLock, kind: JobKind, metadata: &Metadata) -> ApiResult<()> {
    // the token that created the upload was checked then; any token may complete it
    let submission = Submission::read(app, &Caller::default(), &kind, &metadata.fields()).await?;
    let id = locked.upload.id;
    let file = match stored_zip(app, locked).await? {
        Some(blob) => ZipFile::Stored(blob),
        None => ZipFile::Spooled(whole_file(app, locked).await?),
    };
    let zip = IncomingZip {
        id,
        file,
        bytes: locked.upload.length,
        sha256: RunningDigest::resume(&locked.upload.digest)?.finish(),
        filename: metadata.filename(),
        origin: Origin::ResumableUpload,
    };
    submit(app, &submission, zip).await?;
    Ok(())
}

async fn make_stacks(app: &App, locked: &mut UploadLock, metadata: &Metadata) -> ApiResult<()> {
    let submission = ScanSubmission::read(app, &Caller::default(), &metadata.scan()?, &metadata.fields()).await?;
    let id = locked.upload.id;
    let file = whole_file(app, locked).await?;
    let grouped = group(app, &submission, file.path().to_owned()).await?;
    grouped.submit(app, &submission, None, ManyOrigin::ResumableUpload(id)).await?;
    Ok(())
}

/// The blob with all bytes. It is there if a crash came between storing it and creating the job. Otherwise it is made,
/// if the engine can do that without sending the bytes through this machine.
async fn stored_zip(app: &App, locked: &mut UploadLock) -> ApiResult<Option<OpenBlob>> {
    let (length, key) = (locked.upload.length, upload_key(locked.upload.id));
    let (blobs, workspace) = (&app.store.blobs, &app.store.workspace);
    let is_stored = blobs.head(&key).await?.is_some_and(|blob| blob.size == length);
    if !is_stored && !traces::section("store upload", locked.parts.become_blob(length, &key)).await? {
        return Ok(None);
    }
    Ok(blobs.open(&key, workspace).await?)
}

/// A file with all bytes.
async fn whole_file(app: &App, locked: &mut UploadLock) -> ApiResult<SpoolFile> {
    let PartialUpload { id, length, .. } = locked.upload;
    let _space = app.disk.reserve_copy(length).await?.granted().map_err(|state| disk_full(length, 0, &state))?;
    let assembled = locked.parts.assemble(length, &app.store.workspace).await?;
    assembled.ok_or_else(|| ApiError::internal(format!("the bytes of upload {id} are missing")))
}
