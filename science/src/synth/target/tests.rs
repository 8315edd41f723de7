//! The rendered target against its own truth.

use super::*;
use crate::imaging::{Depth, Plane, Raster, Samples};

fn rig() -> Rig {
    Rig { noise: 0.0, vignetting: 0.0, ..Rig::sized(480, 360, 7) }
}

/// Centre of gravity of the darkness within half a pitch of `about`.
fn centroid(luma: &Plane<f32>, about: [f64; 2], reach: f64) -> [f64; 2] {
    let (mut sum, mut at) = (0.0, [0.0; 2]);
    let white = luma.data.iter().copied().fold(0.0, f32::max);
    for y in (about[1] - reach).ceil() as usize..=(about[1] + reach).floor() as usize {
        for x in (about[0] - reach).ceil() as usize..=(about[0] + reach).floor() as usize {
            let dark = f64::from(white - luma.at(x, y));
            sum += dark;
            at = [at[0] + dark * x as f64, at[1] + dark * y as f64];
        }
    }
    [at[0] / sum, at[1] / sum]
}

#[test]
fn dots_are_drawn_where_the_truth_says_sharp_and_blurred() {
    let rig = rig();
    let target = DotTarget::for_rig(&rig, 12);
    for i in [0, 3, 6] {
        let luma = render_target(&rig, &target, i).luma();
        let reach = 0.48 * target.pitch_px(&rig, i);
        for dot in target.dots(&rig, i) {
            let found = centroid(&luma, dot, reach);
            let error = (found[0] - dot[0]).hypot(found[1] - dot[1]);
            assert!(error < 0.06, "slice {i}: {dot:?} found at {found:?}");
        }
    }
}

#[test]
fn the_true_homography_sends_each_dot_to_its_place_in_the_reference() {
    for rig in [rig(), rig().moving_lens()] {
        let target = DotTarget::for_rig(&rig, 12);
        let reference = target.dots(&rig, rig.reference);
        assert_eq!(reference.len(), target.columns * target.rows);
        for i in 0..rig.slices() {
            for (dot, expected) in target.dots(&rig, i).into_iter().zip(&reference) {
                let mapped = rig.homography(i).apply(dot);
                assert!((mapped[0] - expected[0]).hypot(mapped[1] - expected[1]) < 1e-9);
            }
        }
    }
}

#[test]
fn the_plate_is_bright_the_dots_are_dark_and_the_other_way_round_when_inverted() {
    let rig = rig();
    for invert in [false, true] {
        let target = DotTarget { invert, ..DotTarget::for_rig(&rig, 12) };
        let luma = render_target(&rig, &target, rig.reference).luma();
        let dots = target.dots(&rig, rig.reference);
        let on = luma.at(dots[0][0].round() as usize, dots[0][1].round() as usize);
        let off = luma.at(
            ((dots[0][0] + dots[1 + target.columns][0]) / 2.0).round() as usize,
            ((dots[0][1] + dots[1 + target.columns][1]) / 2.0).round() as usize,
        );
        let (bright, dark) = if invert { (on, off) } else { (off, on) };
        assert!((bright - 0.85 * 255.0).abs() < 1.0, "{bright}");
        assert!((dark - 0.06 * 255.0).abs() < 1.0, "{dark}");
    }
}

#[test]
fn white_follows_the_exposure_so_the_gain_takes_it_back() {
    let rig = rig();
    let target = DotTarget::for_rig(&rig, 12);
    let white = |i| render_target(&rig, &target, i).luma().data.into_iter().fold(0.0, f32::max);
    let ratio = f64::from(white(6)) * rig.gain(6) / f64::from(white(3));
    assert!((ratio - 1.0).abs() < 0.005, "{ratio}");
}

/// One slice sharp enough for the pixel to be the largest disc, without noise, in 16 bits.
fn exact() -> Rig {
    Rig { depth: Depth::Sixteen, channels: 1, ..rig() }
}

fn worst_centroid(rig: &Rig, target: &DotTarget, i: usize, reach: f64) -> f64 {
    let luma = render_target(rig, target, i).luma();
    let dots = target.dots(rig, i);
    let printed = target.printed();
    let inside = |dot: &[f64; 2]| {
        (0..2).all(|a| dot[a] > reach + 1.0 && dot[a] < [rig.width, rig.height][a] as f64 - reach - 2.0)
    };
    let seen: Vec<[f64; 2]> =
        dots.iter().zip(printed).filter(|(dot, there)| *there && inside(dot)).map(|d| *d.0).collect();
    assert!(seen.len() > 20, "{} dots", seen.len());
    let error = |dot: &[f64; 2]| {
        let found = centroid(&luma, *dot, reach);
        (found[0] - dot[0]).hypot(found[1] - dot[1])
    };
    seen.iter().map(error).fold(0.0, f64::max)
}

#[test]
fn a_sharp_dot_lies_where_the_truth_says_to_a_hundredth_of_a_pixel() {
    let rig = exact();
    let plain = DotTarget::for_rig(&rig, 12);
    let turned = DotTarget { rotation_deg: 45.0, ..plain.clone() };
    let asymmetric = DotTarget { asymmetric: true, ..plain.clone() };
    let holed = plain.clone().without(0.08, 3);
    let tilted = DotTarget { tilt_deg: [1.5, -1.0], ..plain.clone() };
    for (name, target) in
        [("plain", plain), ("turned", turned), ("asymmetric", asymmetric), ("holed", holed), ("tilted", tilted)]
    {
        let pitch = target.pitch_px(&rig, rig.reference);
        let reach = if target.asymmetric { 0.3 * pitch } else { 0.46 * pitch };
        // the window is square and cuts nothing: the dot ends well within it
        let worst = worst_centroid(&rig, &target, rig.reference, reach);
        assert!(worst < 0.01, "{name}: {worst} px");
    }
}

#[test]
fn dots_keep_their_place_and_their_darkness_under_blur_and_tilt() {
    let rig = exact();
    let plain = DotTarget::for_rig(&rig, 12);
    // far apart, so that no neighbour reaches into the window
    let lone = DotTarget { tilt_deg: [1.5, 1.0], dot_diameter_mm: 0.25 * plain.pitch_mm, ..plain };
    let dark = |i: usize| {
        let picture = render_target(&rig, &lone, i).luma();
        let white = picture.data.iter().copied().fold(0.0, f32::max);
        let sum: f64 = picture.data.iter().map(|&value| f64::from(white - value)).sum();
        sum / f64::from(white) / lone.pitch_px(&rig, i).powi(2)
    };
    for i in [0, 6] {
        assert!(lone.blur_radius_px(&rig, i) > 2.5);
        let worst = worst_centroid(&rig, &lone, i, 0.48 * lone.pitch_px(&rig, i));
        assert!(worst < 0.02, "slice {i}: {worst} px");
        assert!((dark(i) / dark(3) - 1.0).abs() < 0.01, "slice {i}: {} for {}", dark(i), dark(3));
    }
}

#[test]
fn a_tilted_plate_is_nearer_on_one_side_and_the_homography_stays_exact() {
    let rig = rig();
    let target = DotTarget { tilt_deg: [0.0, 8.0], rotation_deg: 0.0, ..DotTarget::for_rig(&rig, 12) };
    let reference = target.dots(&rig, rig.reference);
    let step = |c: usize| reference[c + 1][0] - reference[c][0];
    assert!(step(10) > 1.02 * step(0), "the right side is nearer: {} and {}", step(10), step(0));
    for i in 0..rig.slices() {
        for (dot, expected) in target.dots(&rig, i).into_iter().zip(&reference) {
            let mapped = rig.homography(i).apply(dot);
            assert!((mapped[0] - expected[0]).hypot(mapped[1] - expected[1]) < 1e-8);
        }
    }
    let blur = |i: usize, u: f64| target.blur_at(&rig, i, [u, 0.0]);
    assert!(blur(0, 5.0) < blur(0, -5.0) && blur(6, 5.0) > blur(6, -5.0), "the first slice is in focus nearest");
}

#[test]
fn rows_of_an_asymmetric_target_are_half_a_step_apart_and_shifted() {
    let rig = exact();
    let target = DotTarget { asymmetric: true, rotation_deg: 0.0, ..DotTarget::for_rig(&rig, 8) };
    let (dots, pitch) = (target.dots(&rig, 3), target.pitch_px(&rig, 3));
    let step = [dots[8][0] - dots[0][0], dots[8][1] - dots[0][1]];
    assert!((step[0] - pitch / 2.0).abs() < 1e-9 && (step[1] - pitch / 2.0).abs() < 1e-9, "{step:?}");
}

#[test]
fn missing_dots_leave_the_bare_plate() {
    let rig = exact();
    let target = DotTarget { missing: vec![14], ..DotTarget::for_rig(&rig, 12) };
    let luma = render_target(&rig, &target, rig.reference).luma();
    let dots = target.dots(&rig, rig.reference);
    let at = |dot: usize| luma.at(dots[dot][0].round() as usize, dots[dot][1].round() as usize);
    assert!((at(14) - 0.85 * 255.0).abs() < 1.0, "{}", at(14));
    assert!((at(15) - 0.06 * 255.0).abs() < 1.0, "{}", at(15));
    let share = target.without(0.08, 5).missing.len() as f64 / dots.len() as f64;
    assert!((0.02..0.16).contains(&share), "{share}");
}

#[test]
fn every_flaw_is_seen_where_it_should_be() {
    let rig = exact();
    let plain = DotTarget::for_rig(&rig, 12);
    let shown = |flaws: Flaws, i: usize| render_target(&rig, &DotTarget { flaws, ..plain.clone() }, i).luma();
    let changed = |flaws: Flaws, i: usize| -> Vec<usize> {
        let (with, without) = (shown(flaws, i), shown(Flaws::default(), i));
        (0..with.data.len()).filter(|&k| (with.data[k] - without.data[k]).abs() > 3.0).collect()
    };
    let sensor = Flaws { sensor_dust: 6, ..Flaws::default() };
    let on_sensor: Vec<usize> = changed(sensor.clone(), 3);
    assert!(!on_sensor.is_empty() && on_sensor.len() < rig.width * rig.height / 50);
    // it stays where the plate moves away
    assert!(changed(sensor, 2).iter().filter(|k| on_sensor.contains(k)).count() > on_sensor.len() / 2);
    let target = Flaws { target_dust: 20, ..Flaws::default() };
    assert!(!changed(target.clone(), 3).is_empty());
    assert!(changed(target.clone(), 0) != changed(target, 3));
    let glare = Flaws { glare: vec![Glare { at: [0.5, 0.5], radius: 0.1, light: 0.6 }], ..Flaws::default() };
    assert_eq!(shown(glare, 3).at(240, 180), 255.0, "it clips");
    let monitor = changed(Flaws { raster_px: Some(1.83), ..Flaws::default() }, 3);
    assert!(monitor.len() > rig.width * rig.height / 4);
    let small = DotTarget { columns: 6, rows: 5, ..plain.clone() };
    for surround in [Surround::table(), Surround::framed()] {
        let flaws = Flaws { surround: Some(surround), ..Flaws::default() };
        let around = render_target(&rig, &DotTarget { flaws, ..small.clone() }, 3).luma();
        let bare = render_target(&rig, &small, 3).luma();
        let [x, y] = small.dots(&rig, 3)[0].map(|v| v.round() as usize);
        assert_eq!(around.at(x, y), bare.at(x, y), "the plate is left alone");
        assert!((around.at(5, 5) - bare.at(5, 5)).abs() > 20.0, "{}", around.at(5, 5));
    }
}

#[test]
fn stored_white_is_what_the_bare_plate_stores() {
    let rig = Rig { vignetting: 0.3, ..exact() };
    for flaws in [
        Flaws::default(),
        Flaws { gamma: true, ..Flaws::default() },
        Flaws { overexposure: 1.4, ..Flaws::default() },
        Flaws { gamma: true, overexposure: 0.6, ..Flaws::default() },
    ] {
        let bare = DotTarget { columns: 2, rows: 2, flaws, ..DotTarget::for_rig(&rig, 30) };
        for i in [0, 3, 6] {
            let luma = render_target(&rig, &bare, i).luma();
            for (x, y) in [(3, 5), (120, 90), (470, 350)] {
                let told = 255.0 * bare.stored_white(&rig, i, [x as f64, y as f64]);
                assert!((told - f64::from(luma.at(x, y))).abs() < 0.02, "slice {i}: {told} {}", luma.at(x, y));
            }
        }
    }
}

#[test]
fn a_target_with_every_flaw_gives_the_same_bytes_on_any_number_of_threads() {
    let rig = Rig { channels: 1, ..Rig::sized(200, 150, 3) };
    let mut target = DotTarget::oblique(&rig, 10).without(0.1, 2);
    target.flaws.target_dust = 9;
    target.flaws.sensor_dust = 5;
    target.flaws.gamma = true;
    let with_threads = |target: &DotTarget, count: usize| -> Vec<Raster> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build().expect("a pool");
        pool.install(|| (0..3).map(|i| render_target(&rig, target, i)).collect())
    };
    let alone = with_threads(&target, 1);
    assert_eq!(alone, with_threads(&target, 3));
    target.flaws.seed = 2;
    assert_ne!(alone, with_threads(&target, 1));
}

/// `SHOW=folder cargo test --lib looks_at_targets` writes pictures to look at.
#[test]
fn looks_at_targets() {
    let Some(folder) = std::env::var_os("SHOW") else { return };
    let rig = Rig { channels: 1, ..Rig::sized(900, 600, 7) };
    let mut dirty = DotTarget { columns: 14, rows: 9, asymmetric: false, ..DotTarget::for_rig(&rig, 24) };
    dirty.flaws = Flaws {
        target_dust: 40,
        sensor_dust: 8,
        glare: vec![Glare { at: [0.3, 0.4], radius: 0.08, light: 0.4 }],
        surround: Some(Surround::table()),
        gamma: true,
        ..Flaws::default()
    };
    let mut framed = dirty.clone();
    framed.flaws.surround = Some(Surround::framed());
    let pictures = [
        ("dirty", dirty),
        ("framed", framed),
        ("oblique", DotTarget::oblique(&rig, 24)),
        ("monitor", DotTarget::on_monitor(&rig, 24)),
        ("asymmetric", DotTarget { asymmetric: true, ..DotTarget::for_rig(&rig, 16) }),
    ];
    for (name, target) in pictures {
        for i in [0, 3] {
            let picture = render_target(&rig, &target, i);
            let file = std::path::Path::new(&folder).join(format!("{name}-{i}.png"));
            let Samples::Eight(samples) = picture.samples else { panic!("8 bits by default") };
            image::GrayImage::from_raw(900, 600, samples).expect("the size").save(file).expect("saved");
        }
    }
}
