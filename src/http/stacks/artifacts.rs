//! The result files of a stack: `GET /v1/stacks/{id}/{image,mask,backlight,depth,height,height-sigma,preview}`. One
//! endpoint per row of [`StackArtifact`]; all of them do the same.

use axum::{
    extract::State,
    http::{HeaderMap, Method},
    response::Response,
};

use crate::{
    contract::{JobKind, artifact::StackArtifact},
    http::{
        artifacts::{picture, redirect::MayRedirect},
        extract::JobId,
        job_resource::load,
        problem::ApiResult,
        state::App,
    },
};

/// An endpoint for an artifact: whether it can be converted, documentation, name, artifact, path, operation, media
/// types, and why it may be absent.
macro_rules! endpoint {
    (converted $($row:tt)*) => {
        endpoint! {
            @("A media type listed under 200. Anything else: the stored file",
                "`insufficient_storage`: no disk space to convert the file; request it as it is stored")
            $($row)*
        }
    };
    (stored $($row:tt)*) => {
        endpoint! { @() $($row)* }
    };
    (
        @($($accept:literal, $no_space:literal)?)
        $(#[$doc:meta])*
        $name:ident, $artifact:ident, $path:literal, $operation:literal, [$($content:tt),+], $absent:literal
    ) => {
        $(#[$doc])*
        #[utoipa::path(
            get,
            path = $path,
            operation_id = $operation,
            tag = "stacks",
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
        pub async fn $name(
            State(app): State<App>,
            JobId(id): JobId,
            redirect: MayRedirect,
            method: Method,
            headers: HeaderMap,
        ) -> ApiResult<Response> {
            let job = load(&app, id, JobKind::Stack).await?;
            picture::answer(&app, &job, StackArtifact::$artifact, &method, &headers, redirect).await
        }
    };
}

endpoint! {
    converted
    /// Get the fused image
    ///
    /// RGBA with straight alpha; RGB without alpha as JPEG. The file is stored in the `format` of the stack. `Accept`
    /// selects another format: the file is then converted on request, with the same pixels, colour profile and EXIF.
    /// `HEAD` does not convert, so it sends no `Content-Length` for a file that is not converted yet.
    image, Image, "/v1/stacks/{id}/image", "get_stack_image", ["image/png", "image/tiff", "image/jpeg"],
    "`not_found`; `no_result`: the stack failed or was cancelled"
}

endpoint! {
    converted
    /// Get the mask
    ///
    /// 8-bit grey PNG: 255 object, 0 background. TIFF with `Accept: image/tiff`.
    mask, Mask, "/v1/stacks/{id}/mask", "get_stack_mask", ["image/png", "image/tiff"],
    "`not_found`; `no_result`: the stack failed, was cancelled, or has no mask"
}

endpoint! {
    converted
    /// Get the fused back-light stack
    ///
    /// The image from which the mask is made. PNG; TIFF or JPEG with `Accept`.
    backlight, Backlight, "/v1/stacks/{id}/backlight", "get_stack_backlight", ["image/png", "image/tiff", "image/jpeg"],
    "`not_found`; `no_result`: the stack failed, was cancelled, or has no back light"
}

endpoint! {
    converted
    /// Get the slice-index map
    ///
    /// 16-bit grey PNG: 0-based index of the sharpest slice per pixel; 65535 where no slice covers the pixel. TIFF with
    /// `Accept: image/tiff`.
    depth, Depth, "/v1/stacks/{id}/depth", "get_stack_depth", ["image/png", "image/tiff"],
    "`not_found`; `no_result`: the stack failed or was cancelled"
}

endpoint! {
    converted
    /// Get the height map
    ///
    /// 16-bit grey PNG of a stack with `height=auto`. A value `v` above 0 is the height `offset + (v - 1) scale`; the
    /// member `height` of the stack has both numbers and their unit. 0 where the height is unknown. TIFF with
    /// `Accept: image/tiff`.
    height, Height, "/v1/stacks/{id}/height", "get_stack_height", ["image/png", "image/tiff"],
    "`not_found`; `no_result`: the stack failed, was cancelled, or was fused with `height=none`"
}

endpoint! {
    converted
    /// Get the standard deviations of the heights
    ///
    /// 16-bit grey PNG of a stack with `height=auto`: a value times `height.scale` is the standard deviation of the
    /// height of the pixel. 0 where the height is unknown. TIFF with `Accept: image/tiff`.
    height_sigma, HeightSigma, "/v1/stacks/{id}/height-sigma", "get_stack_height_sigma", ["image/png", "image/tiff"],
    "`not_found`; `no_result`: the stack failed, was cancelled, or was fused with `height=none`"
}

endpoint! {
    stored
    /// Get a small image for web pages
    ///
    /// JPEG of at most 800 px per side. Transparent pixels are shown on light grey. Stacks of older versions have a
    /// PNG. This file is not converted.
    preview, Preview, "/v1/stacks/{id}/preview", "get_stack_preview", ["image/jpeg", "image/png"],
    "`not_found`; `no_result`: the stack failed or was cancelled"
}
