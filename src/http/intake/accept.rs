//! From a whole file on the disk to a job.

use axum::{
    Json,
    http::{HeaderMap, HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use serde::Serialize;
use uuid::Uuid;

use super::{
    idempotency,
    order::{Fields, Order},
    quota::QuotaClaim,
    receive::receive,
    spool::Spooled,
    submit::{Origin, Submission, Submitted, submit},
};
use crate::{
    http::{
        auth::Caller,
        background,
        extract::prefer,
        log,
        problem::{ApiError, ApiResult},
        state::App,
        views::job::url,
        watch::wait::until_final,
    },
    store::Job,
};

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
    // a repeat takes nothing of the quota
    let quota = if is_repeat { QuotaClaim::default() } else { QuotaClaim::of(app, caller, key.clone()) };
    let (order, file) = receive::<O>(app, caller, headers, body, fields, is_repeat, quota).await?;
    complete(app, caller, headers, order, file, key, view).await
}

/// The end of that way, for a zip that is whole and here: from the zip to the answer.
///
/// # Errors
/// What is wrong with the zip, or that it does not fit the order; `queue_full`, `idempotency_key_reused`,
/// `insufficient_storage`.
pub async fn complete<O: Order, V: Serialize>(
    app: &App,
    caller: &Caller,
    headers: &HeaderMap,
    order: O,
    file: Spooled,
    key: Option<String>,
    view: fn(&Job) -> Option<V>,
) -> ApiResult<Response> {
    // from here on the bytes are ours: the job is made also when the client does not wait for the answer
    let accepting = background::spawn(accept(app.clone(), caller.clone(), order, file, key));
    let accepted = accepting.await.map_err(ApiError::internal)??;
    answer(app, headers, accepted, view).await
}

async fn accept<O: Order>(
    app: App,
    caller: Caller,
    order: O,
    file: Spooled,
    key: Option<String>,
) -> ApiResult<Submitted> {
    let fingerprint = idempotency::fingerprint(O::KIND, &order.asked(), &file.sha256);
    if let Some(key) = &key
        && let Some(job) = idempotency::earlier(&app, key, &fingerprint).await?
    {
        return Ok(Submitted { job, replayed: true });
    }
    let submission = Submission {
        id: Uuid::now_v7(),
        file: file.path().to_owned(),
        is_published: false,
        bytes: file.bytes,
        sha256: file.sha256.clone(),
        filename: file.filename.clone(),
        origin: Origin::Request { owner: caller.id(), idempotency: key.map(|key| (key, fingerprint)) },
    };
    // the file goes with `file`, unless it has become a blob
    submit(&app, order, submission).await
}

/// 202 with the job, or 200 when the client preferred to wait and it ended in time.
async fn answer<V: Serialize>(
    app: &App,
    headers: &HeaderMap,
    accepted: Submitted,
    view: fn(&Job) -> Option<V>,
) -> ApiResult<Response> {
    let Submitted { job, replayed } = accepted;
    log::note("job", job.id);
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
