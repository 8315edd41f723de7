//! The files of a reconstruction: `GET /v1/reconstructions/{id}/{points,cameras,hull,mesh,model,log}`.

use axum::{extract::State, http::HeaderMap, response::Response};
use utoipa_axum::{router::OpenApiRouter, routes};
use uuid::Uuid;

use crate::{
    contract::{JobKind, reconstruction::files},
    http::{
        ApiResult, App,
        artifacts::{download::stored, name, outcome::artifact},
        extract::JobId,
        job_resource::load,
    },
};

async fn answer(app: &App, id: Uuid, file: &str, headers: &HeaderMap) -> ApiResult<Response> {
    let job = load(app, id, JobKind::Reconstruction).await?;
    let artifact = artifact(&job, file)?;
    let name = name::of(&job, file, &artifact.media_type);
    stored(app, &job, artifact, name).await?.answer(headers).await
}

/// An endpoint: its function, the name of the file, its media type, and its documentation.
macro_rules! endpoint {
    ($function:ident, $file:expr, $path:literal, $($kind:literal)|+, $summary:literal, $description:literal) => {
        #[doc = $summary]
        #[utoipa::path(
            get,
            path = concat!("/v1/reconstructions/{id}/", $path),
            operation_id = concat!("get_reconstruction_", $path),
            tag = "reconstructions",
            summary = $summary,
            description = $description,
            params(
                ("id" = String, Path, description = "Id of the reconstruction"),
                ("Range" = Option<String>, Header, description = "One byte range"),
                ("If-Range" = Option<String>, Header, description = "`ETag`: send the range only if the file still has this tag, otherwise the whole file"),
                ("If-None-Match" = Option<String>, Header, description = "`ETag` of the copy that the client has"),
            ),
            responses(
                (status = 200, description = "The file", content($((Vec<u8> = $kind)),+), headers(
                    ("ETag" = String, description = "SHA-256 of the file"),
                    ("Content-Disposition" = String, description = "A file name made from the name of the scan"))),
                (status = 206, description = "The requested range"),
                (status = 304, description = "The copy of the client is current"),
                (status = 404, description = "`not_found`; `no_result`: the reconstruction failed or was cancelled, or no view was registered"),
                (status = 409, description = "`not_finished`: the reconstruction is queued or running"),
                (status = 412, description = "`precondition_failed`: the file does not have the tag in `If-Match`"),
                (status = 416, description = "`range_not_satisfiable`"),
            )
        )]
        pub async fn $function(
            State(app): State<App>,
            JobId(id): JobId,
            headers: HeaderMap,
        ) -> ApiResult<Response> {
            answer(&app, id, $file, &headers).await
        }
    };
}

endpoint! {
    points, files::POINTS, "points", "application/octet-stream", "Get the points of a reconstruction",
    "PLY, binary, little endian: `x`, `y`, `z` as floats in the unit of the model, `red`, `green`, `blue` as bytes."
}
endpoint! {
    cameras, files::CAMERAS, "cameras", "application/json", "Get the cameras of a reconstruction",
    "`cameras`: name, stack, centre of projection, rotation (world to camera, by rows), size, focal length and principal \
     point (the\ncentre of the top-left pixel is (0, 0)) of each view; null where the view is not registered. `turntable`: \
     centre, axis and radius\nof the sphere or circle of the cameras, or null. Lengths are in the unit of the model."
}
endpoint! {
    hull, files::HULL, "hull", "model/gltf-binary", "Get the surface of a reconstruction",
    "The visual hull of the masks: GLB with colours. The vertices have the unit of the model. `no_result` without masks."
}
endpoint! {
    mesh, files::MESH, "mesh", "application/octet-stream" | "model/gltf-binary", "Get the mesh of a reconstruction",
    "What the program of the setting `mesh_command` made: PLY or GLB, in the unit of the model. `no_result` without it."
}
endpoint! {
    model, files::MODEL, "model", "application/zip", "Get the model of a reconstruction",
    "A zip of the model of COLMAP as text: `cameras.txt`, `images.txt` and `points3D.txt`."
}
endpoint! {
    log, files::LOG, "log", "text/plain", "Get the log of a reconstruction",
    "What COLMAP said."
}

/// All of them.
pub fn routes() -> OpenApiRouter<App> {
    OpenApiRouter::new()
        .routes(routes!(points))
        .routes(routes!(cameras))
        .routes(routes!(hull))
        .routes(routes!(mesh))
        .routes(routes!(model))
        .routes(routes!(log))
}
