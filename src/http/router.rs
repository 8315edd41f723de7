//! Every URL of the service, and the layers around all of them.
//!
//! A new endpoint is a file with its handler and a line in [`routes()`]. Its scopes follow from the path, by the table
//! at [`super::auth::needs`]; a path outside that table needs the scope `admin`.

use std::sync::LazyLock;

use axum::{
    Extension, Router,
    extract::DefaultBodyLimit,
    middleware::{from_fn, from_fn_with_state},
    routing::{post, put},
};
use tower_http::catch_panic::CatchPanicLayer;
use utoipa::OpenApi;
use utoipa_axum::{router::OpenApiRouter, routes};

use super::{
    App, calibrations, job_endpoints,
    middleware::{auth, browser, cors, method, observe, prefix, problems, request_id, security, slot, trace, whole},
    notes, optics, pages, poses, profiles, reconstructions, scans, stacks, system, targets, uploads,
};

/// The OpenAPI document of [`routes()`], built at its first use.
pub static DOCUMENT: LazyLock<system::openapi::Document> =
    LazyLock::new(|| system::openapi::Document::of(routes().into_openapi()));

/// Every documented URL.
pub fn routes() -> OpenApiRouter<App> {
    OpenApiRouter::with_openapi(system::openapi::Base::openapi())
        // profiles
        .routes(routes!(profiles::list::list))
        .routes(routes!(profiles::get::get, profiles::put::put, profiles::delete::delete))
        .routes(routes!(profiles::revisions::revisions))
        .routes(routes!(profiles::drift::drift))
        .routes(routes!(profiles::rig_parameters::rig_parameters))
        .routes(routes!(profiles::camera::add))
        .routes(routes!(profiles::export::export))
        .routes(routes!(profiles::import::import))
        .routes(routes!(notes::profiles::list, notes::profiles::add))
        .routes(routes!(notes::profiles::delete))
        // calibrations
        .routes(routes!(calibrations::create::create))
        .routes(routes!(job_endpoints::calibrations::list))
        .routes(routes!(job_endpoints::calibrations::get, job_endpoints::calibrations::delete))
        .routes(routes!(job_endpoints::calibrations::events))
        .routes(routes!(job_endpoints::calibrations::cancel))
        .routes(routes!(calibrations::overlay::overlay))
        .routes(routes!(calibrations::report::report))
        // stacks
        .routes(routes!(job_endpoints::stacks::list, stacks::create::create))
        .routes(routes!(job_endpoints::stacks::get, job_endpoints::stacks::delete))
        .routes(routes!(job_endpoints::stacks::events))
        .routes(routes!(job_endpoints::stacks::cancel))
        .routes(routes!(stacks::totals::totals))
        .routes(routes!(stacks::metrics::metrics))
        .merge(stacks::artifacts::routes())
        .routes(routes!(stacks::lights::light))
        .routes(routes!(stacks::rerun::rerun))
        .routes(routes!(stacks::upload::upload))
        .routes(routes!(notes::stacks::list, notes::stacks::add))
        .routes(routes!(notes::stacks::delete))
        // scans
        .routes(routes!(scans::list::list))
        .routes(routes!(scans::get::get, scans::put::put, scans::delete::delete))
        .routes(routes!(scans::csv::csv))
        .routes(routes!(scans::archive::archive))
        .routes(routes!(scans::rerun::rerun))
        .routes(routes!(scans::bundle::bundle))
        .routes(routes!(scans::poses::poses))
        .routes(routes!(scans::groupings::group))
        .routes(routes!(notes::scans::list, notes::scans::add))
        .routes(routes!(notes::scans::delete))
        .routes(routes!(poses::create::create))
        // reconstructions
        .routes(routes!(reconstructions::create::create, reconstructions::list::list))
        .routes(routes!(job_endpoints::reconstructions::list))
        .routes(routes!(job_endpoints::reconstructions::get, job_endpoints::reconstructions::delete))
        .routes(routes!(job_endpoints::reconstructions::events))
        .routes(routes!(job_endpoints::reconstructions::cancel))
        .routes(routes!(reconstructions::poses::poses))
        .merge(reconstructions::files::routes())
        // capture planning
        .routes(routes!(optics::plan::plan))
        .routes(routes!(targets::advice::advice))
        .routes(routes!(targets::dots::dots))
        // resumable uploads (tus)
        .routes(routes!(uploads::list::list, uploads::create::create, uploads::options::options))
        .routes(routes!(uploads::get::get, uploads::head::head, uploads::patch::patch, uploads::delete::delete))
        // the service itself
        .routes(routes!(system::healthz::healthz))
        .routes(routes!(system::readyz::readyz))
        .routes(routes!(system::metrics::metrics))
        .routes(routes!(system::info::info))
        .routes(routes!(system::openapi::openapi))
        .routes(routes!(system::problems::problem_kind))
}

/// The router of the whole service. The last layer is the outermost: it sees a request first.
pub fn service(app: App) -> Router {
    let (documented, _) = routes().split_for_parts();
    documented
        // `curl -T stack.zip` sends PUT
        .route("/v1/stacks", put(stacks::create::create))
        .route("/v1/scans/{scan}/archive", put(scans::archive::archive))
        .route("/v1/profiles/{rig}/{lens}/calibrations", put(calibrations::create::create))
        .route("/v1/profiles/{rig}/{lens}/import", put(profiles::import::import))
        // tus behind proxies that pass only GET and POST
        .route("/v1/uploads/{id}", post(uploads::patch::overridden).options(uploads::options::options))
        .merge(system::docs::routes())
        .merge(pages::routes::routes())
        .layer(Extension(&*DOCUMENT))
        // uploads count their bytes themselves, and JSON bodies have a limit of their own
        .layer(DefaultBodyLimit::disable())
        .layer(from_fn_with_state(app.clone(), auth::check))
        .layer(from_fn_with_state(app.clone(), browser::check))
        .layer(CatchPanicLayer::custom(problems::from_panic))
        .layer(from_fn(slot::require))
        .layer(from_fn(whole::refuse_others))
        .layer(from_fn(method::refuse_unknown))
        .layer(from_fn(pages::errors::for_people))
        .layer(from_fn(problems::complete))
        .layer(from_fn(security::headers))
        .layer(from_fn(uploads::protocol::name_version))
        .layer(from_fn_with_state(app.clone(), cors::answer))
        .layer(from_fn(observe::requests))
        .layer(from_fn(prefix::enter))
        .layer(from_fn(trace::requests))
        .layer(from_fn(request_id::keep_or_make))
        // what the layers above panic about
        .layer(CatchPanicLayer::custom(problems::from_panic))
        .with_state(app)
}
