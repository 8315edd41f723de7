//! A whole stack, from the zip on disk to the fused pixels, beside what decoding its slices costs alone:
//! `cargo bench --bench stack`. The ratio of the two is the figure to watch; both run in the same process.

use std::{fs::File, io::BufWriter, path::Path};

use criterion::{Criterion, criterion_group, criterion_main};
use pinstack::{
    archive::{ArchiveLimits, StackArchive, open, pack},
    fusion::{Plan, Watch, fuse},
    imaging::{Slices, codec},
    model::{Unwatched, options::GuidedParams},
    synth::{Light, Rig, Scene, Stage},
};
use rayon::prelude::*;

const SLICES: usize = 10;

fn archive(rig: &Rig, folder: &Path) -> StackArchive {
    let stage = Stage::new(rig, &Scene::insect(1));
    let members = (0..rig.slices()).map(|i| {
        let jpeg = codec::encode_jpeg(&stage.render(Light::Front, i), 95);
        (format!("front/{i:02}.jpg"), jpeg)
    });
    let path = folder.join("stack.zip");
    pack(BufWriter::new(File::create(&path).expect("a file")), members).expect("a zip");
    open(&path, &ArchiveLimits::default()).expect("our own zip can be read")
}

fn whole_stack(criterion: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a folder");
    let rig = Rig::sized(1800, 1200, SLICES);
    let archive = archive(&rig, folder.path());
    let plan = Plan {
        width: rig.width,
        height: rig.height,
        homographies: (0..SLICES).map(|i| rig.homography(i)).collect(),
        gains: (0..SLICES).map(|i| rig.gain(i)).collect(),
        reference: rig.reference,
        params: GuidedParams::default(),
    };
    let mut group = criterion.benchmark_group(format!("stack of {SLICES} slices, 2.2 MP, JPEG"));
    group.sample_size(10);
    group.bench_function("decode only", |b| {
        b.iter(|| (0..SLICES).into_par_iter().map(|i| archive.front().load(i).expect("a slice").width).sum::<usize>());
    });
    for (name, metrics) in [("fuse", false), ("fuse and measure", true)] {
        let watch = Watch { metrics, object: None };
        group.bench_function(name, |b| {
            b.iter(|| fuse(archive.front(), &plan, &watch, folder.path(), &Unwatched).expect("it can be fused"));
        });
    }
    group.finish();
}

criterion_group!(benches, whole_stack);
criterion_main!(benches);
