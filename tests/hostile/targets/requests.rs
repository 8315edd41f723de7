//! Requests to the complete service, without a socket: forms and resumable uploads.

use std::{
    panic::{AssertUnwindSafe, catch_unwind, resume_unwind},
    sync::{Mutex, OnceLock, PoisonError},
};

use axum::{
    Router,
    body::Body,
    http::{HeaderMap, HeaderName, HeaderValue, Method, Request, StatusCode, header},
};
use http_body_util::BodyExt;
use pinstack::{
    contract::{Code, Problem},
    http::{App, Policy, problem, router},
    store,
};
use tempfile::TempDir;
use tokio::runtime::Runtime;
use tower::ServiceExt;

use super::limits;

/// Separator of the requests of one input.
const NEXT: &[u8] = b"\n----\n";

/// Maximum size of an upload, bytes.
const MAX_UPLOAD: u64 = 1 << 20;

/// A service without workers that has the profile `rig/lens` for two slices of 24 x 18 px.
struct Service {
    runtime: Runtime,
    router: Router,
    _data: TempDir,
}

/// A response.
struct Answer {
    status: StatusCode,
    headers: HeaderMap,
}

impl Answer {
    fn header(&self, name: &str) -> Option<&str> {
        self.headers.get(name).and_then(|value| value.to_str().ok())
    }

    fn number(&self, name: &str) -> u64 {
        self.header(name).and_then(|text| text.parse().ok()).unwrap_or_else(|| panic!("{name} is missing"))
    }
}

impl Service {
    fn start() -> Self {
        // rows in memory where there is such a place: every input may write some
        let data = TempDir::new_in("/dev/shm").or_else(|_| TempDir::new()).expect("a folder");
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
        let router = runtime.block_on(async {
            let store = store::open(data.path()).await.expect("a store");
            let policy =
                Policy { min_free_bytes: 0, max_upload_bytes: MAX_UPLOAD, archive: limits(), ..Policy::default() };
            router::service(App::new(store, policy))
        });
        let service = Self { runtime, router, _data: data };
        let profile = r#"{"image_width": 24, "image_height": 18, "reference_index": 0,
            "homographies": [[1,0,0,0,1,0,0,0,1], [1.01,0,0,0,1.01,0,0,0,1]]}"#;
        let put = Request::put("/v1/profiles/rig/lens").header(header::CONTENT_TYPE, "application/json");
        assert_eq!(service.send(put.body(profile.into()).expect("a request")).status, StatusCode::CREATED);
        service
    }

    /// Sends a request and checks the properties that every response has.
    fn send(&self, mut request: Request<Body>) -> Answer {
        request.headers_mut().entry(header::HOST).or_insert(HeaderValue::from_static("localhost"));
        let told = format!("{} {}", request.method(), request.uri());
        let (parts, body) = self.runtime.block_on(async {
            let Ok(response) = self.router.clone().oneshot(request).await;
            let (parts, body) = response.into_parts();
            (parts, body.collect().await.expect("a whole answer").to_bytes())
        });
        let status = parts.status;
        let is_ours = !status.is_server_error()
            || [StatusCode::SERVICE_UNAVAILABLE, StatusCode::INSUFFICIENT_STORAGE].contains(&status);
        assert!(is_ours, "{told}: {status} {}", String::from_utf8_lossy(&body));
        if status.is_client_error() || status.is_server_error() {
            let problem: Problem = serde_json::from_slice(&body).expect("every refusal is a problem");
            assert_eq!(problem.status, status.as_u16(), "{told}");
            assert_eq!(problem::status(problem.code), status, "{told}: {:?}", problem.code);
            assert_ne!(problem.code, Code::Internal);
            assert!(problem.detail.len() < 20_000, "{told}: {} bytes of detail", problem.detail.len());
        }
        Answer { status, headers: parts.headers }
    }

    /// Removes what an input created, so that rows do not accumulate.
    fn remove(&self, place: &str) {
        let delete = Request::delete(place).header("Tus-Resumable", "1.0.0");
        self.send(delete.body(Body::empty()).expect("a request"));
    }
}

/// Calls `with` with the service of this process.
fn with_service(with: impl FnOnce(&Service)) {
    static SERVICE: OnceLock<Mutex<Service>> = OnceLock::new();
    let service = SERVICE.get_or_init(|| Mutex::new(Service::start()));
    let service = service.lock().unwrap_or_else(PoisonError::into_inner);
    let outcome = catch_unwind(AssertUnwindSafe(|| with(&service)));
    drop(service);
    outcome.unwrap_or_else(|panic| resume_unwind(panic));
}

/// Lines `Name: value`, an empty line, a body.
fn request(method: Method, uri: &str, usual: &[(&str, &str)], told: &[u8]) -> Option<Request<Body>> {
    let split = told.windows(2).position(|two| two == b"\n\n");
    let (head, body) = split.map_or((told, &[][..]), |at| (&told[..at], &told[at + 2..]));
    let mut request = Request::builder().method(method).uri(uri).body(chunks(body)).ok()?;
    let headers = request.headers_mut();
    for (name, value) in usual {
        headers.insert(HeaderName::from_bytes(name.as_bytes()).ok()?, HeaderValue::from_str(value).ok()?);
    }
    for line in head.split(|&byte| byte == b'\n').filter(|line| !line.is_empty()) {
        let colon = line.iter().position(|&byte| byte == b':')?;
        let name = HeaderName::from_bytes(line[..colon].trim_ascii()).ok()?;
        headers.insert(name, HeaderValue::from_bytes(line[colon + 1..].trim_ascii()).ok()?);
    }
    // what hyper would not let through
    let announced = headers.get(header::CONTENT_LENGTH);
    if announced.is_some_and(|told| told.as_bytes() != body.len().to_string().as_bytes()) {
        return None;
    }
    Some(request)
}

/// A body in several chunks, the first of one byte, so that boundaries are split.
fn chunks(body: &[u8]) -> Body {
    let first = body.len().min(1);
    let chunks: Vec<Vec<u8>> = std::iter::once(&body[..first])
        .chain(body[first..].chunks(97))
        .filter(|chunk| !chunk.is_empty())
        .map(<[u8]>::to_vec)
        .collect();
    Body::from_stream(futures::stream::iter(chunks.into_iter().map(Ok::<_, std::convert::Infallible>)))
}

/// A form: its headers, an empty line, its body.
pub fn multipart(bytes: &[u8]) {
    let usual = [("content-type", "multipart/form-data; boundary=XX")];
    let Some(request) = request(Method::POST, "/v1/stacks", &usual, bytes) else { return };
    with_service(|service| {
        let answer = service.send(request);
        if answer.status == StatusCode::ACCEPTED {
            service.remove(answer.header("location").expect("an accepted stack has a place"));
        }
    });
}

/// The creation of a resumable upload and its next part; each has headers, an empty line and a body.
pub fn tus(bytes: &[u8]) {
    let split = bytes.windows(NEXT.len()).position(|window| window == NEXT);
    let (first, second) = split.map_or((bytes, &[][..]), |at| (&bytes[..at], &bytes[at + NEXT.len()..]));
    let usual = [("tus-resumable", "1.0.0"), ("upload-length", "100")];
    let Some(begin) = request(Method::POST, "/v1/uploads", &usual, first) else { return };
    with_service(|service| {
        let begun = service.send(begin);
        let Some(place) = begun.header("location") else {
            assert!(!begun.status.is_success(), "an upload that begins has a place");
            return;
        };
        assert_eq!(begun.status, StatusCode::CREATED);
        go_on(service, place, begun.number("upload-offset"), second);
        service.remove(place);
        if let Some(job) = begun.header("pinstack-job") {
            service.remove(job);
        }
    });
}

fn go_on(service: &Service, place: &str, before: u64, piece: &[u8]) {
    let head = || request(Method::HEAD, place, &[("tus-resumable", "1.0.0")], b"").expect("a request");
    let there = service.send(head());
    if there.status != StatusCode::OK {
        return;
    }
    assert_eq!(there.number("upload-offset"), before, "what was told stays");
    let length = there.number("upload-length");
    let offset = before.to_string();
    let usual = [
        ("tus-resumable", "1.0.0"),
        ("content-type", "application/offset+octet-stream"),
        ("upload-offset", offset.as_str()),
    ];
    let Some(patch) = request(Method::PATCH, place, &usual, piece) else { return };
    let patched = service.send(patch);
    if patched.status.is_success() {
        assert!((before..=length).contains(&patched.number("upload-offset")));
    }
    let after = service.send(head());
    if after.status == StatusCode::OK {
        assert!((before..=length).contains(&after.number("upload-offset")), "an offset never goes back");
    }
    if let Some(job) = after.header("pinstack-job") {
        service.remove(job);
    }
}
