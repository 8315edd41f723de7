//! `GET /docs`: the contract to read and try. The page's files are part of the program; nothing comes from outside.

use axum::{
    Router,
    http::{StatusCode, header},
    response::Redirect,
    routing::get,
};
use utoipa_swagger_ui::{Config, SwaggerUi};

/// The routes of the page, and the way there from `/`. Browsers ask for an icon by themselves: there is none.
pub fn routes<S: Clone + Send + Sync + 'static>() -> Router<S> {
    let page = SwaggerUi::new("/docs").config(Config::from("/openapi.json").display_request_duration(true));
    let icon = (StatusCode::NO_CONTENT, [(header::CACHE_CONTROL, "max-age=86400")]);
    Router::from(page)
        .route("/", get(|| async { Redirect::to("/docs") }))
        .route("/favicon.ico", get(move || async move { icon }))
}
