//! A network that a test can break: a relay before a server, for TCP and for HTTP.

use std::{
    path::PathBuf,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
};

use axum::{
    Router,
    body::{Body, to_bytes},
    extract::{Request, State},
    http::{HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use tokio::{
    io::{AsyncRead, AsyncWrite, copy_bidirectional},
    net::{TcpListener, TcpStream, UnixStream},
    sync::watch,
};

/// Where a relay leads.
#[derive(Clone)]
pub enum Target {
    /// Address and port.
    Tcp(String),
    /// A socket of this machine.
    Unix(PathBuf),
}

/// A relay of connections. While it is cut, no byte passes and no end is told, as when a cable is pulled.
pub struct Relay {
    pub address: String,
    cut: watch::Sender<bool>,
}

trait Connection: AsyncRead + AsyncWrite + Send + Unpin {}
impl<T: AsyncRead + AsyncWrite + Send + Unpin> Connection for T {}

impl Relay {
    pub async fn to(target: Target) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let address = listener.local_addr().expect("an address").to_string();
        let (cut, state) = watch::channel(false);
        tokio::spawn(async move {
            while let Ok((client, _)) = listener.accept().await {
                tokio::spawn(relay(client, target.clone(), state.clone()));
            }
        });
        Self { address, cut }
    }

    /// Cuts the network.
    pub fn cut(&self) {
        self.cut.send_replace(true);
    }

    /// Mends it. Connections that were cut stay dead: their ends have given up by then, or will.
    pub fn mend(&self) {
        self.cut.send_replace(false);
    }
}

async fn relay(mut client: TcpStream, target: Target, mut state: watch::Receiver<bool>) {
    if *state.borrow() {
        // accepted by the machine between, and never answered
        let _ = state.wait_for(|cut| !cut).await;
        return;
    }
    let server: std::io::Result<Box<dyn Connection>> = match target {
        Target::Tcp(address) => TcpStream::connect(address).await.map(|stream| Box::new(stream) as _),
        Target::Unix(path) => UnixStream::connect(path).await.map(|stream| Box::new(stream) as _),
    };
    let Ok(mut server) = server else { return };
    let mut watched = state.clone();
    let is_cut = tokio::select! {
        _ = copy_bidirectional(&mut client, &mut server) => false,
        _ = watched.wait_for(|cut| *cut) => true,
    };
    if is_cut {
        // both ends stay connected to nothing until the network is mended
        let _ = state.wait_for(|cut| !cut).await;
    }
}

/// What a bucket does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mood {
    /// What it is asked to.
    Good,
    /// It answers 503 to everything.
    Failing,
    /// It acknowledges what it is to store, and does not store it.
    Lying,
}

/// An HTTP server before a bucket.
pub struct Moody {
    pub url: String,
    mood: watch::Sender<Mood>,
    hurt: Arc<AtomicUsize>,
}

#[derive(Clone)]
struct Before {
    bucket: String,
    client: reqwest::Client,
    mood: watch::Receiver<Mood>,
    hurt: Arc<AtomicUsize>,
}

impl Moody {
    pub async fn before(bucket: &str) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let url = format!("http://{}", listener.local_addr().expect("an address"));
        let (mood, watched) = watch::channel(Mood::Good);
        let hurt = Arc::new(AtomicUsize::new(0));
        let client = reqwest::Client::builder().no_proxy().build().expect("a client");
        let before = Before { bucket: bucket.to_owned(), client, mood: watched, hurt: Arc::clone(&hurt) };
        let router = Router::new().fallback(answer).with_state(before);
        tokio::spawn(async move { axum::serve(listener, router).await });
        Self { url, mood, hurt }
    }

    pub fn becomes(&self, mood: Mood) {
        self.mood.send_replace(mood);
    }

    /// Requests that it did not do as asked.
    pub fn hurt(&self) -> usize {
        self.hurt.load(Ordering::SeqCst)
    }
}

async fn answer(State(before): State<Before>, request: Request) -> Response {
    let mood = *before.mood.borrow();
    let stores = request.method() == "PUT";
    if mood != Mood::Good && (mood != Mood::Lying || stores) {
        before.hurt.fetch_add(1, Ordering::SeqCst);
    }
    match mood {
        Mood::Failing => return StatusCode::SERVICE_UNAVAILABLE.into_response(),
        Mood::Lying if stores => {
            let _ = to_bytes(request.into_body(), usize::MAX).await;
            return (StatusCode::OK, [(header::ETAG, HeaderValue::from_static("\"0\""))]).into_response();
        }
        Mood::Good | Mood::Lying => {}
    }
    let (head, body) = request.into_parts();
    let path = head.uri.path_and_query().map_or("/", |path| path.as_str());
    let body = to_bytes(body, usize::MAX).await.expect("a body");
    let sent = before.client.request(head.method, format!("{}{path}", before.bucket)).headers(head.headers).body(body);
    let Ok(answer) = sent.send().await else { return StatusCode::BAD_GATEWAY.into_response() };
    let (status, headers) = (answer.status(), answer.headers().clone());
    let mut response = Response::new(Body::from_stream(answer.bytes_stream()));
    (*response.status_mut(), *response.headers_mut()) = (status, headers);
    response.headers_mut().remove(header::TRANSFER_ENCODING);
    response
}
