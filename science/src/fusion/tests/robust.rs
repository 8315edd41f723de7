//! Flaws of real stacks (exposure, gaps, hot pixels, dust, JPEG, clipping, noise): each alone, by every method.

use std::sync::OnceLock;

use super::{
    rendered::{Rendered, rendered},
    *,
};
use crate::{
    imaging::codec::{Limits, decode, encode_jpeg},
    quality::full_reference::psnr,
    synth::{Light, Rig, Scene},
};

pub(super) fn front(rig: &Rig, scene: &Scene) -> Rendered {
    rendered(rig, scene, Light::Front)
}

/// Seven slices of a beetle, 360 x 240 px.
fn beetle() -> &'static Rendered {
    static RENDERED: OnceLock<Rendered> = OnceLock::new();
    RENDERED.get_or_init(|| front(&Rig { seed: 11, ..Rig::sized(360, 240, 7) }, &Scene::insect(11)))
}

impl Rendered {
    pub(super) fn by(&self, method: Method) -> Plan {
        Plan { method, ..self.plan.clone() }
    }

    /// PSNR of the luma against the truth, without the border that few slices cover, dB.
    pub(super) fn score(&self, image: &Raster) -> f64 {
        let (width, height) = (self.plan.width, self.plan.height);
        let inside = Plane::from_fn(width, height, |x, y| {
            if (12..width - 12).contains(&x) && (12..height - 12).contains(&y) { 255u8 } else { 0 }
        });
        psnr(&image.luma(), &self.truth.sharp.luma(), Some(&inside)).unwrap()
    }
}

fn edited(raster: &Raster, edit: impl Fn(usize, f64) -> f64) -> Raster {
    let Samples::Eight(samples) = &raster.samples else { panic!("8 bits expected") };
    let new = |(i, &v): (usize, &u8)| edit(i, f64::from(v)).round().clamp(0.0, 255.0) as u8;
    Raster { samples: Samples::Eight(samples.iter().enumerate().map(new).collect()), ..raster.clone() }
}

/// Samples that differ by more than `levels`, as (x, y) of their pixels.
fn differing(a: &Raster, b: &Raster, levels: f64) -> Vec<(usize, usize)> {
    let pairs = values(a).into_iter().zip(values(b));
    let mut at: Vec<usize> =
        pairs.enumerate().filter(|(_, (a, b))| (a - b).abs() > levels).map(|(i, _)| i / a.channels).collect();
    at.dedup();
    at.into_iter().map(|at| (at % a.width, at / a.width)).collect()
}

#[test]
fn gains_compensate_slices_of_different_exposure() {
    let case = beetle();
    let exposure = |i: usize| [0.8, 1.0, 0.9, 1.0, 0.75, 1.0, 0.85][i];
    let slices: Vec<Raster> =
        case.slices.iter().enumerate().map(|(i, slice)| edited(slice, |_, v| v * exposure(i))).collect();
    for method in Method::ALL {
        let mut plan = case.by(method);
        plan.slices.iter_mut().enumerate().for_each(|(i, slice)| slice.gain /= exposure(i));
        let (even, uneven) = (fused(&case.slices, &case.by(method)), fused(&slices, &plan));
        let same = psnr(&uneven.image.luma(), &even.image.luma(), None).unwrap();
        println!(
            "{method:?}: {same:.1} dB from the even stack, {:.2} and {:.2} from the truth",
            case.score(&even.image),
            case.score(&uneven.image)
        );
        assert!(same > 40.0, "{method:?}: {same:.1} dB");
        assert!(case.score(&uneven.image) > case.score(&even.image) - 0.5, "{method:?}");
    }
}

#[test]
fn flicker_without_gains_leaves_few_pixels_outside_the_range_of_the_slices() {
    let case = beetle();
    let slices: Vec<Raster> = case
        .slices
        .iter()
        .enumerate()
        .map(|(i, slice)| edited(slice, |_, v| v * if i % 2 == 0 { 0.9 } else { 1.0 }))
        .collect();
    for method in Method::ALL {
        let (even, uneven) = (fused(&case.slices, &case.by(method)), fused(&slices, &case.by(method)));
        let (low, high) = (case.score(&uneven.image), case.score(&even.image));
        println!("{method:?}: {high:.2} dB, flickering {low:.2}");
        let dark = values(&uneven.image).iter().zip(values(&even.image)).filter(|(u, e)| **u < 0.9 * e - 12.0).count();
        let bright = values(&uneven.image).iter().zip(values(&even.image)).filter(|(u, e)| **u > e + 12.0).count();
        let all = uneven.image.width * uneven.image.height * 3;
        assert!((dark + bright) * 500 < all, "{method:?}: {dark} darker and {bright} brighter of {all}");
    }
}

#[test]
fn a_missing_slice_costs_little_quality() {
    let case = front(&Rig { seed: 12, ..Rig::sized(360, 240, 13) }, &Scene::insect(12));
    for method in Method::ALL {
        let whole = fused(&case.slices, &case.by(method));
        let (mut plan, mut slices) = (case.by(method), case.slices.clone());
        slices.remove(4);
        plan.slices.remove(4);
        plan.reference -= 1;
        let gapped = fused(&slices, &plan);
        let (before, after) = (case.score(&whole.image), case.score(&gapped.image));
        println!("{method:?}: {before:.2} dB, {after:.2} without a slice");
        assert!(after > before - 1.5, "{method:?}: {before:.2} became {after:.2}");
        // the index counts the slices of this stack
        assert!(gapped.index.data.iter().all(|&slice| slice < 12 || slice == UNCOVERED));
    }
}

#[test]
fn a_hot_pixel_has_an_effect_only_near_its_track() {
    let case = beetle();
    let hot = [(90usize, 60usize), (200, 150), (300, 100)];
    let is_hot = |i: usize| hot.contains(&(i / 3 % 360, i / 1080));
    let slices: Vec<Raster> =
        case.slices.iter().map(|slice| edited(slice, |i, v| if is_hot(i) { 255.0 } else { v })).collect();
    for method in Method::ALL {
        let (clean, spoilt) = (fused(&case.slices, &case.by(method)), fused(&slices, &case.by(method)));
        let off = differing(&clean.image, &spoilt.image, 8.0);
        let track: Vec<[f64; 2]> =
            (0..7).flat_map(|i| hot.map(|(x, y)| case.plan.slices[i].homography.apply([x as f64, y as f64]))).collect();
        let away = |&(x, y): &(usize, usize)| {
            track.iter().map(|t| (t[0] - x as f64).hypot(t[1] - y as f64)).fold(f64::MAX, f64::min)
        };
        let farthest = off.iter().map(away).fold(0.0, f64::max);
        println!(
            "{method:?}: {} px differ, the farthest {farthest:.1} px from the track; {:.2} dB, {:.2} with",
            off.len(),
            case.score(&clean.image),
            case.score(&spoilt.image)
        );
        assert!(off.len() < 3 * 7 * 25 && farthest < 30.0, "{method:?}: {} px, as far as {farthest:.1} px", off.len());
    }
}

#[test]
fn dust_on_the_sensor_has_an_effect_only_near_its_track() {
    let case = beetle();
    let specks = [(100.0f64, 80.0f64), (240.0, 120.0)];
    let slices: Vec<Raster> = case
        .slices
        .iter()
        .map(|slice| {
            edited(slice, |i, v| {
                let (x, y) = ((i / 3 % 360) as f64, (i / 1080) as f64);
                let away = specks.iter().map(|s| (s.0 - x).hypot(s.1 - y)).fold(f64::MAX, f64::min);
                v * (1.0 - 0.5 * (4.0 - away).clamp(0.0, 1.0))
            })
        })
        .collect();
    for method in Method::ALL {
        let (clean, spoilt) = (fused(&case.slices, &case.by(method)), fused(&slices, &case.by(method)));
        let off = differing(&clean.image, &spoilt.image, 10.0);
        let away = |&(x, y): &(usize, usize)| {
            specks.iter().map(|s| (s.0 - x as f64).hypot(s.1 - y as f64)).fold(f64::MAX, f64::min)
        };
        let farthest = off.iter().map(away).fold(0.0, f64::max);
        println!("{method:?}: {} px differ, the farthest {farthest:.1} px away", off.len());
        assert!(farthest < 36.0 && off.len() < 1500, "{method:?}: {} px, as far as {farthest:.1} px", off.len());
    }
}

#[test]
fn jpeg_blocks_are_not_fused_as_detail() {
    let case = beetle();
    for quality in [92, 75] {
        let slices: Vec<Raster> =
            case.slices.iter().map(|slice| decode(&encode_jpeg(slice, quality), &Limits::default()).unwrap()).collect();
        // the compressed true image: the best possible result
        let truth = decode(&encode_jpeg(&case.truth.sharp, quality), &Limits::default()).unwrap();
        let limit = case.score(&truth);
        for method in Method::ALL {
            let (clean, blocky) = (fused(&case.slices, &case.by(method)), fused(&slices, &case.by(method)));
            let (before, after) = (case.score(&clean.image), case.score(&blocky.image));
            println!("{method:?}, quality {quality}: {before:.2} dB, {after:.2} as JPEG; the truth as JPEG {limit:.2}");
            let noise = |level: f64| 10f64.powf(-level / 10.0);
            let expected = -10.0 * (noise(before) + noise(limit)).log10();
            assert!(after > expected - 0.7, "{method:?}, quality {quality}: {after:.2}, expected {expected:.2}");
        }
    }
}

#[test]
fn sixteen_bits_and_grey_give_the_same_image_as_eight_bits_in_colour() {
    let case = beetle();
    let rig = Rig { seed: 11, ..Rig::sized(360, 240, 7) };
    let deep = front(&Rig { depth: Depth::Sixteen, ..rig.clone() }, &Scene::insect(11));
    let grey = front(&Rig { channels: 1, ..rig }, &Scene::insect(11));
    for method in Method::ALL {
        let colour = fused(&case.slices, &case.by(method)).image;
        let (of_deep, of_grey) =
            (fused(&deep.slices, &deep.by(method)).image, fused(&grey.slices, &grey.by(method)).image);
        assert_eq!((of_deep.depth(), of_grey.channels), (Depth::Sixteen, 1));
        let scores = [&colour, &of_deep, &of_grey].map(|image| case.score(image));
        println!("{method:?}: {scores:.2?}");
        assert!(scores[1] > scores[0] - 0.2, "{method:?}: 16 bits {scores:.2?}");
        assert!((scores[2] - scores[0]).abs() < 1.0, "{method:?}: grey {scores:.2?}");
        let same = psnr(&of_deep.luma(), &colour.luma(), None).unwrap();
        assert!(same > 42.0, "{method:?}: {same:.1} dB apart");
    }
}

#[test]
fn a_clipped_highlight_stays_white_without_ring_or_fringe() {
    // a clipped white disc, with more defocus in each slice, in front of grey grain
    let (width, height, count) = (160, 120, 6);
    let slice = |i: usize| {
        let blur = 1.0 + 3.0 * i as f64;
        let pixel = |at: usize| {
            let (x, y) = (at % width, at / width);
            let away = (x as f64 - 80.0).hypot(y as f64 - 60.0);
            let light = 2.5 / (1.0 + ((away - 14.0) / (0.5 * blur)).exp());
            let grain = 0.35 + 0.25 * (noise(x, y, 3) - 0.5) / (1.0 + (i as f64 - 3.0).abs());
            (grain + light).min(1.0)
        };
        eight(width, height, &(0..width * height).flat_map(|at| [pixel(at); 3]).collect::<Vec<_>>())
    };
    let slices: Vec<Raster> = (0..count).map(slice).collect();
    let range: Vec<[f64; 2]> = (0..width * height)
        .map(|at| {
            let of: Vec<f64> = slices.iter().map(|slice| values(slice)[at * 3]).collect();
            [of.iter().copied().fold(f64::MAX, f64::min), of.iter().copied().fold(0.0, f64::max)]
        })
        .collect();
    for method in Method::ALL {
        let plan = Plan { method, near_first: Some(true), ..Plan::aligned(width, height, count) };
        let image = values(&fused(&slices, &plan).image);
        let (mut beyond, mut fringe) = (0.0f64, 0.0f64);
        for (pixel, [low, high]) in image.chunks_exact(3).zip(&range) {
            beyond = beyond.max(low - pixel[0]).max(pixel[0] - high);
            fringe = fringe.max((pixel[0] - pixel[1]).abs()).max((pixel[2] - pixel[1]).abs());
        }
        println!("{method:?}: {beyond} levels beyond the slices, fringe {fringe}");
        let centre = image[(60 * width + 80) * 3];
        assert_eq!((centre, fringe), (255.0, 0.0), "{method:?}");
        // guided filtering mixes base and detail layers of different slices
        let most = if method == Method::Guided { 40.0 } else { 9.0 };
        assert!(beyond <= most, "{method:?}: {beyond} levels beyond");
    }
}

#[test]
fn every_method_averages_noise_where_slices_agree() {
    // the same smooth shading in all slices, and independent noise in each
    let (width, height, count) = (120, 90, 9);
    let clean = |at: usize| 0.5 + 0.2 * ((at % width) as f64 * 0.03).sin();
    let slices: Vec<Raster> = (0..count)
        .map(|slice| {
            let of = |at: usize, c: usize| {
                let sum: f64 =
                    (0..4).map(|k| noise(at % width, at / width, 40 + 97 * slice + 13 * c + 1000 * k) - 0.5).sum();
                clean(at) + 0.02 * sum
            };
            eight(width, height, &(0..width * height).flat_map(|at| [0, 1, 2].map(|c| of(at, c))).collect::<Vec<_>>())
        })
        .collect();
    let spread = |raster: &Raster| {
        let sum: f64 = values(raster).iter().enumerate().map(|(i, v)| (v / 255.0 - clean(i / 3)).powi(2)).sum();
        (sum / (width * height * 3) as f64).sqrt()
    };
    for method in Method::ALL {
        let own = [(Method::Guided, 1.05), (Method::HaloCorrected, 0.6)];
        let most = own.into_iter().find(|(of, _)| *of == method).map_or(0.8, |(_, most)| most);
        let image = fused(&slices, &Plan { method, ..Plan::aligned(width, height, count) }).image;
        let left = spread(&image) / spread(&slices[0]);
        println!("{method:?}: {left:.2} of the noise of a slice");
        assert!(left < most, "{method:?}: {left:.2} of the noise of a slice");
    }
}

#[test]
fn tiles_do_not_affect_the_result_of_any_method() {
    let case = beetle();
    for method in Method::ALL {
        let plan = case.by(method);
        let whole = fused_in_tiles(&case.slices, &plan, 1000);
        for tile in [64, 100] {
            assert_eq!(fused_in_tiles(&case.slices, &plan, tile).image, whole.image, "{method:?}, {tile} px");
        }
    }
}
