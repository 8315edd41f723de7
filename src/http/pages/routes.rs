//! Every page. They are no part of the OpenAPI document: their content may change with every version.

use axum::{Router, routing::get};

use super::{assets, guide, home, plan, profiles, scan, scans, send, sign_in, stack, stacks};
use crate::http::App;

/// The routes.
pub fn routes() -> Router<App> {
    Router::new()
        .route("/web/{version}/{file}", get(assets::get))
        .route("/", get(home::page))
        .route("/stacks", get(stacks::list::list))
        .route("/stacks/{id}", get(stack::page::page))
        .route("/stacks/{id}/tiles/{artifact}/{level}/{x}/{y}", get(stack::tiles::get))
        .route("/stacks/{id}/runs", get(stack::runs::page))
        .route("/stacks/{id}/thumbnail", get(stacks::thumbnail::get))
        .route("/send", get(send::page))
        .route("/scans", get(scans::page))
        .route("/scans/{scan}", get(scan::page))
        .route("/profiles", get(profiles::list::page))
        .route("/profiles/{rig}/{lens}", get(profiles::page::page))
        .route("/calibrations/{id}", get(profiles::calibration::page))
        .route("/plan", get(plan::page))
        .route("/guide", get(guide::start))
        .route("/guide/{*name}", get(guide::page))
        .route("/sign-in", get(sign_in::form).post(sign_in::sign_in))
        .route("/sign-out", axum::routing::post(sign_in::sign_out))
}
