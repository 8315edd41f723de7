//! Cost of the metrics: measuring a slice, scoring the blocks of a stack, comparing one pair of neighbours.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use pinstack_science::{
    imaging::{Coverage, Plane, Rect},
    quality::{
        alignment,
        sampling::Blocks,
        score::Scorer,
        slice::{Cells, Fingerprint, RowMeasurements, SliceMeter, WarpedSlice},
    },
};

const WIDTH: usize = 1600;
const HEIGHT: usize = 1250;

/// An image with fine and coarse texture that depends on the seed.
fn picture(width: usize, height: usize, seed: usize) -> Plane<f32> {
    Plane::from_fn(width, height, |x, y| {
        let fine = (x * 31 + y * 17 + x * y + seed * 101) % 97;
        let coarse = 40.0 * ((x as f32 + seed as f32) / 23.0).sin() * (y as f32 / 31.0).cos();
        80.0 + fine as f32 / 2.0 + coarse
    })
}

/// Time per pixel of the canvas, to compare with the time of fusion per pixel.
fn measure(c: &mut Criterion) {
    let luma = picture(WIDTH, HEIGHT, 1);
    let samples: Vec<u8> = luma.data.iter().flat_map(|&v| [v as u8, (v / 2.0) as u8, v as u8]).collect();
    let (meter, coverage) = (SliceMeter::new(WIDTH, HEIGHT, 20, 10, None), Coverage::full(WIDTH, HEIGHT));
    let cells = Cells::of(WIDTH, HEIGHT);
    let row = |y: usize, x: usize, width: usize| &samples[(y * WIDTH + x) * 3..][..width * 3];
    let read = |rect: Rect| {
        let rows = (rect.y..rect.y + rect.height).flat_map(|y| row(y, rect.x, rect.width));
        Ok(rows.copied().collect::<Vec<u8>>())
    };
    let slice = WarpedSlice { samples: &read, channels: 3, coverage: &coverage, gain: 1.02 };
    let saliency = vec![1.0; WIDTH];
    let mut group = c.benchmark_group("quality");
    group.throughput(Throughput::Elements((WIDTH * HEIGHT) as u64));
    group.bench_function("measure one slice", |b| {
        b.iter(|| {
            let fingerprint = Fingerprint::of(&samples, 3, WIDTH, HEIGHT);
            let mut rows = RowMeasurements::default();
            for y in 0..HEIGHT {
                rows.take_samples(cells, y, row(y, 0, WIDTH), 3, slice.gain);
                rows.take_saliency(&meter, y, &saliency, &(0..WIDTH));
            }
            let brightness = rows.brightness::<u8>(cells, &coverage, 3, slice.gain);
            meter.measure(3, black_box(&slice), rows, brightness, fingerprint)
        });
    });
    group.finish();
}

/// Time per pixel of the canvas: the time of one block, times the number of blocks of a canvas.
fn score(c: &mut Criterion) {
    let blocks = Blocks::of(WIDTH, HEIGHT, None).rects;
    let (width, height) = blocks.first().map_or((1, 1), |block| (block.width, block.height));
    let fused = picture(width, height, 0);
    let slices: Vec<_> = (0..8).map(|seed| picture(width, height, seed)).collect();
    let mut group = c.benchmark_group("quality");
    for count in [1, 8] {
        group.throughput(Throughput::Elements((WIDTH * HEIGHT * count / blocks.len()) as u64));
        group.bench_function(format!("score the blocks of {count} slices"), |b| {
            b.iter(|| {
                let mut scorer = Scorer::new(black_box(&fused), None);
                slices[..count].iter().for_each(|slice| scorer.slice(slice, None));
                scorer.sums()
            });
        });
    }
    group.finish();
}

fn align(c: &mut Criterion) {
    let slices = [picture(WIDTH, HEIGHT, 0), picture(WIDTH, HEIGHT, 0)];
    let read =
        |n: usize, window: Rect| Some((slices[n].crop(window), Plane::filled(window.width, window.height, 255u8)));
    c.bench_function("quality/residual shifts of one pair", |b| {
        b.iter(|| alignment::measure(2, &read, WIDTH, HEIGHT, None));
    });
}

criterion_group!(benches, measure, score, align);
criterion_main!(benches);
