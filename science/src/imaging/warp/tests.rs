//! Warping against its definition, and each way to do it against the others.

use super::*;

/// A smooth picture given by a formula, so that the truth between pixels is known.
fn picture(x: f64, y: f64) -> f64 {
    128.0 + 50.0 * (0.31 * x + 0.17 * y).sin() + 45.0 * (0.11 * x - 0.27 * y + 1.0).cos()
}

fn sampled(width: usize, height: usize) -> Vec<u16> {
    (0..width * height).map(|i| (picture((i % width) as f64, (i / width) as f64) * 257.0).round() as u16).collect()
}

fn keystone() -> Homography {
    Homography([1.03, 0.012, -2.3, -0.009, 1.021, 1.7, 6e-5, -4e-5, 1.0])
}

/// Root mean square error against the formula, in grey levels of 255, a margin from the border.
fn error_of(value: impl Fn(f64, f64) -> f64, to_slice: &Homography, size: usize) -> (f64, f64) {
    let (mut squares, mut sum, mut count) = (0.0, 0.0, 0.0);
    for y in 12..size - 12 {
        for x in 12..size - 12 {
            let [u, v] = to_slice.apply([x as f64, y as f64]);
            if u < 4.0 || v < 4.0 || u > size as f64 - 5.0 || v > size as f64 - 5.0 {
                continue;
            }
            let difference = value(x as f64, y as f64) - picture(u, v);
            squares += difference * difference;
            sum += difference;
            count += 1.0;
        }
    }
    (f64::sqrt(squares / count), sum / count)
}

#[test]
fn a_warped_picture_is_close_to_its_formula_and_far_closer_than_bilinear() {
    let size = 160;
    let samples = sampled(size, size);
    let warp = Warp::new(&keystone(), 1.0, (size, size), (size, size)).unwrap();
    let to_slice = keystone().inverse().unwrap();
    let warped = warp.apply(samples.clone(), 1);
    let (cubic, bias) = error_of(|x, y| f64::from(warped[y as usize * size + x as usize]) / 257.0, &to_slice, size);
    let bilinear = |x: f64, y: f64| {
        let [u, v] = to_slice.apply([x, y]);
        let (i, j, s, t) = (u as usize, v as usize, u.fract(), v.fract());
        let at = |i: usize, j: usize| f64::from(samples[j * size + i]) / 257.0;
        (1.0 - t) * ((1.0 - s) * at(i, j) + s * at(i + 1, j)) + t * ((1.0 - s) * at(i, j + 1) + s * at(i + 1, j + 1))
    };
    let (linear, _) = error_of(bilinear, &to_slice, size);
    assert!(cubic < 0.06, "rms {cubic}");
    assert!(bias.abs() < 0.01, "mean {bias}");
    assert!(cubic * 5.0 < linear, "cubic {cubic}, bilinear {linear}");
}

#[test]
fn a_shift_by_part_of_a_pixel_moves_the_picture_by_just_that() {
    let size = 128;
    for shift in [0.25, 0.5, -0.37] {
        let to_canvas = Homography::similarity(1.0, [shift, -shift]);
        let warp = Warp::new(&to_canvas, 1.0, (size, size), (size, size)).unwrap();
        let warped = warp.apply(sampled(size, size), 1);
        // Least squares for the remaining shift: difference = -dx * gradient along x.
        let (mut top, mut bottom) = (0.0, 0.0);
        for y in 8..size - 8 {
            for x in 8..size - 8 {
                let (u, v) = (x as f64 - shift, y as f64 + shift);
                let slope = (picture(u + 0.01, v) - picture(u - 0.01, v)) / 0.02;
                top += (f64::from(warped[y * size + x]) / 257.0 - picture(u, v)) * slope;
                bottom += slope * slope;
            }
        }
        assert!((top / bottom).abs() < 0.002, "shift {shift} leaves {} px", top / bottom);
    }
}

#[test]
fn the_identity_with_gain_one_copies_every_bit() {
    let samples: Vec<u8> = (0..30 * 20 * 3u32).map(|i| (i * 151 % 256) as u8).collect();
    let warp = Warp::new(&Homography::IDENTITY, 1.0, (30, 20), (30, 20)).unwrap();
    assert_eq!(warp.apply(samples.clone(), 3), samples);
    assert_eq!(*warp.coverage(), Coverage::full(30, 20));
}

#[test]
fn whole_pixel_shifts_copy_samples_and_leave_zero_where_nothing_is_covered() {
    let samples: Vec<u8> = (0..30 * 20 * 3u32).map(|i| (1 + i * 151 % 255) as u8).collect();
    let to_canvas = Homography::similarity(1.0, [4.0, -3.0]);
    let warp = Warp::new(&to_canvas, 1.0, (30, 20), (30, 20)).unwrap();
    let warped = warp.apply(samples.clone(), 3);
    for y in 0..20 {
        for x in 0..30 {
            let pixel = &warped[(y * 30 + x) * 3..][..3];
            if x >= 4 && y + 3 < 20 {
                assert_eq!(pixel, &samples[((y + 3) * 30 + x - 4) * 3..][..3]);
            } else {
                assert_eq!(pixel, [0; 3]);
            }
        }
    }
}

#[test]
fn the_gain_is_applied_once_rounded_once_and_clamped() {
    let warp = Warp::new(&Homography::IDENTITY, 1.3, (4, 1), (4, 1)).unwrap();
    assert_eq!(warp.apply(vec![0u8, 10, 101, 250], 1), [0, 13, 131, 255]);
}

#[test]
fn a_constant_slice_stays_constant_under_any_homography() {
    let warp = Warp::new(&keystone(), 1.0, (64, 48), (64, 48)).unwrap();
    let warped = warp.apply(vec![255u8; 64 * 48 * 3], 3);
    for y in 0..48 {
        let span = warp.coverage().span(y);
        assert!(warped[(y * 64 + span.start) * 3..(y * 64 + span.end) * 3].iter().all(|&v| v == 255));
    }
}

#[test]
fn vector_instructions_give_the_same_bits() {
    for ((width, height), gain) in [((5, 5), 1.0), ((37, 29), 0.7), ((130, 20), 1.9), ((131, 21), 4.0)] {
        let speckle: Vec<u16> = (0..width * height * 3).map(|i| (i * i * 97 + i * 40_503) as u16).collect();
        let eight: Vec<u8> = speckle.iter().map(|&v| v as u8).collect();
        let shrunk = Homography::similarity(0.6, [3.3, 1.1]);
        for to_canvas in [keystone(), shrunk, Homography::similarity(1.0, [0.5, -0.25])] {
            let best = Warp::new(&to_canvas, gain, (width, height), (width, height)).unwrap();
            let portable = best.clone().portable();
            assert_eq!(best.apply(speckle.clone(), 3), portable.apply(speckle.clone(), 3));
            assert_eq!(best.apply(eight.clone(), 3), portable.apply(eight.clone(), 3));
            let grey = || eight[..width * height].to_vec();
            assert_eq!(best.apply(grey(), 1), portable.apply(grey(), 1));
        }
    }
}

#[test]
fn eight_bits_are_weighted_as_well_as_floats_are() {
    let size = 160;
    let sixteen: Vec<u16> = sampled(size, size).iter().map(|&v| v / 257 * 257).collect();
    let eight: Vec<u8> = sixteen.iter().map(|&v| (v / 257) as u8).collect();
    for gain in [0.8, 1.0, 1.3] {
        let warp = Warp::new(&keystone(), gain, (size, size), (size, size)).unwrap();
        let (exact, fixed) = (warp.apply(sixteen.clone(), 1), warp.apply(eight.clone(), 1));
        for (exact, fixed) in exact.iter().zip(fixed) {
            let error = f64::from(fixed) - f64::from(*exact) / 257.0;
            assert!(error.abs() < 0.5 + 0.04, "{fixed} for {}", f64::from(*exact) / 257.0);
        }
    }
    // too large for 16 bits: floats
    let warp = Warp::new(&Homography::IDENTITY, 20.0, (4, 1), (4, 1)).unwrap();
    assert_eq!(warp.apply(vec![0u8, 1, 2, 200], 1), [0, 20, 40, 255]);
}

#[test]
fn a_gain_that_is_none_gives_no_warp() {
    for gain in [0.0, -1.0, -8.5e4, f64::NAN, f64::INFINITY, 1e-300, 1e300] {
        assert!(Warp::new(&keystone(), gain, (8, 8), (8, 8)).is_none(), "{gain}");
    }
}

#[test]
fn a_singular_homography_gives_no_warp() {
    let flat = Homography([1.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    assert!(Warp::new(&flat, 1.0, (8, 8), (8, 8)).is_none());
}
