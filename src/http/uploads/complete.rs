//! All bytes are here: the upload becomes a job. Every step can be done again after a crash, because upload and job
//! have one id.

use std::path::{Path, PathBuf};

use super::{digest::RunningDigest, hold::Held, hold::unknown, metadata::Metadata};
use crate::{
    http::{
        calibrations::order::CalibrationOrder,
        intake::{accept::look_into, admission::queue_full, order::Order},
        problem::{ApiError, ApiResult, status},
        stacks::order::StackOrder,
        state::App,
    },
    model::{JobKind, request::Upload},
    store::{Enqueue, NewJob, blobs::upload_key, sweep::tidy_upload, uploads::PartialUpload, uploads::UploadState},
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
        Err(error) if status(error.fault().code).is_client_error() => {
            app.rows.refuse_upload(id, error.fault()).await?;
            held.upload.state = UploadState::Refused(Box::new(error.fault().clone()));
            Err(error)
        }
        Err(error) => return Err(error),
    };
    if let Err(error) = tidy_upload(&*app.rows, &*app.blobs, id).await {
        tracing::warn!(?error, %id, "what an upload left cannot be removed now; the next sweep will");
    }
    outcome
}

async fn make<O: Order>(app: &App, held: &mut Held, metadata: &Metadata) -> ApiResult<JobKind> {
    let order = O::read(app, &metadata.fields()).await?;
    let upload = held.upload.clone();
    let key = upload_key(upload.id);
    let (file, is_published) = whole_file(app, held, &key).await?;
    let (layout, mut warnings) = look_into(app, file.clone()).await?;
    warnings.extend(order.check(&layout)?);
    if !is_published {
        app.blobs.publish(&file, &key).await?;
    }
    let (rig, lens) = order.key();
    let job = NewJob {
        id: upload.id,
        rig: rig.clone(),
        lens: lens.clone(),
        request: order.request(stored(&upload, key, metadata)?, layout),
        warnings,
        idempotency: None,
        // the upload's row says whose it is
        owner: None,
    };
    match app.rows.complete_upload(&job, app.policy.queue_limit).await? {
        Some(Enqueue::Accepted(_) | Enqueue::Repeated(_)) => Ok(O::KIND),
        Some(Enqueue::QueueFull { waiting }) => Err(queue_full(waiting)),
        Some(Enqueue::KeyReused) => Err(ApiError::internal("an upload without a key has one that was used before")),
        None => Err(unknown(upload.id)),
    }
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

fn stored(upload: &PartialUpload, key: String, metadata: &Metadata) -> ApiResult<Upload> {
    let sha256 = RunningDigest::resume(&upload.digest)?.finish();
    Ok(Upload { key, bytes: upload.length, sha256, filename: metadata.filename() })
}
