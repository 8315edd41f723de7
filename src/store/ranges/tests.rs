//! What a reader of ranges sees, and what it asks the bucket for.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use futures::FutureExt;
use tempfile::TempDir;

use super::*;

/// A bucket that records what it is asked for.
#[derive(Clone)]
struct Bucket {
    bytes: Arc<Vec<u8>>,
    asked: Arc<Mutex<Vec<Range<u64>>>>,
    fails: Arc<AtomicBool>,
}

impl Bucket {
    fn of(length: usize) -> Self {
        let bytes = (0..length as u64).map(|at| (at.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        Self { bytes: Arc::new(bytes), asked: Arc::default(), fails: Arc::default() }
    }

    fn open(&self) -> (Arc<Ranges>, TempDir) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = TempPath::try_from_path(folder.path().join("blob")).expect("a path");
        let bucket = self.clone();
        let source = move |range: Range<u64>| {
            let bucket = bucket.clone();
            async move {
                bucket.asked.lock().unwrap().push(range.clone());
                if bucket.fails.load(Ordering::SeqCst) {
                    return Err(StoreError::Unavailable(anyhow!("the cable is cut")));
                }
                let part = bucket.bytes.get(range.start as usize..range.end as usize);
                Ok(part.map(Bytes::copy_from_slice))
            }
            .boxed()
        };
        (Arc::new(Ranges::of(path, self.bytes.len() as u64, Box::new(source)).expect("a file")), folder)
    }

    fn asked(&self) -> Vec<Range<u64>> {
        self.asked.lock().unwrap().clone()
    }
}

/// Reads on a thread that may block.
async fn read(ranges: &Arc<Ranges>, at: usize, length: usize) -> io::Result<Vec<u8>> {
    let ranges = Arc::clone(ranges);
    let read = move || {
        let mut buffer = vec![0; length];
        ranges.read_exact_at(&mut buffer, at as u64).map(|()| buffer)
    };
    tokio::task::spawn_blocking(read).await.expect("no panic")
}

#[tokio::test(flavor = "multi_thread")]
async fn only_what_is_read_is_fetched_and_once() {
    let bucket = Bucket::of(20_000_000);
    let (ranges, folder) = bucket.open();
    for _ in 0..2 {
        assert_eq!(read(&ranges, 10_000_000, 100).await.unwrap(), bucket.bytes[10_000_000..10_000_100]);
        assert_eq!(read(&ranges, 19_999_990, 10).await.unwrap(), bucket.bytes[19_999_990..]);
    }
    assert_eq!(bucket.asked(), [9_961_472..10_485_760, 19_922_944..20_000_000]);
    assert_eq!(ranges.length().unwrap(), 20_000_000);
    assert_eq!(ranges.read_at(&mut [0; 4], 20_000_000).unwrap(), 0, "the end");
    drop(ranges);
    assert!(!folder.path().join("blob").exists());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_failure_reaches_the_reader_and_says_why() {
    let bucket = Bucket::of(9_000_000);
    bucket.fails.store(true, Ordering::SeqCst);
    let (ranges, _folder) = bucket.open();
    assert!(read(&ranges, 5_000_000, 10).await.is_err());
    assert!(matches!(ranges.failure(), Some(StoreError::Unavailable(_))));
    assert!(ranges.failure().is_none(), "it is told once");
    bucket.fails.store(false, Ordering::SeqCst);
    assert!(read(&ranges, 0, 10).await.is_err(), "nothing more is fetched");
    assert_eq!(bucket.asked().len(), 1);
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
        let bucket = Bucket::of(length);
        let (ranges, _folder) = bucket.open();
        for _ in 0..8 {
            let at = below(length);
            let end = length.min(at + 1 + below(2_000_000));
            let got = read(&ranges, at, end - at).await.unwrap();
            assert!(got == bucket.bytes[at..end], "{at}..{end} of {length}, seed {seed}");
        }
    }
}
