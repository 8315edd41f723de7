//! Time of a whole calibration: five slices of 1.4 MP in memory, from pixels to homographies.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use pinstack_science::calibration::calibrate;
use pinstack_science::synth::{DotTarget, Rig, target_stack};
use pinstack_science::types::NoControl;
use pinstack_science::types::calibration_options::CalibrationOptions;

fn whole(c: &mut Criterion) {
    let rig = Rig { channels: 1, ..Rig::sized(1440, 960, 5) };
    let pictures = target_stack(&rig, &DotTarget::for_rig(&rig, 30));
    let slices = &pictures[..];
    let options = CalibrationOptions::default();
    let mut group = c.benchmark_group("calibration");
    group.sample_size(10);
    group.throughput(Throughput::Elements((rig.width * rig.height * rig.slices()) as u64));
    group.bench_function("five slices of 1.4 MP", |b| {
        b.iter(|| calibrate(black_box(&slices), &options, &NoControl).expect("a calibration"));
    });
    group.finish();
}

criterion_group!(benches, whole);
criterion_main!(benches);
