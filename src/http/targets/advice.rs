//! `GET /v1/targets/advice`

use axum::{Json, http::Uri};

use crate::http::{ApiResult, extract::params};
use pinstack_science::optics::{
    advice::{TargetAdvice, advice as advise},
    plan::{PlanInput, plan},
};

/// Choose a dot target
///
/// The pitch that the blur of a capture needs, and how many dots fill the field of view. The parameters are those of
/// `GET /v1/optics/plan`; `target` is the URL of the target to print.
#[utoipa::path(
    get,
    path = "/v1/targets/advice",
    operation_id = "advise_target",
    tag = "optics",
    params(PlanInput),
    responses(
        (status = 200, description = "The target", body = TargetAdvice),
        (status = 400, description = "`invalid_request`: a parameter that is missing, unknown or outside its range"),
    )
)]
pub async fn advice(uri: Uri) -> ApiResult<Json<TargetAdvice>> {
    let input: PlanInput = params::from_uri(&uri)?;
    Ok(Json(advise(&plan(&input)?)))
}
