//! `GET /docs`: Swagger UI for the OpenAPI document. Its files are embedded in the program; nothing is loaded from
//! elsewhere.

use axum::{
    Router,
    http::{StatusCode, header},
    routing::get,
};
use utoipa_swagger_ui::{Config, SwaggerUi};

/// The routes of the page, and an empty answer for the icon that browsers request of pages that name none.
pub fn routes<S: Clone + Send + Sync + 'static>() -> Router<S> {
    let page = SwaggerUi::new("/docs").config(Config::from("/openapi.json").display_request_duration(true));
    let icon = (StatusCode::NO_CONTENT, [(header::CACHE_CONTROL, "max-age=86400")]);
    Router::from(page).route("/favicon.ico", get(move || async move { icon }))
}
