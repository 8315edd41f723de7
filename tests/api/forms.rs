use reqwest::{Response, StatusCode};
use serde_json::{Value, json};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
};

use crate::app::{TestApp, problem, stack_zip};

const BOUNDARY: &str = "xxBOUNDARYxx";

/// A form encoded as browsers do.
async fn send(app: &TestApp, url: &str, parts: &[(&str, &[u8])]) -> Response {
    let mut body = Vec::new();
    for (name, value) in parts {
        let file = match *name {
            "stack" => "; filename=\"night 1.zip\"",
            "front" => "; filename=\"a.jpg\"",
            _ => "",
        };
        body.extend_from_slice(
            format!("--{BOUNDARY}\r\ncontent-disposition: form-data; name=\"{name}\"{file}\r\n\r\n").as_bytes(),
        );
        body.extend_from_slice(value);
        body.extend_from_slice(b"\r\n");
    }
    body.extend_from_slice(format!("--{BOUNDARY}--\r\n").as_bytes());
    let kind = format!("multipart/form-data; boundary={BOUNDARY}");
    app.post(url).header("content-type", kind).body(body).send().await.unwrap()
}

#[tokio::test]
async fn the_parts_of_a_form_may_come_in_any_order() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let zip = stack_zip(2, 0);
    let options = json!({ "r1": 20, "bit_depth": 8, "label": "bee" }).to_string();
    let mut parts: Vec<(&str, &[u8])> =
        vec![("rig", b"rig"), ("lens", b"lens"), ("options", options.as_bytes()), ("stack", &zip)];
    for _ in 0..4 {
        parts.rotate_left(1);
        let answer = send(&app, "/v1/stacks", &parts).await;
        assert_eq!(answer.status(), StatusCode::ACCEPTED);
        let stack: Value = answer.json().await.unwrap();
        assert_eq!((&stack["options"]["r1"], &stack["options"]["bit_depth"]), (&json!(20), &json!("8")));
        assert_eq!(stack["upload"]["filename"], "night 1.zip");
        assert_eq!(stack["upload"]["bytes"].as_u64(), Some(zip.len() as u64));
    }
}

#[tokio::test]
async fn an_invalid_form_is_refused_with_the_reason() {
    let app = TestApp::start().await;
    let zip = stack_zip(2, 0);
    let with =
        |options: &'static [u8]| [("rig", &b"rig"[..]), ("lens", b"lens"), ("options", options), ("stack", &zip)];
    problem(send(&app, "/v1/stacks", &with(b"{}")).await, 404, "profile_not_found").await;
    app.with_profile(2).await;
    let told = problem(send(&app, "/v1/stacks", &with(b"{\"r1\": \"many\"}")).await, 400, "invalid_request").await;
    assert_eq!(told["errors"][0]["pointer"], "/r1");
    problem(send(&app, "/v1/stacks", &with(b"{\"radius\": 1}")).await, 400, "invalid_request").await;
    problem(send(&app, "/v1/stacks?r1=3", &with(b"{}")).await, 400, "invalid_request").await;
    problem(send(&app, "/v1/stacks", &[("rig", b"rig"), ("lens", b"lens")]).await, 400, "invalid_request").await;
    problem(send(&app, "/v1/stacks", &[("stack", &zip)]).await, 400, "invalid_request").await;
    for url in ["/v1/stacks?rig=rig", "/v1/stacks?rig=rig&lens=lens"] {
        let told = problem(send(&app, url, &with(b"{}")).await, 400, "invalid_request").await;
        assert!(told["detail"].as_str().unwrap().contains("'rig' is given twice"), "{told}");
    }
    let calibrations = "/v1/profiles/rig/lens/calibrations";
    problem(send(&app, calibrations, &[("rig", b"other"), ("stack", &zip)]).await, 400, "invalid_request").await;
    assert_eq!(app.spooled(), 0);
    assert_eq!(app.store.metadata.counts().await.unwrap().queued, 0);
}

#[tokio::test]
async fn loose_pictures_in_a_form_are_refused_with_the_name_of_the_zip_part() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let parts: [(&str, &[u8]); 4] =
        [("rig", b"rig"), ("lens", b"lens"), ("front", b"\xFF\xD8"), ("front", b"\xFF\xD8")];
    let told = problem(send(&app, "/v1/stacks", &parts).await, 400, "invalid_request").await;
    assert!(told["detail"].as_str().unwrap().contains("-F stack=@stack.zip"), "{told}");
}

/// Sends the `pieces` of a form until the server responds. Returns the status line and the number of bytes sent.
async fn endless(app: &TestApp, pieces: impl IntoIterator<Item = Vec<u8>>) -> (String, usize) {
    let socket = TcpStream::connect(app.base.trim_start_matches("http://")).await.unwrap();
    let (mut answer, mut request) = socket.into_split();
    let head = format!(
        "POST /v1/stacks?rig=rig&lens=lens HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\
         content-type: multipart/form-data; boundary={BOUNDARY}\r\ncontent-length: 1073741824\r\n\r\n"
    );
    request.write_all(head.as_bytes()).await.unwrap();
    let mut told = String::new();
    let mut sent = 0;
    let mut pieces = pieces.into_iter();
    let mut line = vec![0; 12];
    let answered = answer.read_exact(&mut line);
    tokio::pin!(answered);
    loop {
        tokio::select! {
            biased;
            _ = &mut answered => break,
            () = tokio::task::yield_now() => {}
        }
        let piece = pieces.next().expect("the server reads for ever");
        sent += piece.len();
        if request.write_all(&piece).await.is_err() {
            let _ = (&mut answered).await;
            break;
        }
    }
    told.push_str(&String::from_utf8_lossy(&line));
    (told, sent)
}

#[tokio::test]
async fn a_form_buffers_a_bounded_number_of_bytes_outside_its_parts() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let many = |piece: Vec<u8>| std::iter::repeat_n(piece, 20_000);
    let part = |rest: &str| format!("--{BOUNDARY}\r\nContent-Disposition: form-data; name=\"{rest}").into_bytes();
    let whole = |name: &str, value: &str| [part(&format!("{name}\"\r\n\r\n{value}\r\n"))].concat();
    let closed = [whole("x", "y"), format!("--{BOUNDARY}--\r\n").into_bytes()].concat();
    for (what, first) in [
        ("no boundary", Vec::new()),
        ("a name without an end", part("")),
        ("headers without an end", part("x\"\r\nA: ")),
        ("blanks behind a boundary", format!("--{BOUNDARY}").into_bytes()),
        ("a body behind its end", closed),
    ] {
        let filler = if what.starts_with("blanks") { b' ' } else { b'a' };
        let pieces = std::iter::once(first).chain(many(vec![filler; 32 << 10]));
        let (told, sent) = endless(&app, pieces).await;
        assert_eq!(told, "HTTP/1.1 400", "{what}");
        assert!(sent < 512 << 20, "{what}: {sent} bytes were taken");
    }
    let parts = (0..20_000).map(|i| whole(&format!("x{i}"), ""));
    assert_eq!(endless(&app, parts).await.0, "HTTP/1.1 400");
    assert_eq!(app.spooled(), 0);
}

#[tokio::test]
async fn text_before_and_after_a_form_is_ignored() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let zip = stack_zip(2, 0);
    let mut body = b"this is a form\r\n".to_vec();
    for (name, value) in [("rig", &b"rig"[..]), ("lens", b"lens"), ("stack", &zip)] {
        body.extend(format!("--{BOUNDARY}\r\ncontent-disposition: form-data; name=\"{name}\"\r\n\r\n").bytes());
        body.extend_from_slice(value);
        body.extend_from_slice(b"\r\n");
    }
    body.extend(format!("--{BOUNDARY}--\r\nand this is its end").bytes());
    // in chunks of all sizes, so that boundaries are split
    for size in [1, 7, 64, 4096, body.len()] {
        let chunks: Vec<_> = body.chunks(size).map(|chunk| Ok::<_, std::io::Error>(chunk.to_vec())).collect();
        let request =
            app.post("/v1/stacks").header("content-type", format!("multipart/form-data; boundary={BOUNDARY}"));
        let answer = request.body(reqwest::Body::wrap_stream(futures::stream::iter(chunks))).send().await.unwrap();
        assert_eq!(answer.status(), StatusCode::ACCEPTED, "{size}");
        let stack: Value = answer.json().await.unwrap();
        assert_eq!(stack["upload"]["bytes"].as_u64(), Some(zip.len() as u64));
    }
}
