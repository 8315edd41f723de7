//! What a reader sees of a blob that is still arriving.

use std::{
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, Ordering},
    },
    thread,
};

use futures::FutureExt;
use tempfile::TempDir;
use tokio::sync::Semaphore;

use super::*;

/// A bucket that records what it is asked for, and answers when it may.
#[derive(Clone)]
struct Bucket {
    bytes: Arc<Vec<u8>>,
    asked: Arc<Mutex<Vec<Range<u64>>>>,
    /// One permit per answer.
    answers: Arc<Semaphore>,
    fails: Arc<AtomicBool>,
}

impl Bucket {
    fn of(length: usize) -> Self {
        let bytes = (0..length as u64).map(|at| (at.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        Self {
            bytes: Arc::new(bytes),
            asked: Arc::default(),
            answers: Arc::new(Semaphore::new(0)),
            fails: Arc::default(),
        }
    }

    /// A bucket that answers at once.
    fn quick(length: usize) -> Self {
        let bucket = Self::of(length);
        bucket.answers.add_permits(1_000_000);
        bucket
    }

    fn open(&self, access: Access) -> (ArrivingFile, TempDir) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = TempPath::try_from_path(folder.path().join("blob")).expect("a path");
        let bucket = self.clone();
        let source = move |range: Range<u64>| {
            let bucket = bucket.clone();
            async move {
                bucket.asked.lock().unwrap().push(range.clone());
                bucket.answers.acquire().await.expect("it is open").forget();
                if bucket.fails.load(Ordering::SeqCst) {
                    return Err(StoreError::Unavailable(anyhow!("the cable is cut")));
                }
                let part = bucket.bytes.get(range.start as usize..range.end as usize);
                Ok(part.map(Bytes::copy_from_slice))
            }
            .boxed()
        };
        let length = self.bytes.len() as u64;
        (ArrivingFile::begin(path, length, access, None, Box::new(source)).expect("a file"), folder)
    }

    fn asked(&self) -> Vec<Range<u64>> {
        self.asked.lock().unwrap().clone()
    }

    fn bytes_asked(&self) -> u64 {
        self.asked().iter().map(|range| range.end - range.start).sum()
    }
}

/// Reads on a thread that may block.
async fn read(file: &ArrivingFile, at: u64, length: usize) -> io::Result<Vec<u8>> {
    let bytes = file.bytes();
    let read = move || {
        let mut buffer = vec![0; length];
        bytes.read_exact_at(&mut buffer, at).map(|()| buffer)
    };
    tokio::task::spawn_blocking(read).await.expect("no panic")
}

#[tokio::test(flavor = "multi_thread")]
async fn of_parts_only_what_is_read_is_fetched_and_once() {
    let bucket = Bucket::quick(20_000_000);
    let (file, _folder) = bucket.open(Access::Parts);
    for _ in 0..2 {
        assert_eq!(read(&file, 10_000_000, 100).await.unwrap(), bucket.bytes[10_000_000..10_000_100]);
        assert_eq!(read(&file, 19_999_990, 10).await.unwrap(), bucket.bytes[19_999_990..]);
    }
    assert_eq!(bucket.asked().len(), 2, "{:?}", bucket.asked());
    assert!(bucket.bytes_asked() <= 2 * BLOCK);
    assert_eq!(file.bytes().length().unwrap(), 20_000_000);
    assert_eq!(file.bytes().read_at(&mut [0; 4], 20_000_000).unwrap(), 0, "the end");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_whole_blob_arrives_once_and_in_order() {
    let bucket = Bucket::quick(30_000_000);
    let (file, _folder) = bucket.open(Access::Whole);
    assert!(read(&file, 0, 30_000_000).await.unwrap() == *bucket.bytes);
    assert_eq!(bucket.bytes_asked(), 30_000_000);
    assert!(file.failure().is_none());
}

#[tokio::test(flavor = "multi_thread")]
async fn what_a_reader_waits_for_is_fetched_before_the_rest() {
    let bucket = Bucket::of(200_000_000);
    let (file, _folder) = bucket.open(Access::Whole);
    let end = tokio::spawn(async move { (read(&file, 199_999_000, 1_000).await, file) });
    // no answer comes: what was begun is all that is asked for, and the end
    let wanted = 199_999_000 / BLOCK * BLOCK..200_000_000;
    while !bucket.asked().contains(&wanted) {
        tokio::task::yield_now().await;
    }
    assert!(bucket.asked().len() <= RUNS_AT_ONCE + 1, "{:?}", bucket.asked());
    bucket.answers.add_permits(RUNS_AT_ONCE + 1);
    let (read, file) = end.await.unwrap();
    assert!(read.unwrap() == bucket.bytes[199_999_000..]);
    drop(file);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_failure_reaches_the_reader_and_says_why() {
    let bucket = Bucket::of(9_000_000);
    bucket.fails.store(true, Ordering::SeqCst);
    bucket.answers.add_permits(100);
    for access in [Access::Whole, Access::Parts] {
        let (file, _folder) = bucket.open(access);
        assert!(read(&file, 5_000_000, 10).await.is_err());
        assert!(matches!(file.failure(), Some(StoreError::Unavailable(_))));
        assert!(file.failure().is_none(), "it is told once");
        assert!(read(&file, 0, 10).await.is_err(), "nothing more arrives");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_reader_does_not_wait_for_a_blob_that_was_dropped() {
    let bucket = Bucket::of(9_000_000);
    let (file, folder) = bucket.open(Access::Parts);
    let bytes = file.bytes();
    let reader = thread::spawn(move || bytes.read_at(&mut [0; 4], 100));
    while bucket.asked().is_empty() {
        tokio::task::yield_now().await;
    }
    drop(file);
    let error = tokio::task::spawn_blocking(|| reader.join()).await.unwrap().unwrap().unwrap_err();
    assert_eq!(error.kind(), io::ErrorKind::NotConnected);
    while folder.path().join("blob").exists() {
        tokio::task::yield_now().await;
    }
}

/// Numbers below `most` that look random and are the same in each run.
fn numbers(seed: u64) -> impl FnMut(usize) -> usize {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    move |most| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % most
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn any_reads_give_the_bytes_of_the_blob() {
    for seed in 0..24 {
        let mut below = numbers(seed);
        let length = 1 + below(6_000_000);
        let bucket = Bucket::quick(length);
        let (file, _folder) = bucket.open(if seed % 2 == 0 { Access::Whole } else { Access::Parts });
        for _ in 0..8 {
            let at = below(length);
            let end = length.min(at + 1 + below(2_000_000));
            let got = read(&file, at as u64, end - at).await.unwrap();
            assert!(got == bucket.bytes[at..end], "{at}..{end} of {length}, seed {seed}");
        }
        assert!(bucket.bytes_asked() <= length as u64, "nothing is fetched twice, seed {seed}");
    }
}
