//! `GET /docs`: Swagger UI for the OpenAPI document. Its files are embedded in the program; nothing is loaded from
//! elsewhere.

use axum::{
    Router,
    http::{StatusCode, header},
    middleware::map_response,
    response::Response,
    routing::get,
};
use utoipa_swagger_ui::{Config, SwaggerUi};

/// The routes of the page, and an empty answer for the icon that browsers request of pages that name none.
pub fn routes<S: Clone + Send + Sync + 'static>() -> Router<S> {
    let page = SwaggerUi::new("/docs").config(Config::from("../openapi.json").display_request_duration(true));
    let icon = (StatusCode::NO_CONTENT, [(header::CACHE_CONTROL, "max-age=86400")]);
    // the library writes this path into its redirect
    let page = Router::from(page).layer(map_response(|mut response: Response| async move {
        if let Some(location) = response.headers_mut().get_mut(header::LOCATION)
            && let Ok(link) = link!("/docs/").try_into()
        {
            *location = link;
        }
        response
    }));
    page.route("/favicon.ico", get(move || async move { icon }))
}
