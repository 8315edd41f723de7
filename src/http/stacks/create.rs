//! `POST /v1/stacks`

use axum::{
    body::Body,
    extract::State,
    http::{HeaderMap, Uri},
    response::Response,
};
use serde::Deserialize;
use utoipa::ToSchema;

use super::order::StackOrder;
use crate::{
    contract::{Name, options::StackOptions},
    http::{
        auth::Caller,
        extract::params,
        intake::{accept::upload, order::Fields},
        problem::ApiResult,
        state::App,
        views::Stack,
    },
};

/// The same by a form. `rig` and `lens` are given once: here, or in the URL.
#[derive(Debug, Deserialize, ToSchema)]
#[allow(dead_code)]
pub struct StackForm {
    /// Rig of the profile.
    #[schema(value_type = String, required = false, example = "turntable-1")]
    rig: Option<Name>,
    /// Lens of the profile.
    #[schema(value_type = String, required = false, example = "mpe65-2x")]
    lens: Option<Name>,
    /// Options, JSON; every one has a default.
    #[schema(value_type = StackOptions, required = false)]
    options: Option<StackOptions>,
    /// The zip.
    #[schema(value_type = String, format = Binary)]
    stack: Vec<u8>,
}

/// Send a focus stack
///
/// The body is a zip of the slices: front-light slices in a folder `front/` (or in the root), back-light slices in
/// `back/`; JPEG, PNG or TIFF of 8 or 16 bits, ordered by the natural order of their names. It is streamed to disk.
/// Everything that can be known is checked before the body is read (send `Expect: 100-continue`), the zip's directory
/// and image headers before the answer. 202 means: the stack is on stable storage and will be worked on.
///
/// The options are query parameters, or the JSON part `options` of a form. `PUT` does the same, for `curl -T`.
#[utoipa::path(
    post,
    path = "/v1/stacks",
    operation_id = "send_stack",
    tag = "stacks",
    params(
        ("rig" = Option<String>, Query, description = "Rig of the profile. Required with a bare zip. With a form, give it here or as the part `rig`, not both", example = "turntable-1"),
        ("lens" = Option<String>, Query, description = "Lens of the profile. Required with a bare zip. With a form, give it here or as the part `lens`, not both", example = "mpe65-2x"),
        ("profile_revision" = Option<u32>, Query, description = "Use this revision of the profile instead of the current one"),
        ("mask" = Option<crate::contract::options::MaskMode>, Query, description = "Whether the object is cut out with the back light; default `auto`"),
        ("mask_threshold" = Option<String>, Query, description = "`auto` (half-way between object and background) or 0 to 1; default `auto`"),
        ("mask_min_blob_px" = Option<u32>, Query, description = "Object parts smaller than this are removed"),
        ("mask_min_hole_px" = Option<u32>, Query, description = "Holes smaller than this are filled"),
        ("mask_edge" = Option<pinstack_science::types::mask_options::MaskEdge>, Query, description = "What the image's alpha is at the edge of the object: `hard` (default), 0 or full, or `soft`, the share of the pixel that is object; the separate mask stays hard"),
        ("format" = Option<crate::contract::options::ImageFormat>, Query, description = "Format of the image; default `png`"),
        ("jpeg_quality" = Option<u8>, Query, description = "Quality of a JPEG, 1 to 100; default 95"),
        ("bit_depth" = Option<String>, Query, description = "`8` (default), `16`, or `auto`: as the slices"),
        ("order" = Option<crate::contract::input::SliceOrder>, Query, description = "Order of the slices against the profile: `name` (default), as the names or `manifest.json` say, or `reverse`, the opposite"),
        ("input_bits" = Option<String>, Query, description = "Bits that the camera puts into 16-bit files: `10`, `12` and `14` are brought to full scale; `auto` (default) uses samples as they are and warns when they look like fewer bits; `16` does not warn"),
        ("crop" = Option<String>, Query, description = "`none`, `valid` or `x,y,w,h`; default `none`"),
        ("under_alpha" = Option<crate::contract::options::UnderAlpha>, Query, description = "Colour where alpha is 0; default `black`"),
        ("method" = Option<pinstack_science::types::fusion_options::Method>, Query, description = "How slices are fused; default `halo_corrected`; `guided` is the paper's method, and the following seven are its parameters"),
        ("r1" = Option<u32>, Query, description = "Radius of the guided filter for the base weights, px; default 45"),
        ("eps1" = Option<f64>, Query, description = "Its regularisation; default 0.3"),
        ("r2" = Option<u32>, Query, description = "Radius of the guided filter for the detail weights, px; default 7"),
        ("eps2" = Option<f64>, Query, description = "Its regularisation; default 1e-6"),
        ("average" = Option<u32>, Query, description = "Side of the mean filter of the base layer, px, odd; default 31"),
        ("r_g" = Option<u32>, Query, description = "Radius of the saliency Gaussian, px; default 5"),
        ("sigma_g" = Option<f64>, Query, description = "Its standard deviation, px; default 5"),
        ("label" = Option<String>, Query, description = "Free text, at most 200 characters; names the results"),
        ("scan" = Option<String>, Query, description = "The scan that this view belongs to"),
        ("pan_deg" = Option<f64>, Query, description = "Commanded pan of the turntable"),
        ("tilt_deg" = Option<f64>, Query, description = "Commanded tilt"),
        ("keep_days" = Option<u32>, Query, description = "Remove upload and results this many days after the end; default: never"),
        ("Idempotency-Key" = Option<String>, Header, description = "A repeat with the same key answers the first stack"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`: wait up to N seconds for the end, at most 60", example = "wait=30"),
    ),
    request_body(description = "The zip, bare or in a form", content(
        (Vec<u8> = "application/zip"),
        (Vec<u8> = "application/octet-stream"),
        (StackForm = "multipart/form-data"),
    )),
    responses(
        (status = 200, description = "The stack has ended within `Prefer: wait`", body = Stack),
        (status = 202, description = "The stack is accepted (or was before: `Idempotency-Replayed: true`)", body = Stack, headers(
            ("Location" = String, description = "The stack"),
            ("Idempotency-Replayed" = String, description = "`true` when an earlier request made it"),
            ("Preference-Applied" = String, description = "The wait that was granted"))),
        (status = 400, description = "`invalid_request`: a name or option that breaks its rule, or a rig or lens that is missing or given twice; `upload_incomplete`: the body broke off or fell silent"),
        (status = 404, description = "`profile_not_found`, before the body is read"),
        (status = 413, description = "`upload_too_large`: the body is over the limit"),
        (status = 415, description = "`unsupported_media_type`: neither a zip nor a form"),
        (status = 422, description = "`invalid_archive`, `unsupported_archive`, `archive_too_large`, `invalid_image`, `size_mismatch`, \
            `slice_count_mismatch`, `mask_failed` (required without a back light), `idempotency_key_reused`"),
        (status = 503, description = "`queue_full`, with `Retry-After`"),
        (status = 507, description = "`insufficient_storage`, with figures"),
    )
)]
pub async fn create(
    State(app): State<App>,
    caller: Caller,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> ApiResult<Response> {
    let fields = Fields { pairs: params::pairs(&uri)?, options: None };
    upload::<StackOrder, Stack>(&app, &caller, &headers, body, fields, Stack::of).await
}
