//! `GET /problems/{code}`: the page that the `type` of a problem links to.

use axum::{Json, extract::Path};
use serde::Serialize;
use utoipa::ToSchema;

use crate::{
    contract::{Code, one_line},
    http::{
        ApiError, ApiResult,
        problem_types::{ProblemType, problem_type},
    },
};

/// A problem type.
#[derive(Serialize, ToSchema)]
pub struct ProblemKind {
    /// Stable code.
    code: Code,
    /// HTTP status of the answer. A failed job shows the same code.
    status: u16,
    /// The `title` of such a problem.
    title: &'static str,
    /// What it means and what to do.
    description: &'static str,
    /// A typical `detail`.
    example: &'static str,
}

impl ProblemKind {
    fn of(code: Code) -> Self {
        let ProblemType { status, title, description, example, .. } = problem_type(code);
        Self { code, status: status.as_u16(), title, description, example }
    }
}

/// Get a problem type
///
/// The `type` of every problem is the URL of this page: what it means and what to do.
#[utoipa::path(
    get,
    path = "/problems/{code}",
    operation_id = "get_problem_kind",
    tag = "service",
    params(("code" = String, Path, description = "The `code` of a problem")),
    responses(
        (status = 200, description = "What it means and what to do", body = ProblemKind),
        (status = 404, description = "`not_found`: no such code"),
    )
)]
pub async fn problem_kind(Path(name): Path<String>) -> ApiResult<Json<ProblemKind>> {
    match serde_json::from_value(serde_json::Value::String(name.clone())) {
        Ok(code) => Ok(Json(ProblemKind::of(code))),
        Err(_) => {
            let shown: String = name.chars().take(80).collect();
            let shown = one_line(&shown);
            let detail = format!(
                "there is no problem with the code '{shown}'; the schema Code in /openapi.json lists all codes"
            );
            Err(ApiError::new(Code::NotFound, detail))
        }
    }
}
