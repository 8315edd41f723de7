//! Endless malformed forms, and the memory that they use.

use axum::{
    body::{Body, Bytes},
    http::{Request, StatusCode, header},
};
use pinstack::{
    http::{App, Policy, router},
    store,
};
use tower::ServiceExt;

use crate::peak::peak_of;

/// Size of the chunks of a body, the largest that the network delivers.
const PIECE: usize = 400 << 10;
/// 200 MB.
const PIECES: usize = 500;
/// Peak memory of one request, bytes: a chunk, the copy of the parser (which grows by doubling), and the base need of a
/// request.
const MOST: usize = 4 << 20;

#[test]
fn an_endless_malformed_form_is_refused_with_little_memory() {
    let data = tempfile::tempdir().expect("a folder");
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
    let service = runtime.block_on(async {
        let store = store::open(data.path()).await.expect("a store");
        router::service(App::new(store, Policy { min_free_bytes: 0, ..Policy::default() }))
    });
    let part = "--XBX\r\nContent-Disposition: form-data; name=\"";
    for (what, first) in [
        ("no boundary", String::new()),
        ("the start of a boundary", "--XB".into()),
        ("a name without an end", part.into()),
        ("headers without an end", format!("{part}x\"\r\nA: ")),
        ("a body behind its end", format!("{part}x\"\r\n\r\ny\r\n--XBX--\r\n")),
        ("a text without an end", format!("{part}x\"\r\n\r\n")),
    ] {
        let filler = Bytes::from(vec![b'a'; PIECE]);
        let pieces = std::iter::once(Bytes::from(first)).chain(std::iter::repeat_n(filler, PIECES));
        let pieces = futures::stream::iter(pieces.map(Ok::<_, std::io::Error>));
        let request = Request::post("/v1/stacks").header(header::HOST, "localhost");
        let request = request.header(header::CONTENT_TYPE, "multipart/form-data; boundary=XBX");
        let request = request.body(Body::from_stream(pieces)).expect("a request");
        let (status, peak) = peak_of(|| {
            runtime.block_on(async { service.clone().oneshot(request).await.map(|answer| answer.status()) })
        });
        assert_eq!(status.expect("an answer"), StatusCode::BAD_REQUEST, "{what}");
        assert!(peak < MOST, "{what}: {peak} bytes at the peak");
    }
}
