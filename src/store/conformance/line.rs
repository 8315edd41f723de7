//! A line of limited speed, as between a worker and a bucket.

use std::time::Duration;

use tokio::{
    sync::Mutex,
    time::{Instant, sleep, sleep_until},
};

/// Bytes that pass in one go. Requests take turns, as on a real line.
const PACKET: u64 = 64 << 10;

/// A line that all requests share.
#[derive(Debug)]
pub struct Line {
    bytes_per_second: f64,
    latency: Duration,
    /// When everything that was sent has arrived.
    free_at: Mutex<Instant>,
}

impl Line {
    /// A line with this speed and this time from a request to the first byte of its answer.
    pub fn new(bytes_per_second: f64, latency: Duration) -> Self {
        Self { bytes_per_second, latency, free_at: Mutex::new(Instant::now()) }
    }

    /// Waits as long as an answer of `bytes` takes.
    pub async fn pass(&self, bytes: u64) {
        sleep(self.latency).await;
        let mut left = bytes;
        while left > 0 {
            let packet = left.min(PACKET);
            let mut free_at = self.free_at.lock().await;
            *free_at = (*free_at).max(Instant::now()) + Duration::from_secs_f64(packet as f64 / self.bytes_per_second);
            let arrives = *free_at;
            drop(free_at);
            sleep_until(arrives).await;
            left -= packet;
        }
    }
}
