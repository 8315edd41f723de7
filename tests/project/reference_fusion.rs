//! Guided filtering fusion of real image pairs, against the figures of the published implementation.
//!
//! The images are not part of the project. They are read from `data` in the folder `PINSTACK_SHARED`, by default
//! `../shared`.

use std::path::{Path, PathBuf};

use pinstack_science::{
    fusion::{Fused, FusionRequest, Plan, fuse},
    imaging::Raster,
    quality::two_source,
    types::NoControl,
};

/// The folder with the real stacks.
fn shared_data() -> PathBuf {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    std::env::var_os("PINSTACK_SHARED").map_or(beside, PathBuf::from).join("data")
}

fn image(path: &Path) -> Raster {
    let rgb = ::image::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display())).into_rgb8();
    Raster::eight(rgb.width() as usize, rgb.height() as usize, 3, rgb.into_raw())
}

fn fuse_aligned(slices: &[Raster]) -> Fused {
    let plan = Plan::aligned(slices[0].width, slices[0].height, slices.len());
    fuse(&slices, &plan, &FusionRequest::default(), &std::env::temp_dir(), &NoControl).unwrap()
}

#[test]
#[ignore = "needs the pictures of PINSTACK_SHARED"]
fn the_ten_lytro_pairs_score_as_the_published_implementation() {
    let data = shared_data();
    // Q_G (Xydeas & Petrovic), Q_W (Piella & Heijmans), VIFF, spatial frequency: mean over the pairs
    let (reference, tolerance): ([f64; 4], [f64; 4]) =
        ([0.7498, 0.9284, 0.943, 19.38], [0.003, 0.003, 0.003, 0.005 * 19.38]);
    let mut means = [0.0; 4];
    for pair in 1..=10 {
        let slices = ["A", "B"].map(|side| image(&data.join(format!("lytro10/lytro-{pair}-{side}.jpg"))));
        let [a, b] = [slices[0].luma(), slices[1].luma()];
        let fused = fuse_aligned(&slices).image.luma();
        let metrics = [
            two_source::q_g(&a, &b, &fused),
            two_source::q_w(&a, &b, &fused),
            two_source::viff(&[&a, &b], &fused),
            two_source::spatial_frequency(&fused),
        ];
        for (mean, metric) in means.iter_mut().zip(metrics) {
            *mean += metric.expect("a metric of two images of one size") / 10.0;
        }
    }
    println!("Q_G, Q_W, VIFF, SF: {means:.4?}");
    for ((mean, reference), tolerance) in means.into_iter().zip(reference).zip(tolerance) {
        assert!((mean - reference).abs() <= tolerance, "{means:?} instead of {reference}");
    }
}
