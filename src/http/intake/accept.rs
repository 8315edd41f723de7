//! From a whole file on the disk to a job.

use std::path::PathBuf;

use axum::{
    Json,
    http::{HeaderMap, HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use serde::Serialize;
use uuid::Uuid;

use super::{
    admission::{content_length, queue_full},
    idempotency,
    order::{Fields, Order},
    receive::receive,
    spool::Spooled,
};
use crate::{
    archive,
    http::{
        auth::Caller,
        extract::prefer,
        problem::{ApiError, ApiResult},
        state::App,
        views::job::url,
        watch::wait::until_final,
    },
    model::{Fault, Warning, request::StackLayout, request::Upload},
    store::{Enqueue, Job, NewJob, blobs::upload_key},
};

/// A job that the client may hear of.
pub struct Accepted {
    /// The job.
    pub job: Job,
    /// True when an earlier request made it.
    pub replayed: bool,
}

/// The whole way of an upload: from the request to the answer.
///
/// # Errors
/// Every refusal that the contract lists under "What a bad request gets".
pub async fn upload<O: Order, V: Serialize>(
    app: &App,
    caller: &Caller,
    headers: &HeaderMap,
    body: axum::body::Body,
    fields: Fields,
    view: fn(&Job) -> Option<V>,
) -> ApiResult<Response> {
    let key = idempotency::key(headers)?.map(|key| idempotency::of_caller(key, caller.sees_only(app)));
    let is_repeat = match &key {
        Some(key) => app.rows.by_idempotency_key(key).await?.is_some(),
        None => false,
    };
    if !is_repeat {
        caller.require_quota(app, content_length(headers).unwrap_or(0)).await?;
    }
    let (order, file) = receive::<O>(app, headers, body, fields, is_repeat).await?;
    // from here on the bytes are ours: the job is made also when the client does not wait for the answer
    let accepting = tokio::spawn(accept(app.clone(), caller.clone(), order, file, key));
    let accepted = accepting.await.map_err(ApiError::internal)??;
    answer(app, headers, accepted, view).await
}

async fn accept<O: Order>(
    app: App,
    caller: Caller,
    order: O,
    file: Spooled,
    key: Option<String>,
) -> ApiResult<Accepted> {
    let fingerprint = idempotency::fingerprint(O::KIND, &order.asked(), &file.sha256);
    if let Some(key) = &key
        && let Some(job) = idempotency::earlier(&app, key, &fingerprint).await?
    {
        return Ok(Accepted { job, replayed: true });
    }
    // how long it is may have been told only by its end
    caller.require_quota(&app, file.bytes).await?;
    let (layout, mut warnings) = look_into(&app, file.path().to_owned()).await?;
    warnings.extend(order.check(&layout)?);

    let id = Uuid::now_v7();
    let upload =
        Upload { key: upload_key(id), bytes: file.bytes, sha256: file.sha256.clone(), filename: file.filename.clone() };
    app.blobs.publish(file.path(), &upload.key).await?;
    file.published();
    let (rig, lens) = order.key();
    let new = NewJob {
        id,
        rig: rig.clone(),
        lens: lens.clone(),
        request: order.request(upload, layout),
        warnings,
        idempotency: key.clone().map(|key| (key, fingerprint)),
        owner: caller.id(),
    };
    let stored = app.rows.enqueue(&new, app.policy.queue_limit).await;
    // an error here does not say whether the row was stored: the sweep decides about the blob
    let outcome = match stored? {
        Enqueue::Accepted(job) => return Ok(Accepted { job: *job, replayed: false }),
        Enqueue::Repeated(job) => Ok(Accepted { job: *job, replayed: true }),
        Enqueue::KeyReused => Err(idempotency::reused(&key.unwrap_or_default())),
        Enqueue::QueueFull { waiting } => Err(queue_full(waiting)),
    };
    if let Err(error) = app.blobs.delete_job(id).await {
        tracing::warn!(%error, %id, "a blob without a job is left for the sweep");
    }
    outcome
}

/// What the directory of a zip and the headers of its pictures tell.
///
/// # Errors
/// Whatever is wrong with them.
pub async fn look_into(app: &App, file: PathBuf) -> ApiResult<(StackLayout, Vec<Warning>)> {
    let limits = app.policy.archive;
    let _turn = app.looks.acquire().await.map_err(ApiError::internal)?;
    let looked = tokio::task::spawn_blocking(move || -> Result<_, Fault> {
        let archive = archive::open(&file, &limits)?;
        Ok((archive.layout().clone(), archive.warnings().to_vec()))
    });
    Ok(looked.await.map_err(ApiError::internal)??)
}

/// 202 with the job, or 200 when the client preferred to wait and it ended in time.
async fn answer<V: Serialize>(
    app: &App,
    headers: &HeaderMap,
    accepted: Accepted,
    view: fn(&Job) -> Option<V>,
) -> ApiResult<Response> {
    let Accepted { job, replayed } = accepted;
    let location = url(&job);
    let patience = prefer::wait(headers);
    let job = match patience {
        None => job,
        Some(patience) => until_final(app, job.id, patience).await?.unwrap_or(job),
    };
    let waited_out = patience.is_some() && job.state.is_final();
    let status = if waited_out { StatusCode::OK } else { StatusCode::ACCEPTED };
    let mut response = (status, Json(view(&job))).into_response();
    let out = response.headers_mut();
    if let Ok(location) = HeaderValue::from_str(&location) {
        out.insert(header::LOCATION, location);
    }
    if let Some(patience) = patience
        && let Ok(applied) = HeaderValue::from_str(&format!("wait={}", patience.as_secs()))
    {
        out.insert(prefer::PREFERENCE_APPLIED, applied);
    }
    if replayed {
        out.insert(idempotency::IDEMPOTENCY_REPLAYED, HeaderValue::from_static("true"));
    }
    Ok(response)
}
