//! Authentication and authorisation of every request, before any handler: the token, its scopes, the limit of requests
//! in progress, and with `isolate_tokens` the owner of the stack or upload.

use axum::{
    extract::{Request, State},
    http::request::Parts,
    middleware::Next,
    response::{IntoResponse, Response},
};

use crate::{
    contract::Code,
    http::{
        ApiError, ApiResult, App,
        auth::{Caller, identify, needs, owned_id},
        connections::InProgress,
        ingest::body::discard,
        log,
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
            discard(&parts.headers, body);
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
    if let Some(in_progress) = InProgress::begin(&app.in_progress, id, most) {
        return Ok(Some(in_progress));
    }
    let detail =
        format!("the token '{name}' has {most} requests in progress, which is its limit; retry when one has ended");
    Err(ApiError::new(Code::TooManyRequests, detail))
}
