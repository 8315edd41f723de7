//! All bytes are here: the upload becomes a job. Every step can be done again after a crash, because upload and job
//! have one id.

use std::path::{Path, PathBuf};

use super::{digest::RunningDigest, hold::Held, metadata::Metadata};
use crate::{
    contract::JobKind,
    http::{
        calibrations::order::CalibrationOrder,
        intake::{
            order::Order,
            submit::{Origin, Submission, submit},
        },
        problem::{ApiError, ApiResult},
        stacks::order::StackOrder,
        state::App,
    },
    store::{blobs::upload_key, gc::gc_upload, uploads::UploadState},
};

/// Makes the job when all bytes are here and it is not made yet; `held` says afterwards what became of the upload. What
/// can be no job of any use is refused for good; what only fails now (a full queue) can be asked for again.
///
/// # Errors
/// Every refusal of an upload that the contract lists.
pub async fn complete_if_whole(app: &App, held: &mut Held) -> ApiResult<()> {
    let upload = &held.upload;
    if upload.state != UploadState::Receiving || upload.offset < upload.length {
        return Ok(());
    }
    let metadata = Metadata::parse(&upload.metadata)?;
    let made = match metadata.purpose()? {
        JobKind::Stack => make::<StackOrder>(app, held, &metadata).await,
        JobKind::Calibration => make::<CalibrationOrder>(app, held, &metadata).await,
    };
    let id = held.upload.id;
    let outcome = match made {
        Ok(kind) => {
            held.upload.state = UploadState::Complete(kind);
            Ok(())
        }
        Err(error) if error.fault().code.is_permanent() => {
            app.rows.refuse_upload(id, error.fault()).await?;
            held.upload.state = UploadState::Refused(Box::new(error.fault().clone()));
            Err(error)
        }
        Err(error) => return Err(error),
    };
    if let Err(error) = gc_upload(&*app.rows, &*app.blobs, id).await {
        tracing::warn!(?error, %id, "what an upload left cannot be removed now; the next sweep will");
    }
    outcome
}

async fn make<O: Order>(app: &App, held: &mut Held, metadata: &Metadata) -> ApiResult<JobKind> {
    let order = O::read(app, &metadata.fields()).await?;
    let id = held.upload.id;
    let (file, is_published) = whole_file(app, held, &upload_key(id)).await?;
    let submission = Submission {
        id,
        file,
        is_published,
        bytes: held.upload.length,
        sha256: RunningDigest::resume(&held.upload.digest)?.finish(),
        filename: metadata.filename(),
        origin: Origin::ResumableUpload,
    };
    submit(app, order, submission).await?;
    Ok(O::KIND)
}

/// Where the bytes lie, and whether they are published: a crash may have come between that and the job.
async fn whole_file(app: &App, held: &mut Held, key: &str) -> ApiResult<(PathBuf, bool)> {
    if held.partial.start_at(held.upload.length).await? {
        return Ok((Path::to_owned(held.partial.path()), false));
    }
    match app.blobs.local_path(key).await? {
        Some(path) => Ok((path, true)),
        None => Err(ApiError::internal(format!("the bytes of upload {} are not there", held.upload.id))),
    }
}
