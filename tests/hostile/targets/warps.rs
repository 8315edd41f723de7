//! Resampling: vector code reads addresses that depend on homographies and sizes from clients.

use pinstack_science::{
    imaging::{Sample, warp::Warp},
    types::Homography,
};

/// Longest side of slices and canvases, px.
const MOST_SIDE: usize = 96;

/// Size of the head, bytes: nine numbers, a gain, four sides, and flags for the type of the numbers and samples.
const HEAD: usize = 10 * 8 + 4 + 1;

/// Bits of the last byte of the head.
const SIXTEEN_BITS: u8 = 1;
const COLOUR: u8 = 2;
/// The numbers are small changes of the identity instead of float bits.
const NEAR_IDENTITY: u8 = 4;

/// A warp from bytes. For any homography, vector code gives the same bits as portable code, and uncovered pixels are 0.
pub fn warp(bytes: &[u8]) {
    let Some((head, samples)) = bytes.split_at_checked(HEAD) else { return };
    let (numbers, rest) = head.split_at(80);
    let flags = rest[4];
    let numbers: Vec<f64> = numbers.as_chunks::<8>().0.iter().map(|bytes| number(*bytes, flags)).collect();
    let mut homography = Homography::IDENTITY.0;
    for (at, (element, number)) in homography.iter_mut().zip(&numbers).enumerate() {
        *element = match flags & NEAR_IDENTITY {
            0 => *number,
            _ => *element + number * SPREAD[at],
        };
    }
    let gain = if flags & NEAR_IDENTITY == 0 { numbers[9] } else { 1.0 + numbers[9].abs() };
    let side = |byte: u8| 1 + usize::from(byte) % MOST_SIDE;
    let (slice, canvas) = ((side(rest[0]), side(rest[1])), (side(rest[2]), side(rest[3])));
    let Some(warp) = Warp::new(&Homography(homography), gain, slice, canvas) else { return };
    let channels = if flags & COLOUR == 0 { 1 } else { 3 };
    match flags & SIXTEEN_BITS {
        0 => compare::<u8>(&warp, samples, slice, channels),
        _ => compare::<u16>(&warp, samples, slice, channels),
    }
}

/// Maximum change of the elements of a homography in the mode near the identity.
const SPREAD: [f64; 9] = [1.0, 1.0, 64.0, 1.0, 1.0, 64.0, 0.02, 0.02, 0.0];

fn number(bytes: [u8; 8], flags: u8) -> f64 {
    match flags & NEAR_IDENTITY {
        0 => f64::from_le_bytes(bytes),
        _ => f64::from(i32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])) / f64::from(i32::MAX),
    }
}

fn compare<S: Sample>(warp: &Warp, given: &[u8], (width, height): (usize, usize), channels: usize) {
    let mut samples = vec![S::default(); width * height * channels];
    for (at, sample) in samples.iter_mut().enumerate() {
        let given = given.get(at % given.len().max(1)).copied().unwrap_or(0);
        // full scale and zero side by side: the kernel overshoots most there
        let value = (at * 40_503 + usize::from(given) * 257) % 65_536;
        *sample = S::rounded(value as f32 * S::DEPTH.max() / 65_535.0);
    }
    let best = warp.apply(samples.clone(), channels);
    let portable = warp.clone().portable().apply(samples, channels);
    assert!(best == portable, "vector and portable code differ");
    let covered = warp.coverage();
    for (y, row) in best.chunks(covered.width() * channels).enumerate() {
        let span = covered.span(y);
        let outside = row[..span.start * channels].iter().chain(&row[span.end * channels..]);
        assert!(outside.into_iter().all(|sample| *sample == S::default()), "a pixel that is not covered has a value");
    }
}

/// Typical warps of calibrations, and some that no camera produces.
pub fn seeds() -> Vec<(String, Vec<u8>)> {
    let exact = |homography: [f64; 9], gain: f64, sides: [u8; 4], flags: u8| {
        let mut bytes: Vec<u8> = homography.iter().chain([&gain]).flat_map(|v| v.to_le_bytes()).collect();
        bytes.extend(sides);
        bytes.push(flags);
        bytes.extend((0..64u8).map(|i| i.wrapping_mul(151)));
        bytes
    };
    let keystone = [1.03, 0.012, -2.3, -0.009, 1.021, 1.7, 6e-5, -4e-5, 1.0];
    let horizon = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, -0.02, 0.01, 1.0];
    let mut seeds = Vec::new();
    for flags in 0..4 {
        let with = |name: &str, bytes: Vec<u8>| (format!("{name}-{flags}"), bytes);
        seeds.push(with("keystone", exact(keystone, 1.0, [63, 47, 63, 47], flags)));
        seeds.push(with("shift", exact([1.0, 0.0, 0.5, 0.0, 1.0, -0.25, 0.0, 0.0, 1.0], 0.7, [4, 4, 4, 4], flags)));
        seeds.push(with("shrink", exact([0.6, 0.0, 3.3, 0.0, 0.6, 1.1, 0.0, 0.0, 1.0], 4.0, [95, 20, 90, 30], flags)));
        seeds.push(with("grow", exact([40.0, 0.0, -9.0, 0.0, 40.0, -9.0, 0.0, 0.0, 1.0], 1.3, [3, 3, 95, 95], flags)));
        seeds.push(with("horizon", exact(horizon, 1.0, [80, 80, 80, 80], flags)));
        seeds.push(with("tiny", exact(keystone, 20.0, [0, 0, 95, 95], flags)));
        seeds.push(with("near", {
            let mut bytes = exact([0.0; 9], 0.1, [70, 50, 70, 50], flags | NEAR_IDENTITY);
            bytes[..40].copy_from_slice(&[7; 40]);
            bytes
        }));
    }
    seeds
}
