//! `GET /docs`: the contract to read and try. The page's files are part of the program; nothing comes from outside.

use axum::{Router, response::Redirect, routing::get};
use utoipa_swagger_ui::{Config, SwaggerUi};

/// The routes of the page, and the way there from `/`.
pub fn routes<S: Clone + Send + Sync + 'static>() -> Router<S> {
    let page = SwaggerUi::new("/docs").config(Config::from("/openapi.json").display_request_duration(true));
    Router::from(page).route("/", get(|| async { Redirect::to("/docs") }))
}
