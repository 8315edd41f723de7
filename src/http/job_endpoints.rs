//! The endpoints that all kinds of jobs have in common: list, get, delete, events, cancel. One macro documents them;
//! [`job_resource`](super::job_resource) does the work.

/// The endpoints of a kind of jobs: the kind, its view, its list, its name, the plural, and the description of its
/// event stream; of stacks and reconstructions, that of the parameter `scan`, and of stacks that of `verdict`. `\n`
/// keeps the line breaks that the document always had.
macro_rules! endpoints {
    ($kind:ident, $view:ident, $list:ident, $one:literal, $many:literal, $events:literal $(, $scan:literal $(, $verdict:literal)?)?) => {
        use axum::{
            Json,
            extract::State,
            http::{HeaderMap, StatusCode, Uri},
            response::Response,
        };

        use crate::{
            contract::{JobKind, JobState},
            http::{
                auth::Caller,
                extract::JobId,
                job_resource,
                problem::ApiResult,
                state::App,
                views::{JobDocument, $list, $view},
            },
        };

        #[doc = concat!("`GET /v1/", $many, "`")]
        #[utoipa::path(
            get,
            path = concat!("/v1/", $many),
            operation_id = concat!("list_", $many),
            tag = $many,
            summary = concat!("List ", $many),
            description = "Newest first. A page holds at most `limit` items, fewer when the response would exceed about 4 MiB.",
            params(
                ("state" = Option<JobState>, Query, description = concat!("Only ", $many, " in this state")),
                ("rig" = Option<String>, Query, description = concat!("Only ", $many, " of this rig")),
                ("lens" = Option<String>, Query, description = concat!("Only ", $many, " of this lens")),
                $(("scan" = Option<String>, Query, description = $scan),
                    $(("verdict" = Option<crate::contract::Verdict>, Query, description = $verdict),)?
                )?
                ("q" = Option<String>, Query, description = concat!("Only ", $many, " with all of these words in label, scan, rig, lens or file name; the beginning of a word is enough")),
                ("since" = Option<String>, Query, description = "Accepted on this day (UTC) or later, or at this time or later", example = "2026-11-27"),
                ("until" = Option<String>, Query, description = "Accepted on this day (UTC) or before, or before this time", example = "2026-11-27"),
                ("limit" = Option<u32>, Query, description = "Items per page, 1 to 500, default 50"),
                ("cursor" = Option<String>, Query, description = "`next_cursor` from the previous page"),
            ),
            responses(
                (status = 200, description = concat!("A page of ", $many), body = $list),
                (status = 400, description = "`invalid_request`: an unknown parameter, or a value outside its range"),
            )
        )]
        pub async fn list(State(app): State<App>, caller: Caller, uri: Uri) -> ApiResult<Json<$list>> {
            Ok(Json(job_resource::list(&app, &caller, &uri, JobKind::$kind).await?.into()))
        }

        #[doc = concat!("`GET /v1/", $many, "/{id}`")]
        #[utoipa::path(
            get,
            path = concat!("/v1/", $many, "/{id}"),
            operation_id = concat!("get_", $one),
            tag = $many,
            summary = concat!("Get a ", $one),
            description = concat!(
                "With `Prefer: wait=N` the response is sent when the ", $one, " has ended, or after N seconds (at most 50)."
            ),
            params(
                ("id" = String, Path, description = concat!("Id of the ", $one)),
                ("Prefer" = Option<String>, Header, description = "`wait=N`: wait up to N seconds (at most 50) for the job to end"),
            ),
            responses(
                (status = 200, description = concat!("The ", $one), body = $view),
                (status = 404, description = "`not_found`"),
            )
        )]
        pub async fn get(State(app): State<App>, JobId(id): JobId, headers: HeaderMap) -> ApiResult<Json<JobDocument>> {
            job_resource::get(&app, id, JobKind::$kind, &headers).await
        }

        #[doc = concat!("`DELETE /v1/", $many, "/{id}`")]
        #[utoipa::path(
            delete,
            path = concat!("/v1/", $many, "/{id}"),
            operation_id = concat!("delete_", $one),
            tag = $many,
            summary = concat!("Delete a ", $one),
            description = concat!(
                "The upload and the results are deleted. A running ", $one, " is cancelled first, and its files are \
                 deleted when its\nworker has stopped."
            ),
            params(("id" = String, Path, description = concat!("Id of the ", $one))),
            responses(
                (status = 204, description = "It is deleted, or will be as soon as its worker stops"),
                (status = 404, description = "`not_found`"),
            )
        )]
        pub async fn delete(State(app): State<App>, JobId(id): JobId) -> ApiResult<StatusCode> {
            job_resource::delete(&app, id, JobKind::$kind).await
        }

        #[doc = concat!("`GET /v1/", $many, "/{id}/events`")]
        #[utoipa::path(
            get,
            path = concat!("/v1/", $many, "/{id}/events"),
            operation_id = concat!("watch_", $one),
            tag = $many,
            summary = concat!("Stream the events of a ", $one),
            description = $events,
            params(
                ("id" = String, Path, description = concat!("Id of the ", $one)),
                ("Last-Event-ID" = Option<String>, Header, description = "Id of the last event received"),
            ),
            responses(
                (status = 200, description = "The events", body = String, content_type = "text/event-stream"),
                (status = 204, description = concat!("The ", $one, " has ended and the client has received its last event: do not reconnect")),
                (status = 404, description = "`not_found`"),
            )
        )]
        pub async fn events(State(app): State<App>, JobId(id): JobId, headers: HeaderMap) -> ApiResult<Response> {
            job_resource::events(&app, id, JobKind::$kind, &headers).await
        }

        #[doc = concat!("`POST /v1/", $many, "/{id}/cancel`")]
        #[utoipa::path(
            post,
            path = concat!("/v1/", $many, "/{id}/cancel"),
            operation_id = concat!("cancel_", $one),
            tag = $many,
            summary = concat!("Cancel a ", $one),
            description = concat!(
                "A waiting ", $one, " is cancelled at once, a running one within seconds. Cancelling it again is not an error."
            ),
            params(("id" = String, Path, description = concat!("Id of the ", $one))),
            responses(
                (status = 202, description = "It is cancelled, or will be as soon as its worker stops", body = $view),
                (status = 404, description = "`not_found`"),
                (status = 409, description = "`conflict`: it has already succeeded or failed"),
            )
        )]
        pub async fn cancel(State(app): State<App>, JobId(id): JobId) -> ApiResult<(StatusCode, Json<JobDocument>)> {
            job_resource::cancel(&app, id, JobKind::$kind).await
        }
    };
}

/// Those of stacks.
pub mod stacks {
    endpoints! {
        Stack, Stack, StackList, "stack", "stacks",
        "Server-sent events. `state` (data: the whole stack) is sent first and on each change of state. `progress` \
         (data: the\nprogress) is sent on each change of progress. The stream closes when the stack has ended. A client \
         that reconnects\nwith `Last-Event-ID` receives only newer events.",
        "Only stacks of this scan", "Only stacks with this verdict"
    }
}

/// Those of calibrations.
pub mod calibrations {
    endpoints! {
        Calibration, Calibration, CalibrationList, "calibration", "calibrations",
        "Server-sent events. `state` (data: the whole calibration) is sent first and on each change of state. \
         `progress`\n(data: the progress) is sent on each change of progress. The stream closes when the calibration has \
         ended. A client\nthat reconnects with `Last-Event-ID` receives only newer events."
    }
}

/// Those of reconstructions.
pub mod reconstructions {
    endpoints! {
        Reconstruction, Reconstruction, ReconstructionList, "reconstruction", "reconstructions",
        "Server-sent events. `state` (data: the whole reconstruction) is sent first and on each change of state. \
         `progress`\n(data: the progress) is sent on each change of progress. The stream closes when the reconstruction \
         has ended. A client\nthat reconnects with `Last-Event-ID` receives only newer events.",
        "Only reconstructions of this scan"
    }
}
