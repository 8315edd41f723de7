//! A client of tus 1.0.0.

use base64::{Engine, prelude::BASE64_STANDARD};
use reqwest::{Method, RequestBuilder, Response, StatusCode};
use serde_json::Value;
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
};
use uuid::Uuid;

use crate::app::TestApp;

pub const PIECE: &str = "application/offset+octet-stream";

pub fn metadata(pairs: &[(&str, &str)]) -> String {
    let encoded = pairs.iter().map(|(name, value)| format!("{name} {}", BASE64_STANDARD.encode(value)));
    encoded.collect::<Vec<_>>().join(",")
}

pub fn of_rig() -> String {
    metadata(&[("rig", "rig"), ("lens", "lens"), ("filename", "bee 01.zip"), ("options", r#"{"r1": 20}"#)])
}

pub fn request(app: &TestApp, method: Method, path: &str) -> RequestBuilder {
    app.client.request(method, format!("{}{path}", app.base)).header("tus-resumable", "1.0.0")
}

pub fn creation(app: &TestApp, length: usize, metadata: &str) -> RequestBuilder {
    request(app, Method::POST, "/v1/uploads").header("upload-length", length).header("upload-metadata", metadata)
}

/// Creates an upload of `length` bytes for the usual profile. Returns its URL.
pub async fn begun(app: &TestApp, length: usize) -> String {
    let answer = creation(app, length, &of_rig()).send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::CREATED);
    assert_eq!(answer.headers()["upload-offset"], "0");
    answer.headers()["location"].to_str().unwrap().to_owned()
}

pub fn piece(app: &TestApp, url: &str, offset: usize, bytes: &[u8]) -> RequestBuilder {
    request(app, Method::PATCH, url).header("upload-offset", offset).header("content-type", PIECE).body(bytes.to_vec())
}

pub async fn head(app: &TestApp, url: &str) -> Response {
    request(app, Method::HEAD, url).send().await.unwrap()
}

pub fn offset(answer: &Response) -> usize {
    answer.headers()["upload-offset"].to_str().unwrap().parse().unwrap()
}

pub fn header<'a>(answer: &'a Response, name: &str) -> &'a str {
    answer.headers().get(name).map(|value| value.to_str().unwrap()).unwrap_or_default()
}

pub fn id_of(url: &str) -> Uuid {
    url.rsplit('/').next().unwrap().parse().unwrap()
}

pub async fn shown(app: &TestApp, url: &str) -> Value {
    app.get(url).send().await.unwrap().json().await.unwrap()
}

/// Sends the head of a PATCH and the first bytes of its body on a new connection, but not the rest.
pub async fn hanging_piece(app: &TestApp, url: &str, length: usize, bytes: &[u8]) -> TcpStream {
    let mut socket = TcpStream::connect(app.base.trim_start_matches("http://")).await.unwrap();
    let head = format!(
        "PATCH {url} HTTP/1.1\r\nhost: localhost\r\ntus-resumable: 1.0.0\r\nupload-offset: 0\r\ncontent-type: {PIECE}\r\ncontent-length: {length}\r\n\r\n"
    );
    socket.write_all(head.as_bytes()).await.unwrap();
    socket.write_all(bytes).await.unwrap();
    socket.flush().await.unwrap();
    socket
}

pub async fn status_line(socket: &mut TcpStream) -> String {
    let mut told = vec![0; 12];
    socket.read_exact(&mut told).await.unwrap();
    String::from_utf8_lossy(&told).into_owned()
}

/// Waits until the server has written this many bytes, synced or not.
pub async fn until_written(app: &TestApp, url: &str, bytes: u64) {
    while app.partial_bytes(id_of(url)) < bytes {
        tokio::time::sleep(std::time::Duration::from_millis(1)).await;
    }
}
