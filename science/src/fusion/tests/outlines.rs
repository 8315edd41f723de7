//! Beside the outlines of near parts: the contrast of detail, and no dark line.

use super::{
    halo_corrected::halo_corrected,
    rendered::{Rendered, rendered},
    *,
};
use crate::synth::{Light, Rig, Scene};

/// The contrast of detail on far parts, 2 to 6 px beside the outline of a nearer part, relative to the truth: the slope
/// of a regression of the fused image on the true image, after the mean over 5 x 5 px is subtracted from both.
fn contrast_beside_outlines(scene: &Scene, seed: u64) -> f64 {
    let rig = Rig { seed, ..Rig::sized(480, 320, 11) };
    let Rendered { slices, plan, truth } = rendered(&rig, scene, Light::Front);
    let fused = fused(&slices, &halo_corrected(plan)).image.luma();
    let sharp = truth.sharp.luma();
    let nearest_within = |x: usize, y: usize, reach: usize| {
        let square = (y - reach..=y + reach).flat_map(|v| (x - reach..=x + reach).map(move |u| (u, v)));
        square.map(|(u, v)| truth.slice.at(u, v)).filter(|slice| !slice.is_nan()).fold(f32::INFINITY, f32::min)
    };
    let detail = |image: &Plane<f32>, x: usize, y: usize| {
        let square = (y - 2..=y + 2).flat_map(|v| (x - 2..=x + 2).map(move |u| (u, v)));
        f64::from(image.at(x, y)) - square.map(|(u, v)| f64::from(image.at(u, v))).sum::<f64>() / 25.0
    };
    let (mut both, mut truth_alone, mut count) = (0.0, 0.0, 0);
    for (x, y) in (20..300).flat_map(|y| (20..460).map(move |x| (x, y))) {
        let slice = truth.slice.at(x, y);
        if nearest_within(x, y, 6) < slice - 2.0 && nearest_within(x, y, 1) > slice - 1.0 {
            let (fused, sharp) = (detail(&fused, x, y), detail(&sharp, x, y));
            (both, truth_alone, count) = (both + fused * sharp, truth_alone + sharp * sharp, count + 1);
        }
    }
    assert!(count > 500, "{count} pixels beside outlines");
    both / truth_alone
}

fn contrasts(scenes: &[(&str, Scene)]) {
    let contrasts: Vec<f64> = scenes
        .iter()
        .map(|(name, scene)| {
            let contrast = contrast_beside_outlines(scene, 6);
            println!("{name}: {:.1} % of the true contrast", 100.0 * contrast);
            contrast
        })
        .collect();
    let mean = contrasts.iter().sum::<f64>() / contrasts.len() as f64;
    assert!(contrasts.iter().all(|&contrast| contrast < 1.0), "no more than the truth: {contrasts:?}");
    assert!(mean > 0.855, "mean {mean:.3}");
}

#[test]
fn detail_beside_outlines_keeps_most_of_its_contrast() {
    contrasts(&[("insect", Scene::insect(2)), ("flower", Scene::flower(2))]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_detail_beside_outlines_keeps_most_of_its_contrast() {
    contrasts(&[
        ("plates", Scene::plates(3)),
        ("weave", Scene::weave(2)),
        ("insect", Scene::insect(2)),
        ("wing", Scene::wing(1)),
        ("flower", Scene::flower(2)),
    ]);
}

/// The share of the ground 2 to 8 px beside the object that is more than 3 grey levels darker than the truth.
fn share_of_dark_line(seed: u64, blur: f64) -> f64 {
    let (width, height) = (300usize, 200usize);
    let plain = Rig::sized(width, height, 28);
    let rig = Rig { seed, softness_px: 0.7, f_number: plain.f_number / blur, ..plain };
    let Rendered { slices, plan, truth } = rendered(&rig, &Scene::rim(seed), Light::Front);
    let fused = fused(&slices, &halo_corrected(plan)).image.luma();
    let sharp = truth.sharp.luma();
    let object_within = |x: usize, y: usize, reach: usize| {
        let rows = y.saturating_sub(reach)..(y + reach + 1).min(height);
        let columns = x.saturating_sub(reach)..(x + reach + 1).min(width);
        rows.into_iter().any(|y| truth.cover.row(y)[columns.clone()].iter().any(|&cover| cover > 0))
    };
    let places = (10..height - 10).flat_map(|y| (10..width - 10).map(move |x| (x, y)));
    let ring = places.filter(|&(x, y)| object_within(x, y, 8) && !object_within(x, y, 1));
    let too_dark: Vec<bool> = ring.map(|(x, y)| fused.at(x, y) < sharp.at(x, y) - 3.0).collect();
    assert!(too_dark.len() > 1000, "the ring has {} pixels", too_dark.len());
    too_dark.iter().filter(|&&dark| dark).count() as f64 / too_dark.len() as f64
}

fn no_dark_line(seed: u64, blur: f64) {
    let share = share_of_dark_line(seed, blur);
    assert!(share < 0.002, "seed {seed}: {:.2} % of the ground beside the object is too dark", 100.0 * share);
}

#[test]
fn no_dark_line_surrounds_a_bright_outline_on_black_ground_when_steps_are_fine() {
    no_dark_line(3, 0.5);
}

#[test]
#[ignore = "more cases of a test"]
fn more_bright_outlines_on_black_ground_have_no_dark_line_when_steps_are_fine() {
    no_dark_line(2, 0.6);
}
