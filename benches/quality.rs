//! What the metrics cost: a slice observed, a tile scored, one pair of neighbours compared.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use pinstack::{
    imaging::{Plane, Rect},
    quality::{alignment, slice::Observer, tile::Scorer},
};

const SIDE: usize = 512;

/// Fine and coarse texture, different for every seed.
fn picture(side: usize, seed: usize) -> Plane<f32> {
    Plane::from_fn(side, side, |x, y| {
        let fine = (x * 31 + y * 17 + x * y + seed * 101) % 97;
        let coarse = 40.0 * ((x as f32 + seed as f32) / 23.0).sin() * (y as f32 / 31.0).cos();
        80.0 + fine as f32 / 2.0 + coarse
    })
}

fn observe(c: &mut Criterion) {
    let (luma, valid) = (picture(SIDE, 1), Plane::filled(SIDE, SIDE, 255u8));
    let observer = Observer::new(SIDE, SIDE, 20, 10);
    let mut group = c.benchmark_group("quality");
    group.throughput(Throughput::Elements((SIDE * SIDE) as u64));
    group.bench_function("observe one slice", |b| {
        b.iter(|| observer.slice(3, black_box(&luma), &valid, &luma, 1.02));
    });
    group.finish();
}

fn score(c: &mut Criterion) {
    let (fused, valid) = (picture(SIDE, 0), Plane::filled(SIDE, SIDE, 255u8));
    let slices: Vec<_> = (0..4).map(|seed| picture(SIDE, seed)).collect();
    let mut group = c.benchmark_group("quality");
    for count in [1, 4] {
        group.throughput(Throughput::Elements((SIDE * SIDE * count) as u64));
        group.bench_function(format!("score a tile of {count} slices"), |b| {
            b.iter(|| {
                let mut scorer = Scorer::new(black_box(&fused), None);
                slices[..count].iter().for_each(|slice| scorer.slice(slice, &valid));
                scorer.sums()
            });
        });
    }
    group.finish();
}

fn align(c: &mut Criterion) {
    let slices = [picture(SIDE, 0), picture(SIDE, 0)];
    let read = |n: usize, window: Rect| {
        let luma = Plane::from_fn(window.width, window.height, |x, y| slices[n].at(window.x + x, window.y + y));
        Some((luma, Plane::filled(window.width, window.height, 255u8)))
    };
    c.bench_function("quality/residual shifts of one pair", |b| {
        b.iter(|| alignment::measure(2, &read, SIDE, SIDE, None));
    });
}

criterion_group!(benches, observe, score, align);
criterion_main!(benches);
