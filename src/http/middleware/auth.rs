//! Nobody reaches a handler without the scope that its request needs, nor somebody else's stack where tokens see only
//! their own.

use axum::{
    body::Body,
    extract::{Request, State},
    http::{HeaderMap, request::Parts},
    middleware::Next,
    response::{IntoResponse, Response},
};

use crate::{
    http::{
        auth::{Caller, identify, needs, owned_by_someone},
        intake::{admission::waits_for_continue, body::WatchedBody},
        problem::{ApiError, ApiResult},
        state::App,
    },
    model::Code,
};

/// The layer.
pub async fn check(State(app): State<App>, request: Request, next: Next) -> Response {
    let (mut parts, body) = request.into_parts();
    match admit(&app, &parts).await {
        Ok(caller) => {
            parts.extensions.insert(caller);
            next.run(Request::from_parts(parts, body)).await
        }
        Err(error) => {
            read_a_little(&app, &parts.headers, body);
            error.into_response()
        }
    }
}

async fn admit(app: &App, request: &Parts) -> ApiResult<Caller> {
    let path = request.uri.path();
    let Some(scopes) = needs(&request.method, path) else { return Ok(Caller::default()) };
    let caller = identify(app, &request.headers).await?;
    caller.require(scopes)?;
    if let (Some(own), Some(id)) = (caller.sees_only(app), owned_by_someone(path))
        && app.rows.owner(id).await?.is_some_and(|owner| owner != own)
    {
        return Err(ApiError::new(Code::NotFound, format!("there is nothing with the id {id}")));
    }
    Ok(caller)
}

/// A client that is refused while it sends would see its connection break and not the reason.
fn read_a_little(app: &App, headers: &HeaderMap, body: Body) {
    drop(WatchedBody::new(body, u64::MAX, app.policy.body_idle_timeout, waits_for_continue(headers)));
}
