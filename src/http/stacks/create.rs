//! `POST /v1/stacks`

use axum::{
    body::Body,
    extract::State,
    http::{HeaderMap, Uri},
    response::Response,
};
use serde::Deserialize;
use utoipa::ToSchema;

use crate::{
    contract::{JobKind, Name, options::StackOptions},
    http::{
        auth::Caller,
        ingest::{fields::Fields, request::IngestRequest},
        problem::ApiResult,
        state::App,
        views::Stack,
    },
};

/// A stack as a form. Give `rig` and `lens` either here or in the URL, not in both.
#[derive(Debug, Deserialize, ToSchema)]
#[allow(dead_code)]
pub struct StackForm {
    /// Rig of the profile.
    #[schema(value_type = String, required = false, example = "turntable-1")]
    rig: Option<Name>,
    /// Lens of the profile.
    #[schema(value_type = String, required = false, example = "mpe65-2x")]
    lens: Option<Name>,
    /// Options as JSON. Every option has a default.
    #[schema(value_type = StackOptions, required = false)]
    options: Option<StackOptions>,
    /// The zip of the slices.
    #[schema(value_type = String, format = Binary)]
    stack: Vec<u8>,
}

/// Submit a focus stack
///
/// The body is a zip of the slices: front-light slices in the folder `front/` (or in the root), back-light slices in
/// `back/`. Slices are JPEG, PNG or TIFF files of 8 or 16 bits per sample. Their order is the natural order of their names.
///
/// Names, options, profile, length, quota and disk space are checked before the body is read; send `Expect: 100-continue`
/// to profit from that. The body is streamed to disk. The directory of the zip and the headers of its images are checked
/// before the response. 202 means that the stack is on stable storage and queued; poll its URL, or follow its events.
///
/// Options are query parameters, or the JSON part `options` of a form. `PUT` is equivalent, for `curl -T`.
#[utoipa::path(
    post,
    path = "/v1/stacks",
    operation_id = "send_stack",
    tag = "stacks",
    params(
        ("rig" = Option<String>, Query, description = "Rig of the profile. Required for a bare zip. For a form, give it here or as the part `rig`, not both", example = "turntable-1"),
        ("lens" = Option<String>, Query, description = "Lens of the profile. Required for a bare zip. For a form, give it here or as the part `lens`, not both", example = "mpe65-2x"),
        ("profile_revision" = Option<u32>, Query, description = "Revision of the profile; default: the current one"),
        ("mask" = Option<crate::contract::options::MaskMode>, Query, description = "Whether the object is cut out with the back-light stack: `auto` (default; if there is one), `none`, or `required`"),
        ("mask_threshold" = Option<String>, Query, description = "Threshold of the fused back light: `auto` (default; half-way between object and background), or 0 to 1"),
        ("mask_min_blob_px" = Option<u32>, Query, description = "Remove parts of the object smaller than this, px (area); default: 0.002 % of a slice, at least 4"),
        ("mask_min_hole_px" = Option<u32>, Query, description = "Fill holes smaller than this, px (area); default: 0.0005 % of a slice, at least 4"),
        ("mask_edge" = Option<pinstack_science::types::mask_options::MaskEdge>, Query, description = "Alpha of the image at the edge of the object: `hard` (default; 0 or full) or `soft` (the fraction of the pixel that is object). The separate mask is always hard"),
        ("format" = Option<crate::contract::options::ImageFormat>, Query, description = "File format of the image; default `png`"),
        ("jpeg_quality" = Option<u8>, Query, description = "Quality of the image with `format=jpeg`, 1 to 100; default 95"),
        ("bit_depth" = Option<String>, Query, description = "Bits per sample of the image: `8` (default), `16`, or `auto` (as the slices)"),
        ("order" = Option<crate::contract::input::SliceOrder>, Query, description = "Order of the slices relative to the profile: `name` (default; natural order of the names, or that of `manifest.json`) or `reverse`"),
        ("input_bits" = Option<String>, Query, description = "Significant bits of 16-bit files. `10`, `12` and `14` are scaled to full range. `auto` (default) uses samples unchanged and warns when they look like fewer bits. `16` uses them unchanged without a warning"),
        ("crop" = Option<String>, Query, description = "`none` (default), `valid` (the largest rectangle that every slice covers), or `x,y,w,h` in px of the reference slice"),
        ("under_alpha" = Option<crate::contract::options::UnderAlpha>, Query, description = "Colour of pixels whose alpha is 0: `black` (default) or `keep`"),
        ("method" = Option<pinstack_science::types::fusion_options::Method>, Query, description = "Fusion method; default `halo_corrected`. The next seven parameters apply to `guided` only"),
        ("r1" = Option<u32>, Query, description = "`guided`: radius of the guided filter for the weights of the base layer, px; default 45"),
        ("eps1" = Option<f64>, Query, description = "`guided`: regularisation for the base layer, for intensities in 0..1; default 0.3"),
        ("r2" = Option<u32>, Query, description = "`guided`: radius of the guided filter for the weights of the detail layer, px; default 7"),
        ("eps2" = Option<f64>, Query, description = "`guided`: regularisation for the detail layer; default 1e-6"),
        ("average" = Option<u32>, Query, description = "`guided`: side of the mean filter that makes the base layer, px, odd; default 31"),
        ("r_g" = Option<u32>, Query, description = "`guided`: radius of the Gaussian that smooths the saliency, px; default 5"),
        ("sigma_g" = Option<f64>, Query, description = "`guided`: standard deviation of that Gaussian, px; default 5"),
        ("label" = Option<String>, Query, description = "Free text, at most 200 characters; used in the file names of the results"),
        ("scan" = Option<String>, Query, description = "The scan that this view belongs to"),
        ("pan_deg" = Option<f64>, Query, description = "Commanded pan of the turntable, degrees"),
        ("tilt_deg" = Option<f64>, Query, description = "Commanded tilt, degrees"),
        ("keep_days" = Option<u32>, Query, description = "Delete upload and results this many days after the end; default: never"),
        ("Idempotency-Key" = Option<String>, Header, description = "A request that repeats an earlier one with the same key gets the stack of the first"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`: wait up to N seconds (at most 60) for the job to end", example = "wait=30"),
    ),
    request_body(description = "The zip, as the whole body or in a form", content(
        (Vec<u8> = "application/zip"),
        (Vec<u8> = "application/octet-stream"),
        (StackForm = "multipart/form-data"),
    )),
    responses(
        (status = 200, description = "The stack has ended within the time of `Prefer: wait`", body = Stack),
        (status = 202, description = "The stack is accepted (with `Idempotency-Replayed: true`: by an earlier request)", body = Stack, headers(
            ("Location" = String, description = "URL of the stack"),
            ("Idempotency-Replayed" = String, description = "`true` when an earlier request made the stack"),
            ("Preference-Applied" = String, description = "The wait that was granted"))),
        (status = 400, description = "`invalid_request`: an invalid name or option, or a rig or lens that is missing or given twice; `upload_incomplete`: the connection closed or timed out before the end of the body"),
        (status = 404, description = "`profile_not_found`, sent before the body is read"),
        (status = 413, description = "`upload_too_large`: the body exceeds the limit"),
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
    let fields = Fields::of_query(&uri)?;
    let request = IngestRequest::begin(&app, &caller, &headers).await?;
    let (submission, zip) = request.receive(JobKind::Stack, fields, body).await?;
    let stack = request.submit(submission, zip).await?;
    request.answer(stack).await
}
