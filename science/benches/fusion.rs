//! Time per pixel of the kernels of guided filtering fusion, and of fusing a small stack, with and without metrics.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use pinstack_science::{
    fusion::{FusionRequest, Plan, fuse},
    imaging::{
        Plane, Raster, Rect,
        filter::{
            guided::{Guide, GuidedFilter},
            mean::MeanFilter,
            saliency::Saliency,
        },
        grey,
        warp::Warp,
    },
    types::{Homography, NoControl},
};

const WIDTH: usize = 1024;
const HEIGHT: usize = 768;

/// Slice `number` of `slices`: texture that is strong in one vertical strip and weak elsewhere.
fn slice(number: usize, slices: usize) -> Raster {
    let mut samples = Vec::with_capacity(WIDTH * HEIGHT * 3);
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let noise = (x.wrapping_mul(7919) ^ y.wrapping_mul(104_729)).wrapping_mul(31) % 97;
            let sharp = (x * slices / WIDTH).abs_diff(number) == 0;
            let value = 80 + if sharp { noise } else { noise / 8 } + (x + y) / 40;
            samples.extend([value as u8, (value + 5) as u8, (value / 2) as u8]);
        }
    }
    Raster::eight(WIDTH, HEIGHT, 3, samples)
}

fn kernels(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("kernels");
    group.throughput(Throughput::Elements((WIDTH * HEIGHT) as u64)).sample_size(10);
    let raster = slice(1, 4);
    let pixels = match &raster.samples {
        pinstack_science::imaging::Samples::Eight(samples) => samples.clone(),
        pinstack_science::imaging::Samples::Sixteen(_) => Vec::new(),
    };
    let luma = raster.luma();

    let keystone = Homography([1.01, 0.002, -3.0, -0.001, 1.012, 2.0, 1e-6, -1e-6, 1.0]);
    if let Some(warp) = Warp::new(&keystone, 1.02, (WIDTH, HEIGHT), (WIDTH, HEIGHT)) {
        group.bench_function("warp rgb8 cubic", |bench| bench.iter(|| warp.apply(pixels.clone(), 3)));
    }
    let (saliency, mut buffers) = (Saliency::new(5, 5.0), Default::default());
    group.bench_function("saliency", |bench| {
        bench.iter(|| {
            let mut sum = 0.0;
            let rows = |y: usize, out: &mut [f32]| out.copy_from_slice(luma.row(y));
            saliency.rows((WIDTH, HEIGHT), 0..HEIGHT, &mut buffers, rows, |_, _, values| sum += values[0]);
            sum
        });
    });

    let mut guide = Plane::filled(WIDTH, HEIGHT, 0u16);
    grey::guide_row(&pixels, 3, &mut guide.data);
    let map = Plane::from_fn(WIDTH, HEIGHT, |x, y| (x / 50 + y / 70) % 3 == 0);
    let valid = vec![0..WIDTH; HEIGHT];
    let mut weights = vec![0.0; WIDTH * HEIGHT];
    for (radius, eps) in [(45, 0.3), (7, 1e-6)] {
        let mut filter = GuidedFilter::new(radius, eps);
        group.bench_function(format!("guided filter r={radius}"), |bench| {
            let guide = Guide { grey: &guide, valid: &valid };
            bench.iter(|| filter.apply(guide, &map, Rect::whole(WIDTH, HEIGHT), &mut weights));
        });
    }
    let mut mean = MeanFilter::new(31);
    let mut means = vec![0.0; WIDTH * HEIGHT * 3];
    group.bench_function("mean 31x31 rgb8", |bench| {
        bench.iter(|| mean.apply::<u8, 3>(&pixels, WIDTH, &valid, Rect::whole(WIDTH, HEIGHT), &mut means));
    });
    group.finish();
}

fn whole_stack(criterion: &mut Criterion) {
    let slices: Vec<Raster> = (0..6).map(|number| slice(number, 6)).collect();
    let mut plan = Plan::aligned(WIDTH, HEIGHT, slices.len());
    for (number, slice) in plan.slices.iter_mut().enumerate() {
        let away = number as f64 - 3.0;
        slice.homography = Homography::similarity(1.0 + 0.004 * away, [1.5 * away, -0.7 * away]);
    }
    let mut group = criterion.benchmark_group("stack");
    group.throughput(Throughput::Elements((WIDTH * HEIGHT * slices.len()) as u64)).sample_size(10);
    for metrics in [false, true] {
        let request = FusionRequest { metrics, object: None, shown: None, decision: false };
        group.bench_function(format!("6 slices, metrics {metrics}"), |bench| {
            bench.iter(|| fuse(&&slices[..], &plan, &request, &std::env::temp_dir(), &NoControl));
        });
    }
    group.finish();
}

criterion_group!(benches, kernels, whole_stack);
criterion_main!(benches);
