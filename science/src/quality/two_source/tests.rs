use std::path::{Path, PathBuf};

use super::*;
use crate::imaging::Raster;

/// Mean of each metric over the ten pairs, each fused by `fuse`.
pub(crate) fn over_lytro(mut fuse: impl FnMut(usize, &Raster, &Raster) -> Raster) -> [f64; 7] {
    let shared = std::env::var_os("PINSTACK_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared"), PathBuf::from);
    let folder = shared.join("data/lytro10");
    let read = |name: String| {
        let picture = image::open(folder.join(name)).expect("a picture of PINSTACK_SHARED").into_rgb8();
        Raster::eight(picture.width() as usize, picture.height() as usize, 3, picture.into_raw())
    };
    let mut sums = [0.0; 7];
    for pair in 1..=10 {
        let (a, b) = (read(format!("lytro-{pair}-A.jpg")), read(format!("lytro-{pair}-B.jpg")));
        let fused = fuse(pair, &a, &b).luma().map(f32::round);
        let (a, b) = (a.luma().map(f32::round), b.luma().map(f32::round));
        let values = [
            q_g(&a, &b, &fused),
            q_w(&a, &b, &fused),
            viff(&[&a, &b], &fused),
            spatial_frequency(&fused),
            q_e(&a, &b, &fused),
            average_gradient(&fused),
            laplacian_variance(&fused),
        ];
        sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value.unwrap() / 10.0);
    }
    sums
}

fn average(a: &Raster, b: &Raster) -> Raster {
    let (crate::imaging::Samples::Eight(one), crate::imaging::Samples::Eight(two)) = (&a.samples, &b.samples) else {
        panic!("8 bits expected");
    };
    let mean = |(&a, &b): (&u8, &u8)| u16::midpoint(u16::from(a), u16::from(b)) as u8;
    Raster::eight(a.width, a.height, 3, one.iter().zip(two).map(mean).collect())
}

// the fusion by the reference program is scored in `fusion`; the plain average needs no fusion
#[test]
#[ignore = "needs the pictures of PINSTACK_SHARED"]
fn the_plain_average_of_the_lytro_pairs_keeps_its_scores() {
    let found = over_lytro(|_, a, b| average(a, b));
    let expected = [0.5961, 0.8922, 0.7797, 11.924, 0.6805, 5.335, 204.66];
    for (found, expected) in found.into_iter().zip(expected) {
        assert!((found / expected - 1.0).abs() < 1e-3, "{found} instead of {expected}");
    }
}

fn pattern() -> Plane<f32> {
    Plane::from_fn(96, 80, |x, y| (128 + (x * x * 3 + y * 29 + x * y) % 101 - 50) as f32)
}

#[test]
fn a_perfect_fusion_of_equal_sources_scores_the_upper_bounds() {
    let p = pattern();
    assert!((q_g(&p, &p, &p).unwrap() - xydeas::UPPER_BOUND).abs() < 2e-4);
    assert!((q_w(&p, &p, &p).unwrap() - 1.0).abs() < 1e-9);
    assert!((q_e(&p, &p, &p).unwrap() - 1.0).abs() < 1e-9);
    assert!((viff(&[&p, &p], &p).unwrap() - 1.0).abs() < 1e-6);
}

#[test]
fn pictures_of_different_size_or_too_small_or_flat_have_no_score() {
    let (p, small, flat) = (pattern(), Plane::filled(6, 6, 1.0f32), Plane::filled(96, 80, 7.0f32));
    assert_eq!((q_g(&p, &small, &p), q_w(&small, &p, &p), viff(&[&small], &p)), (None, None, None));
    assert_eq!((q_w(&small, &small, &small), viff(&[&small], &small), viff(&[], &p)), (None, None, None));
    assert_eq!(q_w(&flat, &flat, &flat), None);
    assert_eq!(laplacian_variance(&Plane::filled(2, 2, 1.0f32)), None);
}

#[test]
fn the_numbers_of_one_picture_follow_their_definitions() {
    let ramp = Plane::from_fn(11, 8, |x, y| (3 * x + 4 * y) as f32);
    let (right, below) = (9.0 * 80.0, 16.0 * 77.0);
    assert!((spatial_frequency(&ramp).unwrap() - f64::sqrt((right + below) / 88.0)).abs() < 1e-9);
    assert!((average_gradient(&ramp).unwrap() - f64::sqrt(12.5)).abs() < 1e-9);
    assert_eq!(laplacian_variance(&ramp), Some(0.0));
}
