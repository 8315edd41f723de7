//! The rendered faults against their own truth.

use super::disc_overlap::overlap_middle;
use super::*;
use crate::imaging::{Depth, Plane, Raster};

fn rig() -> Rig {
    let sized = Rig { depth: Depth::Sixteen, channels: 1, ..Rig::sized(240, 180, 3) };
    Rig { noise: 0.0, vignetting: 0.0, exposure_falls: false, ..sized }
}

fn with(rig: &Rig, faults: Faults) -> DotTarget {
    let plain = DotTarget::for_rig(rig, 8);
    DotTarget { rows: 6, flaws: Flaws { faults, ..Flaws::default() }, ..plain }
}

/// Largest distance of a dot's centre of gravity from its true position, px.
fn worst_centre(luma: &Plane<f32>, dots: &[[f64; 2]], reach: f64) -> f64 {
    let white = luma.data.iter().copied().fold(0.0, f32::max);
    let inside = |dot: &&[f64; 2]| dot[0] > reach && dot[1] > reach && dot[0] < 239.0 - reach && dot[1] < 179.0 - reach;
    let mut seen = 0;
    let mut worst = 0.0_f64;
    for dot in dots.iter().filter(inside) {
        let (mut sum, mut at) = (0.0, [0.0; 2]);
        for y in (dot[1] - reach).ceil() as usize..=(dot[1] + reach).floor() as usize {
            for x in (dot[0] - reach).ceil() as usize..=(dot[0] + reach).floor() as usize {
                let dark = f64::from(white - luma.at(x, y));
                sum += dark;
                at = [at[0] + dark * x as f64, at[1] + dark * y as f64];
            }
        }
        worst = worst.max((at[0] / sum - dot[0]).hypot(at[1] / sum - dot[1]));
        seen += 1;
    }
    assert!(seen >= 12, "{seen} dots");
    worst
}

#[test]
fn displaced_distorted_and_misprinted_dots_lie_where_the_truth_says() {
    let jump = Rig { displaced_px: vec![[0.0; 2], [0.0; 2], [7.3, -4.1]], ..rig() };
    let moved = Moved { from: 2, by: [0.3, -0.2], turn_deg: 2.0 };
    let cases = [
        ("jump", jump, Faults::default()),
        ("moved", rig(), Faults { moved: Some(moved), ..Faults::default() }),
        ("distorted", rig(), Faults { distortion: 0.02, ..Faults::default() }),
        ("misprinted", rig(), Faults { print_error: 0.03, ..Faults::default() }),
    ];
    for (name, rig, faults) in cases {
        let target = with(&rig, faults);
        let reach = 0.42 * target.pitch_px(&rig, 2);
        let dots = target.dots(&rig, 2);
        let plain = with(&rig, Faults::default()).dots(&Rig { displaced_px: Vec::new(), ..rig.clone() }, 2);
        assert!(dots.iter().zip(&plain).any(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]) > 0.5), "{name} moves dots");
        let worst = worst_centre(&render_target(&rig, &target, 2).luma(), &dots, reach);
        assert!(worst < 0.05, "{name}: {worst} px");
    }
}

#[test]
fn the_truth_with_a_jump_and_distortion_sends_each_dot_to_its_place_in_the_reference() {
    let rig = Rig { displaced_px: vec![[9.0, 1.0], [2.0, 0.0], [0.0; 2]], ..rig() };
    let target = with(&rig, Faults { distortion: -0.03, print_error: 0.02, ..Faults::default() });
    let reference = target.dots(&rig, rig.reference);
    for i in 0..3 {
        for (dot, expected) in target.dots(&rig, i).into_iter().zip(&reference) {
            let mapped = target.flaws.faults.to_reference(&rig, &rig.homography(i), dot);
            assert!((mapped[0] - expected[0]).hypot(mapped[1] - expected[1]) < 1e-6);
        }
    }
}

#[test]
fn every_kernel_keeps_the_light_and_the_second_moment() {
    for kernel in [Kernel::Disc, Kernel::Gaussian, Kernel::CoreAndHalo, Kernel::Ring] {
        let share: f64 = kernel.discs().iter().map(|disc| disc[1]).sum();
        let moment: f64 = kernel.discs().iter().map(|disc| disc[1] * disc[0].powi(2)).sum();
        assert!((share - 1.0).abs() < 1e-12 && (moment - 1.0).abs() < 1e-4, "{kernel:?}: {share} {moment}");
    }
}

#[test]
fn the_middle_of_the_shared_area_agrees_with_a_count_of_points() {
    for (a, b, distance) in [(1.0, 0.8, 1.2), (0.5, 2.0, 1.7), (2.0, 0.5, 1.9), (0.4, 2.0, 1.0), (2.0, 0.4, 1.0)] {
        let (mut sum, mut count) = (0.0, 0.0);
        for x in -400..400 {
            for y in -400..400 {
                let (x, y) = (f64::from(x) / 200.0 + 0.0025, f64::from(y) / 200.0 + 0.0025);
                if x.hypot(y) < b && (x - distance).hypot(y) < a {
                    sum += x;
                    count += 1.0;
                }
            }
        }
        let found = overlap_middle(a, b, distance);
        assert!((found - sum / count).abs() < 0.005, "{a} {b} {distance}: {found} for {}", sum / count);
    }
}

fn mean(raster: &Raster) -> f64 {
    let luma = raster.luma();
    luma.data.iter().map(|&value| f64::from(value)).sum::<f64>() / luma.data.len() as f64
}

#[test]
fn exposures_and_replaced_slices_concern_their_slice_alone() {
    let rig = rig();
    let plain = with(&rig, Faults::default());
    let clean: Vec<Raster> = (0..3).map(|i| render_target(&rig, &plain, i)).collect();
    let dimmed = with(&rig, Faults { exposures: vec![[1.0; 3], [0.5; 3]], ..Faults::default() });
    assert!((mean(&render_target(&rig, &dimmed, 1)) / mean(&clean[1]) - 0.5).abs() < 1e-3);
    assert!((dimmed.stored_white(&rig, 1, [9.0, 9.0]) / plain.stored_white(&rig, 1, [9.0, 9.0]) - 0.5).abs() < 1e-9);
    assert_eq!(render_target(&rig, &dimmed, 2), clean[2]);
    for shows in [Replacement::Black, Replacement::Blank, Replacement::Mirrored, Replacement::Other] {
        let target = with(&rig, Faults { replaced: Some((1, shows)), ..Faults::default() });
        assert_eq!(render_target(&rig, &target, 0), clean[0]);
        let slice = render_target(&rig, &target, 1);
        assert_ne!(slice, clean[1]);
        let (found, luma, own) = (mean(&slice), slice.luma(), clean[1].luma());
        match shows {
            Replacement::Black => assert_eq!(found, 0.0),
            Replacement::Blank => assert!((found - 0.85 * 255.0).abs() < 0.1, "{found}"),
            Replacement::Mirrored => assert!((0..240).all(|x| luma.at(x, 77) == own.at(239 - x, 77))),
            Replacement::Other => assert!(found > 100.0 && found < 0.85 * 255.0, "{found}"),
        }
    }
}

#[test]
fn stripes_have_the_told_period_and_strength_and_another_phase_in_each_slice() {
    let rig = rig();
    let banding = Some(Banding { period_px: 20.0, strength: 0.05 });
    let missing = (0..48).collect();
    let bare = DotTarget { missing, ..with(&rig, Faults { banding, ..Faults::default() }) };
    let [first, second] = [0, 1].map(|i| render_target(&rig, &bare, i).luma());
    let column: Vec<f32> = (0..180).map(|y| first.at(100, y)).collect();
    let (low, high) = column.iter().fold((f32::MAX, 0.0_f32), |(low, high), &v| (low.min(v), high.max(v)));
    assert!(((high - low) / (high + low) - 0.05).abs() < 0.001, "{low} to {high}");
    assert!((0..160).all(|y| (column[y] - column[y + 20]).abs() < 0.02));
    assert!((0..180).any(|y| (column[y] - second.at(100, y)).abs() > 2.0));
}

#[test]
fn lateral_colour_scales_a_channel_about_the_centre() {
    let rig = Rig { channels: 3, ..rig() };
    let plain = with(&rig, Faults::default());
    let target = with(&rig, Faults { lateral: [0.01, 0.0, -0.01], axial_px: [0.5, 0.0, 0.0], ..Faults::default() });
    let raster = render_target(&rig, &target, 1);
    let clean = render_target(&rig, &plain, 1);
    let [cx, cy] = rig.centre();
    let crate::imaging::Samples::Sixteen(samples) = &raster.samples else { panic!("16 bits") };
    let crate::imaging::Samples::Sixteen(own) = &clean.samples else { panic!("16 bits") };
    assert!(samples.chunks_exact(3).zip(own.chunks_exact(3)).all(|(a, b)| a[1] == b[1]), "green is nominal");
    let blue = Plane {
        width: 240,
        height: 180,
        data: samples.chunks_exact(3).map(|rgb| f32::from(rgb[2])).collect::<Vec<f32>>(),
    };
    let dots: Vec<[f64; 2]> =
        plain.dots(&rig, 1).iter().map(|dot| [cx + (dot[0] - cx) * 0.99, cy + (dot[1] - cy) * 0.99]).collect();
    let worst = worst_centre(&blue, &dots, 0.42 * plain.pitch_px(&rig, 1));
    assert!(worst < 0.05, "{worst} px");
}
