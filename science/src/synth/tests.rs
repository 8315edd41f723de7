//! The renderer against what it claims.

use super::*;
use crate::imaging::{Depth, Plane, Raster, Samples, Slices};

fn small() -> Rig {
    Rig { noise: 0.0, ..Rig::sized(240, 180, 5) }
}

/// Bilinear; `None` outside.
fn look_up(plane: &Plane<f32>, [x, y]: [f64; 2]) -> Option<f32> {
    if x < 0.0 || y < 0.0 || x > plane.width as f64 - 1.001 || y > plane.height as f64 - 1.001 {
        return None;
    }
    let (left, top) = (x as usize, y as usize);
    let (s, t) = ((x - left as f64) as f32, (y - top as f64) as f32);
    let upper = plane.at(left, top) * (1.0 - s) + plane.at(left + 1, top) * s;
    let lower = plane.at(left, top + 1) * (1.0 - s) + plane.at(left + 1, top + 1) * s;
    Some(upper * (1.0 - t) + lower * t)
}

fn psnr(squared_errors: &[f32]) -> f64 {
    let mean = squared_errors.iter().map(|&e| f64::from(e)).sum::<f64>() / squared_errors.len() as f64;
    10.0 * (255.0 * 255.0 / mean).log10()
}

/// Pixels of the object that are in focus in slice `i`, more than `margin` px from any step of depth.
fn pixels_away_from_depth_steps(truth: &Truth, i: usize, margin: usize) -> Vec<(usize, usize)> {
    let depth = &truth.slice;
    let is_away = |x: usize, y: usize| {
        let own = depth.at(x, y);
        (own - i as f32).abs() < 0.4
            && (y - margin..=y + margin).all(|v| (x - margin..=x + margin).all(|u| (depth.at(u, v) - own).abs() < 1.0))
    };
    (margin..depth.height - margin)
        .flat_map(|y| (margin..depth.width - margin).map(move |x| (x, y)))
        .filter(|&(x, y)| is_away(x, y))
        .collect()
}

#[test]
fn a_slice_shows_what_is_in_focus_where_its_homography_says_as_bright_as_its_gain_says() {
    for rig in [small(), small().moving_lens()] {
        let stage = Stage::new(&rig, &Scene::plates(3));
        let truth = stage.truth();
        let sharp = truth.sharp.luma();
        for i in 0..rig.slices() {
            let pixels = pixels_away_from_depth_steps(&truth, i, 8);
            if pixels.len() < 100 {
                continue;
            }
            let slice = stage.render(Light::Front, i).luma();
            let back = rig.homography_at(i, rig.focus_fraction(i)).inverse().expect("a sane rig");
            let gain = rig.gain(i) as f32;
            let error = |shift: f64| {
                let at = |&(x, y): &(usize, usize)| {
                    let [u, v] = back.apply([x as f64, y as f64]);
                    Some((look_up(&slice, [u + shift, v])? * gain - sharp.at(x, y)).powi(2))
                };
                psnr(&pixels.iter().filter_map(at).collect::<Vec<_>>())
            };
            assert!(error(0.0) > 28.0, "slice {i} of {:?}: {} dB", rig.mode, error(0.0));
            assert!(error(0.0) > error(0.5) && error(0.0) > error(-0.5), "slice {i} of {:?} is displaced", rig.mode);
        }
    }
}

#[test]
fn every_scene_has_something_to_focus_on_in_every_slice_and_the_right_slice_is_the_sharpest() {
    let rig = small().ideal();
    for scene in [Scene::insect(1), Scene::flower(1), Scene::plates(1), Scene::weave(1), Scene::wing(1)] {
        let stage = Stage::new(&rig, &scene);
        let truth = stage.truth();
        let slices: Vec<_> = (0..rig.slices()).map(|i| stage.render(Light::Front, i).luma()).collect();
        // over the pixels in focus in slice i: the mean difference to the right neighbour in each slice
        for i in 0..rig.slices() {
            let pixels = pixels_away_from_depth_steps(&truth, i, 3);
            if pixels.len() < 60 {
                continue;
            }
            let detail = |n: usize| -> f32 {
                let back = rig.homography(n).inverse().expect("a sane rig");
                let at = |x: usize, y: usize| look_up(&slices[n], back.apply([x as f64, y as f64])).unwrap_or(0.0);
                pixels.iter().map(|&(x, y)| (at(x + 1, y) - at(x, y)).abs()).sum()
            };
            let far = if i < rig.slices() / 2 { rig.slices() - 1 } else { 0 };
            assert!(detail(i) > 1.2 * detail(far), "slice {i}: {} against {}", detail(i), detail(far));
        }
        let in_focus = (0..rig.slices())
            .filter(|&i| truth.slice.data.iter().filter(|&&slice| (slice - i as f32).abs() < 0.5).count() > 60);
        assert_eq!(in_focus.count(), rig.slices(), "every slice is the best somewhere");
    }
}

#[test]
fn the_back_lit_object_is_the_dark_part_of_the_picture() {
    let rig = small().ideal();
    let stage = Stage::new(&rig, &Scene::insect(2));
    let truth = stage.truth();
    let (mut agree, mut either) = (0, 0);
    for i in 0..rig.slices() {
        let luma = stage.render(Light::Back, i).luma();
        let back = rig.homography(i).inverse().expect("a sane rig");
        for y in 0..rig.height {
            for x in 0..rig.width {
                let slice = truth.slice.at(x, y);
                let own = if slice.is_nan() { i == rig.reference } else { slice.round() as usize == i };
                let Some(light) = look_up(&luma, back.apply([x as f64, y as f64])).filter(|_| own) else { continue };
                let (dark, object) = (light < 0.45 * 255.0, truth.mask.at(x, y) == 255);
                agree += usize::from(dark && object);
                either += usize::from(dark || object);
            }
        }
    }
    let iou = agree as f64 / either as f64;
    assert!(iou > 0.95, "IoU {iou}");
}

#[test]
fn defocus_spread_of_a_near_part_covers_the_far_part_beside_its_outline() {
    let plate = |centre: [f64; 2], depth: f64, base: [f32; 3]| scene::Part {
        shape: scene::Shape::Plate { centre, half: [0.4, 0.6], angle: 0.0, corner: 0.0 },
        holes: Vec::new(),
        relief: scene::Relief::Dome { centre, depth, slope: [0.0; 2], bulge: 0.0, radius: 1.0 },
        skin: scene::Skin { base, accent: base, pattern: scene::Pattern::Mottled, grain: 0.0, gloss: 0.0, seed: 0 },
    };
    let parts = vec![plate([0.2, 0.0], 1.0, [0.1; 3]), plate([-0.4, 0.0], 0.0, [0.9; 3])];
    let scene = Scene { parts, ..Scene::plates(1) };
    let rig = Rig::sized(240, 180, 5).ideal();
    let stage = Stage::new(&rig, &scene);
    let sharp = stage.truth().sharp.luma();
    let far_in_focus = stage.render(Light::Front, 4).luma();
    // the outline of the near plate lies at x = 119.5 in the reference; the radius of blur is about 4 px
    let back = rig.homography(4).inverse().expect("a sane rig");
    let beside = back.apply([121.5, 90.0]);
    let covered = look_up(&far_in_focus, beside).expect("inside") * rig.gain(4) as f32;
    let clear = sharp.at(121, 90);
    assert!(covered > clear + 25.0, "{covered} against {clear}");
    let away = back.apply([140.0, 90.0]);
    let uncovered = look_up(&far_in_focus, away).expect("inside") * rig.gain(4) as f32;
    assert!((uncovered - sharp.at(140, 90)).abs() < 3.0);
}

#[test]
fn the_same_rig_gives_the_same_bytes_on_any_number_of_threads_and_another_seed_others() {
    let rig = Rig::sized(120, 90, 3);
    let scene = Scene::flower(5);
    let with_threads = |count: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build().expect("a pool");
        pool.install(|| {
            (render(&rig, &scene, Light::Front, 0), render(&rig, &scene, Light::Back, 2), truth(&rig, &scene).sharp)
        })
    };
    let alone = with_threads(1);
    assert_eq!(alone, with_threads(3));
    assert_ne!(alone.0, render(&Rig { seed: 9, ..rig.clone() }, &scene, Light::Front, 0));
    assert_ne!(alone.2, truth(&rig, &Scene::flower(6)).sharp);
}

#[test]
fn noise_has_the_deviation_that_was_asked_for_and_differs_from_slice_to_slice() {
    let rig = Rig { noise: 2.0, channels: 1, depth: Depth::Sixteen, ..small().ideal() };
    let stage = |noise: f64| Stage::new(&Rig { noise, ..rig.clone() }, &Scene::insect(1));
    let difference = |a: &Raster, b: &Raster| {
        let squares = a.luma().data.iter().zip(&b.luma().data).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        (squares / (rig.width * rig.height) as f64).sqrt()
    };
    let (noisy, clean) = (stage(2.0), stage(0.0));
    let measured = difference(&noisy.render(Light::Back, 1), &clean.render(Light::Back, 1));
    assert!((measured - 2.0).abs() < 0.25, "{measured}");
    assert_ne!(noisy.render(Light::Back, 1), noisy.render(Light::Front, 1));
}

#[test]
fn eight_and_sixteen_bits_grey_and_colour_show_the_same_picture() {
    let base = small();
    let luma = |depth: Depth, channels: usize| {
        let rig = Rig { depth, channels, ..base.clone() };
        let raster = render(&rig, &Scene::flower(1), Light::Front, 1);
        assert_eq!((raster.depth(), raster.channels), (depth, channels));
        raster.luma()
    };
    let expected = luma(Depth::Sixteen, 3);
    for (depth, channels) in [(Depth::Eight, 3), (Depth::Eight, 1), (Depth::Sixteen, 1)] {
        let found = luma(depth, channels);
        let worst = found.data.iter().zip(&expected.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 1.01, "{depth:?} {channels}: {worst}");
    }
}

#[test]
fn a_rendered_stack_gives_its_slices_one_by_one_and_refuses_the_one_past_the_end() {
    let rig = Rig::sized(96, 72, 3);
    let target = DotTarget::for_rig(&rig, 8);
    let stack = Rendered::target(&rig, &target);
    let whole = target_stack(&rig, &target);
    assert_eq!((stack.count(), stack.name(2)), (3, "target_002"));
    for (i, slice) in whole.iter().enumerate() {
        assert_eq!(stack.load(i).as_ref(), Ok(slice));
    }
    assert!(stack.load(3).is_err());
    let Samples::Eight(samples) = &whole[0].samples else { panic!("8 bits by default") };
    assert_eq!(samples.len(), 96 * 72 * 3);
}

#[test]
fn a_scaled_scene_leaves_a_margin_and_keeps_its_depths() {
    let rig = small();
    let truth = |times: f64| Stage::new(&rig, &Scene::insect(1).scaled(times)).truth();
    let touches = |mask: &Plane<u8>| {
        let (right, lower) = (mask.width - 1, mask.height - 1);
        (0..mask.width).any(|x| mask.at(x, 0) != 0 || mask.at(x, lower) != 0)
            || (0..mask.height).any(|y| mask.at(0, y) != 0 || mask.at(right, y) != 0)
    };
    let (whole, smaller) = (truth(1.0), truth(0.5));
    assert!(touches(&whole.mask) && !touches(&smaller.mask));
    let area = |mask: &Plane<u8>| mask.data.iter().filter(|&&m| m != 0).count() as f64;
    assert!((area(&smaller.mask) / area(&whole.mask) - 0.25).abs() < 0.05);
    // a point of the wing cases, halfway to the middle
    let (x, y) = (140, 80);
    let middle = |length: usize| (length as f64 - 1.0) / 2.0;
    let half = |at: usize, length: usize| (middle(length) + (at as f64 - middle(length)) / 2.0).round() as usize;
    let (before, after) = (whole.slice.at(x, y), smaller.slice.at(half(x, 240), half(y, 180)));
    assert!((before - after).abs() < 0.1, "{before} {after}");
}
