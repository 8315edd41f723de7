//! The result files of a stack: `GET /v1/stacks/{id}/{image,mask,...}`. One endpoint per row of [`stack_artifacts`];
//! all of them do the same.

use axum::{
    extract::State,
    http::{HeaderMap, Method},
    response::Response,
};
use utoipa_axum::{router::OpenApiRouter, routes};

use crate::{
    contract::{
        JobKind,
        artifact::{StackArtifact, stack_artifacts},
    },
    http::{
        ApiResult, App,
        artifacts::{picture, redirect::MayRedirect},
        extract::JobId,
        job_resource::load,
    },
};

/// The endpoint of an artifact: the formats in which it is sent, then the columns of its row.
macro_rules! endpoint {
    (VIEWABLE $($row:tt)*) => {
        endpoint! { converted ["image/png", "image/tiff", "image/jpeg"] $($row)* }
    };
    (LOSSLESS $($row:tt)*) => {
        endpoint! { converted ["image/png", "image/tiff"] $($row)* }
    };
    // the preview: JPEG, or PNG of older versions
    (AS_STORED $($row:tt)*) => {
        endpoint! { @() ["image/jpeg", "image/png"] $($row)* }
    };
    (converted $($row:tt)*) => {
        endpoint! {
            @("A media type listed under 200. Anything else: the stored file",
                "`insufficient_storage`: no disk space to convert the file; request it as it is stored")
            $($row)*
        }
    };
    (
        @($($accept:literal, $no_space:literal)?) [$($content:tt),+]
        $variant:ident $member:ident $name:tt $summary:tt $description:tt $absent:tt
    ) => {
        #[doc = $summary]
        #[utoipa::path(
            get,
            path = concat!("/v1/stacks/{id}/", $name),
            operation_id = concat!("get_stack_", stringify!($member)),
            tag = "stacks",
            summary = $summary,
            description = $description,
            params(
                ("id" = String, Path, description = "Id of the stack"),
                $(("Accept" = Option<String>, Header, description = $accept),)?
                ("redirect" = Option<bool>, Query, description = "The client follows a redirect to the bucket of the service"),
                ("Range" = Option<String>, Header, description = "One byte range"),
                ("If-Range" = Option<String>, Header, description = "`ETag`: send the range only if the file still has this tag, otherwise the whole file"),
                ("If-None-Match" = Option<String>, Header, description = "`ETag` of the copy that the client has"),
            ),
            responses(
                (status = 200, description = "The file", content($((Vec<u8> = $content)),+), headers(
                    ("ETag" = String, description = "SHA-256 of the stored file; with a suffix for a converted file"),
                    ("Content-Disposition" = String, description = "A file name made from label, scan and angles"))),
                (status = 206, description = "The requested range"),
                (status = 307, description = "With `redirect=true`, if the service signs URLs of its bucket: the stored file at `Location`, until the URL expires", headers(
                    ("Location" = String, description = "A signed URL; send no token to it"))),
                (status = 304, description = "The copy of the client is current"),
                (status = 400, description = "`invalid_request`: `redirect` is neither `true` nor `false`, or is given twice"),
                (status = 404, description = $absent),
                (status = 409, description = "`not_finished`: the stack is queued or running"),
                (status = 412, description = "`precondition_failed`: the file does not have the tag in `If-Match`"),
                (status = 416, description = "`range_not_satisfiable`"),
                $((status = 507, description = $no_space),)?
            )
        )]
        pub async fn $member(
            State(app): State<App>,
            JobId(id): JobId,
            redirect: MayRedirect,
            method: Method,
            headers: HeaderMap,
        ) -> ApiResult<Response> {
            let job = load(&app, id, JobKind::Stack).await?;
            let picture = (StackArtifact::$variant.name(), StackArtifact::$variant.formats());
            picture::answer(&app, &job, picture, &method, &headers, redirect).await
        }
    };
}

macro_rules! endpoints {
    ($($variant:ident $member:ident {
        name: $name:tt, link: $_l:tt, summary: $summary:tt, description: $description:tt, absent: $absent:tt,
        formats: $formats:ident, $($_rest:tt)*
    })*) => {
        $(endpoint! { $formats $variant $member $name $summary $description $absent })*

        /// All of them.
        pub fn routes() -> OpenApiRouter<App> {
            OpenApiRouter::new()$(.routes(routes!($member)))*
        }
    };
}
stack_artifacts!(endpoints);
