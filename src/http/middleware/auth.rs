//! Authentication and authorisation of every request, before any handler: the token, its scopes, the limit of requests
//! in progress, and with `isolate_tokens` the owner of the stack or upload.

use axum::{
    body::Body,
    extract::{Request, State},
    http::{HeaderMap, request::Parts},
    middleware::Next,
    response::{IntoResponse, Response},
};

use crate::{
    contract::Code,
    http::{
        auth::{Caller, identify, needs, owned_id},
        connections::tally::InProgress,
        ingest::{admission::waits_for_continue, body::discard},
        log,
        problem::{ApiError, ApiResult},
        state::App,
    },
};

/// The layer.
pub async fn check(State(app): State<App>, request: Request, next: Next) -> Response {
    let (mut parts, body) = request.into_parts();
    match authorise(&app, &parts).await {
        Ok((caller, in_progress)) => {
            parts.extensions.insert(caller);
            let response = next.run(Request::from_parts(parts, body)).await;
            match in_progress {
                Some(in_progress) => in_progress.until_sent(response),
                None => response,
            }
        }
        Err(error) => {
            drain_briefly(&parts.headers, body);
            error.into_response()
        }
    }
}

async fn authorise(app: &App, request: &Parts) -> ApiResult<(Caller, Option<InProgress>)> {
    let path = request.uri.path();
    let Some(scopes) = needs(&request.method, path) else { return Ok((Caller::default(), None)) };
    let caller = identify(app, request).await?;
    if let Some(name) = caller.name() {
        log::note("token", name);
    }
    caller.require(scopes)?;
    if let (Some(own), Some(id)) = (caller.sees_only(app), owned_id(path))
        && app.store.metadata.owner(id).await?.is_some_and(|owner| owner != own)
    {
        return Err(ApiError::new(Code::NotFound, format!("there is nothing with the id {id}")));
    }
    let in_progress = count(app, &caller)?;
    Ok((caller, in_progress))
}

/// Limits the requests in progress of one token, so that its event streams and unread downloads cannot use up all
/// connections.
fn count(app: &App, caller: &Caller) -> ApiResult<Option<InProgress>> {
    let (Some(id), Some(name)) = (caller.id(), caller.name()) else { return Ok(None) };
    let most = app.policy.client_share();
    if let Some(in_progress) = app.tally.enter(id, most) {
        return Ok(Some(in_progress));
    }
    let detail =
        format!("the token '{name}' has {most} requests in progress, which is its limit; retry when one has ended");
    Err(ApiError::new(Code::TooManyRequests, detail))
}

/// Reads some of the body of a refused request. Otherwise a client that still sends would see a connection reset and
/// not the answer. A client that waits for `100 Continue` sends nothing.
pub fn drain_briefly(headers: &HeaderMap, body: Body) {
    if !waits_for_continue(headers) {
        discard(body);
    }
}
