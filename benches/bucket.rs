//! A stack in a bucket, fused in two ways: after its zip was copied, as the service does it, and by reading only what is
//! needed when it is needed. The line to the bucket is simulated, with 5 ms from a request to the first byte.
//!
//! ```text
//! cargo bench --features testing --bench bucket
//! ```

use std::{
    io::Cursor,
    sync::Arc,
    time::{Duration, Instant},
};

use pinstack::store::{
    self, Store,
    blobs::upload_key,
    conformance::{blobs::put_blob, line::Line, memory::MemoryBlobStore},
};
use pinstack_science::{
    archive::{ArchiveLimits, open_shared, pack},
    fusion::{self, FusionRequest, Plan, SlicePlan},
    imaging::codec::{Metadata, encode_jpeg, encode_png},
    synth::{Light, Rig, Scene, render},
    types::{NoControl, ReadAt, fusion_options::Method},
};
use rayon::prelude::*;
use uuid::Uuid;

/// Speeds, Mbit/s.
const SPEEDS: [f64; 2] = [100.0, 1_000.0];
/// From a request to the first byte of its answer.
const LATENCY: Duration = Duration::from_millis(5);
/// Runs of each way, of which the middle one counts.
const RUNS: usize = 3;
/// Size of a slice, px, and number of slices.
const STACK: (usize, usize, usize) = (2_400, 1_600, 20);

/// How a worker gets at the bytes.
#[derive(Debug, Clone, Copy)]
enum Way {
    CopyFirst,
    RangesOnly,
}

const WAYS: [Way; 2] = [Way::CopyFirst, Way::RangesOnly];

fn main() {
    let runtime = tokio::runtime::Runtime::new().expect("a runtime");
    let (width, height, slices) = STACK;
    let rig = Rig::sized(width, height, slices);
    let scene = Scene::insect(1);
    println!("{slices} slices of {width} x {height} px; seconds from the claim to the fused image\n");
    println!("| slices | zip, MB | line, Mbit/s | copied first | ranges only |");
    println!("|---|---:|---:|---:|---:|");
    let rendered: Vec<_> = (0..slices).into_par_iter().map(|i| render(&rig, &scene, Light::Front, i)).collect();
    for (name, is_jpeg) in [("JPEG, quality 95", true), ("PNG", false)] {
        let members = rendered.iter().enumerate().map(|(i, slice)| {
            let mut bytes = Vec::new();
            if is_jpeg {
                bytes = encode_jpeg(slice, 95);
            } else {
                encode_png(&mut bytes, slice, &Metadata::default()).expect("a slice");
            }
            (format!("front/{i:03}.{}", if is_jpeg { "jpg" } else { "png" }), bytes)
        });
        let mut zip = Cursor::new(Vec::new());
        pack(&mut zip, members).expect("a zip");
        let zip = zip.into_inner();
        for speed in SPEEDS {
            let seconds = WAYS.map(|way| {
                let mut runs: Vec<f64> = (0..RUNS).map(|_| runtime.block_on(run(&rig, &zip, speed, way))).collect();
                runs.sort_by(f64::total_cmp);
                runs[RUNS / 2]
            });
            let megabytes = zip.len() as f64 / 1e6;
            let [copied, ranges] = seconds;
            println!("| {name} | {megabytes:.0} | {speed:.0} | {copied:.2} | {ranges:.2} |");
        }
    }
}

/// Seconds until the stack is fused.
async fn run(rig: &Rig, zip: &[u8], megabits: f64, way: Way) -> f64 {
    let folder = tempfile::tempdir().expect("a folder");
    let local = store::open(folder.path()).await.expect("a store");
    let store = MemoryBlobStore::behind(Line::new(megabits * 1e6 / 8.0, LATENCY), local);
    let key = upload_key(Uuid::now_v7());
    put_blob(&store, &key, zip).await;
    let plan = Plan {
        slices: (0..rig.slices())
            .map(|i| SlicePlan { homography: rig.homography(i), gain: rig.gain(i), rail_mm: None })
            .collect(),
        reference: rig.reference,
        method: Method::HaloCorrected,
        ..Plan::aligned(STACK.0, STACK.1, STACK.2)
    };
    let started = Instant::now();
    let (zip, scratch) = (opened(&store, &key, way).await, folder.path().to_owned());
    let fuse = move || {
        let archive = open_shared(zip, &ArchiveLimits::default()).expect("a sound zip");
        fusion::fuse(archive.front(), &plan, &FusionRequest::default(), &scratch, &NoControl).expect("an image")
    };
    let fused = tokio::task::spawn_blocking(fuse).await.expect("no panic");
    assert_eq!(fused.image.width, STACK.0);
    started.elapsed().as_secs_f64()
}

async fn opened(store: &Store, key: &str, way: Way) -> Arc<dyn ReadAt> {
    match way {
        Way::CopyFirst => {
            let copy = store.blobs.fetch(key, &store.workspace).await.expect("it answers").expect("it is stored");
            Arc::new(copy.open().await.expect("a file"))
        }
        Way::RangesOnly => {
            let blob = store.blobs.open(key, &store.workspace).await.expect("it answers").expect("it is stored");
            blob.bytes()
        }
    }
}
