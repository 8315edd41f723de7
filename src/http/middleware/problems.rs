//! Makes every error answer a problem document that names its request, also errors made by libraries.

use std::any::Any;

use axum::{
    extract::Request,
    http::{StatusCode, header},
    middleware::Next,
    response::{IntoResponse, Response},
};

use crate::{
    contract::{Code, Fault, Problem},
    http::{
        pages::errors::ShownAsPage,
        problem::{ApiError, code_of, problem, render},
        problem_types::INTERNAL,
    },
    supervision,
};

/// The layer: fills in `instance`, and turns bare error answers into problem documents.
pub async fn complete(request: Request, next: Next) -> Response {
    let instance = request.uri().path().to_owned();
    let method = request.method().clone();
    let mut response = next.run(request).await;
    let status = response.status();
    if !(status.is_client_error() || status.is_server_error()) {
        return response;
    }
    let mut problem_document = match response.extensions_mut().remove::<Problem>() {
        Some(problem) => problem,
        // the health check answers 503 with its own JSON body
        None if is_json(&response) => return response,
        // nor is the page that shows an error to a person
        None if response.extensions().get::<ShownAsPage>().is_some() => return response,
        None => {
            let bare = problem(&bare_fault(status, &method, &instance), None);
            Problem { status: status.as_u16(), ..bare }
        }
    };
    problem_document.instance = Some(link!("{instance}"));
    let mut complete = render(problem_document);
    for (name, value) in response.headers() {
        if ![header::CONTENT_TYPE, header::CONTENT_LENGTH].contains(name) {
            complete.headers_mut().append(name, value.clone());
        }
    }
    complete
}

/// The answer to a panic; its message goes to the log.
pub fn from_panic(panic: Box<dyn Any + Send + 'static>) -> Response {
    ApiError::internal(format!("panic: {}", supervision::message(&*panic))).into_response()
}

fn is_json(response: &Response) -> bool {
    let content_type = response.headers().get(header::CONTENT_TYPE).and_then(|v| v.to_str().ok());
    content_type.is_some_and(|t| t.starts_with("application/json"))
}

fn bare_fault(status: StatusCode, method: &axum::http::Method, path: &str) -> Fault {
    let code = code_of(status);
    let detail = match code {
        Code::NotFound => format!("there is nothing at {path}; GET /openapi.json lists every URL"),
        Code::MethodNotAllowed => {
            format!("{method} is not allowed on {path}; the Allow header lists the methods that are")
        }
        Code::Internal => INTERNAL.to_owned(),
        _ => status.canonical_reason().unwrap_or("the request was refused").to_lowercase(),
    };
    Fault::new(code, detail)
}

#[cfg(test)]
mod tests {
    use axum::{Router, body::Body, middleware::from_fn, routing::get};
    use http_body_util::BodyExt;
    use tower::ServiceExt;
    use tower_http::catch_panic::CatchPanicLayer;

    use super::*;

    #[tokio::test]
    async fn the_message_of_a_panic_goes_to_the_log_only() {
        async fn boom() -> StatusCode {
            panic!("row 7 of /var/lib/pinstack")
        }
        let router =
            Router::new().route("/boom", get(boom)).layer(CatchPanicLayer::custom(from_panic)).layer(from_fn(complete));
        let request = Request::get("/boom").body(Body::empty()).expect("a request");
        let Ok(response) = router.oneshot(request).await;
        assert_eq!(response.status(), StatusCode::INTERNAL_SERVER_ERROR);
        let body = response.into_body().collect().await.expect("a body").to_bytes();
        let problem: Problem = serde_json::from_slice(&body).expect("a problem");
        assert_eq!((problem.code, problem.instance.as_deref()), (Code::Internal, Some("/boom")));
        assert!(!problem.detail.contains("var"), "{}", problem.detail);
    }
}
