//! Blending on small pictures.

use super::*;

const SIDE: usize = 80;

/// The mosaic after and before its correction, blended with the pyramid image.
fn blended([corrected, uncorrected]: [&[u8]; 2], pyramid: &[u8], rect: Rect) -> Vec<u8> {
    let window = rect.grown(REACH.max(FocusEnergy::for_edges().reach()), SIDE, SIDE);
    let cut = |x: usize, y: usize| (window.y + y) * SIDE + window.x + x;
    let places = || (0..window.height).flat_map(|y| (0..window.width).map(move |x| (x, y)));
    let samples = |of: &[u8]| places().map(|(x, y)| of[cut(x, y)]).collect::<Vec<u8>>();
    let (corrected, uncorrected, pyramid) = (samples(corrected), samples(uncorrected), samples(pyramid));
    let values: Vec<f32> = corrected.iter().map(|&v| v.into()).collect();
    let change: Vec<f32> = corrected.iter().zip(&uncorrected).map(|(one, other)| one.abs_diff(*other).into()).collect();
    let [corrected, uncorrected, pyramid] = [&corrected[..], &uncorrected, &pyramid];
    let pair = ImagePair { window, corrected, values: &values, uncorrected, pyramid, change: &change };
    let mut out = Vec::new();
    pair.blend::<1>(rect, &mut Rows::default(), &mut out);
    out
}

fn picture(of: impl Fn(usize, usize) -> u8) -> Vec<u8> {
    (0..SIDE * SIDE).map(|at| of(at % SIDE, at / SIDE)).collect()
}

const WHOLE: Rect = Rect { x: 0, y: 0, width: SIDE, height: SIDE };

#[test]
fn a_seam_between_slices_of_different_brightness_does_not_show() {
    let (seam, smooth) = (picture(|x, _| if x < 40 { 100 } else { 110 }), picture(|x, _| 100 + (x / 8) as u8));
    let out = blended([&seam; 2], &smooth, WHOLE);
    assert!(out.chunks_exact(SIDE).all(|row| row.windows(2).all(|two| two[0].abs_diff(two[1]) <= 2)));
}

#[test]
fn noise_is_averaged_where_both_images_agree() {
    let hash = |x: usize, y: usize, of: usize| (((x * 7919 + y * 104_729 + of * 31_337) * 2_654_435_761) >> 16) % 7;
    let noisy = |of: usize| picture(move |x, y| 97 + hash(x, y, of) as u8);
    let spread = |picture: &[u8]| picture.iter().map(|&v| (f64::from(v) - 100.0).powi(2)).sum::<f64>();
    let (one, other) = (noisy(1), noisy(2));
    let out = blended([&one; 2], &other, WHOLE);
    assert!(spread(&out) < 0.7 * spread(&one).min(spread(&other)), "{} of {}", spread(&out), spread(&one));
}

#[test]
fn the_mosaic_is_used_where_defocus_spread_was_removed() {
    let (without, pyramid) = (picture(|_, _| 60), picture(|_, _| 90));
    let with = picture(|x, _| if x < 40 { 90 } else { 60 });
    let out = blended([&without, &with], &pyramid, WHOLE);
    assert!(out.chunks_exact(SIDE).all(|row| row[20] == 60 && row[70] == 90));
}

#[test]
fn the_mosaic_is_used_where_the_pyramid_image_has_a_part_of_the_spread() {
    let (without, with, pyramid) = (picture(|_, _| 60), picture(|_, _| 90), picture(|_, _| 72));
    assert!(blended([&without, &with], &pyramid, WHOLE).iter().all(|&v| v == 60));
}

#[test]
fn a_correction_that_the_pyramid_image_contradicts_is_not_used() {
    let patch = |x: usize, y: usize| (x / 5 + y / 4).is_multiple_of(3);
    let pyramid = picture(|_, _| 90);
    let uncorrected = picture(|x, y| if patch(x, y) { 170 } else { 92 });
    let corrected = picture(|x, y| if patch(x, y) { 180 } else { 112 });
    assert!(blended([&corrected, &uncorrected], &pyramid, WHOLE).iter().all(|&v| v.abs_diff(90) <= 2));
}

#[test]
fn a_fine_line_that_only_the_pyramid_image_has_kept_stays() {
    let (without, with) = (picture(|_, _| 120), picture(|x, _| if x == 40 { 60 } else { 120 }));
    assert!(blended([&without; 2], &with, WHOLE).chunks_exact(SIDE).all(|row| row[40] < 66));
}

#[test]
fn a_part_is_blended_like_the_whole() {
    let hash = |x: usize, y: usize| ((x * 7919 + y * 104_729) >> 3) % 97;
    let (one, other) = (picture(|x, y| 90 + hash(x, y) as u8 / 9), picture(|x, y| 91 + hash(y, x) as u8 / 8));
    let before = picture(|x, y| 90 + hash(x, y) as u8 / 9 + (hash(x, 5) % 3) as u8);
    let whole = blended([&one, &before], &other, WHOLE);
    let rect = Rect { x: 31, y: 3, width: 20, height: 17 };
    let part = blended([&one, &before], &other, rect);
    for (y, row) in part.chunks_exact(rect.width).enumerate() {
        assert_eq!(row, &whole[(rect.y + y) * SIDE + rect.x..][..rect.width]);
    }
}
