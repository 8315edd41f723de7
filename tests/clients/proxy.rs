//! An unreliable network: a proxy that cuts connections after a random number of bytes.

use std::{
    io::{Read, Write},
    net::{Shutdown, TcpListener, TcpStream},
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
};

/// Largest number of bytes before a connection is cut.
const LONGEST: u64 = 60_000;

/// A proxy that runs until it is dropped.
pub struct Proxy {
    pub url: String,
    cuts: Arc<AtomicUsize>,
}

impl Proxy {
    /// Cuts the first `cuts` connections in either direction, each after a number of bytes derived from `seed`. Later
    /// connections are not cut.
    pub fn cutting(server: &str, cuts: usize, seed: u64) -> Self {
        let server = server.trim_start_matches("http://").to_owned();
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let url = format!("http://{}", listener.local_addr().expect("an address"));
        let done = Arc::new(AtomicUsize::new(0));
        let counter = Arc::clone(&done);
        thread::spawn(move || {
            let mut random = seed;
            for client in listener.incoming() {
                let (Ok(client), Ok(server)) = (client, TcpStream::connect(&server)) else { return };
                // Knuth's MMIX; the high bits are good enough to choose a byte
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                let is_cut = counter.load(Ordering::SeqCst) < cuts;
                let answer_is_lost = (random >> 62) == 0;
                let (up, down) = match (is_cut, answer_is_lost) {
                    (false, _) => (u64::MAX, u64::MAX),
                    (true, true) => (u64::MAX, (random >> 33) % 200),
                    (true, false) => ((random >> 33) % LONGEST, u64::MAX),
                };
                forward(&client, &server, up, &counter);
                forward(&server, &client, down, &counter);
            }
        });
        Self { url, cuts: done }
    }

    /// Number of connections that were cut.
    pub fn cuts(&self) -> usize {
        self.cuts.load(Ordering::SeqCst)
    }
}

/// Copies from one stream to the other and closes both after `most` bytes.
fn forward(from: &TcpStream, to: &TcpStream, mut most: u64, cuts: &Arc<AtomicUsize>) {
    let (mut from, mut to) = (from.try_clone().expect("a socket"), to.try_clone().expect("a socket"));
    let cuts = Arc::clone(cuts);
    thread::spawn(move || {
        let mut buffer = [0; 4096];
        while let Ok(read @ 1..) = from.read(&mut buffer) {
            let passed = (read as u64).min(most) as usize;
            most -= passed as u64;
            let is_over = passed < read;
            if is_over {
                cuts.fetch_add(1, Ordering::SeqCst);
            }
            if to.write_all(&buffer[..passed]).is_err() || is_over {
                let _ = from.shutdown(Shutdown::Both);
                break;
            }
        }
        let _ = to.shutdown(Shutdown::Both);
    });
}
