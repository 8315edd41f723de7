//! Colours and fine detail of rendered stacks, by every method.

use super::{robust::front, *};
use crate::synth::{Rig, Scene};

fn colours(scenes: impl IntoIterator<Item = Scene>) {
    for scene in scenes {
        let case = front(&Rig { seed: 6, ..Rig::sized(360, 240, 9) }, &scene);
        let truth = values(&case.truth.sharp);
        for method in Method::ALL {
            let image = values(&fused(&case.slices, &case.by(method)).image);
            let shift: [f64; 3] = std::array::from_fn(|c| {
                let inside = |at: &usize| (20..340).contains(&(at % 360)) && (20..220).contains(&(at / 360));
                let off: Vec<f64> =
                    (0..360 * 240).filter(inside).map(|at| image[at * 3 + c] - truth[at * 3 + c]).collect();
                off.iter().sum::<f64>() / off.len() as f64
            });
            println!("{method:?}: {shift:.2?}");
            assert!(shift.iter().all(|shift| shift.abs() < 1.0), "{method:?}: {shift:.2?}");
            let between = (shift[0] - shift[1]).abs().max((shift[2] - shift[1]).abs());
            assert!(between < 0.35, "{method:?}: {shift:.2?}");
        }
    }
}

#[test]
fn colours_agree_with_the_truth() {
    colours([Scene::flower(6)]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_colours_agree_with_the_truth() {
    colours([Scene::plates(6), Scene::insect(6)]);
}

fn fine_contrast(scenes: impl IntoIterator<Item = (Scene, u64)>) {
    for (scene, seed) in scenes {
        let case = front(&Rig { seed, ..Rig::sized(480, 320, 11) }, &scene);
        let truth = case.truth.sharp.luma();
        // detail: the truth minus its mean over 7 x 7 px
        let detail = |plane: &Plane<f32>, x: usize, y: usize| {
            let around = (y - 3..=y + 3).flat_map(|v| (x - 3..=x + 3).map(move |u| (u, v)));
            f64::from(plane.at(x, y)) - around.map(|(u, v)| f64::from(plane.at(u, v))).sum::<f64>() / 49.0
        };
        let fine: Vec<(usize, usize)> = (16..304)
            .flat_map(|y| (16..464).map(move |x| (x, y)))
            .filter(|&(x, y)| detail(&truth, x, y).abs() > 25.0)
            .collect();
        assert!(fine.len() > 500, "{}", fine.len());
        for method in Method::ALL {
            let image = fused(&case.slices, &case.by(method)).image.luma();
            let (mut both, mut own) = (0.0, 0.0);
            for &(x, y) in &fine {
                let true_detail = detail(&truth, x, y);
                both += true_detail * detail(&image, x, y);
                own += true_detail * true_detail;
            }
            println!("{method:?}, seed {seed}: {:.3} of the contrast at {} px", both / own, fine.len());
            let least = if method == Method::Guided { 0.7 } else { 0.8 };
            assert!(both / own > least, "{method:?}, seed {seed}: {:.3}", both / own);
        }
    }
}

#[test]
fn hairs_and_holes_keep_their_contrast() {
    fine_contrast([(Scene::wing(7), 8)]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_hairs_and_holes_keep_their_contrast() {
    fine_contrast([(Scene::plates(7), 7), (Scene::insect(7), 9)]);
}

/// Fuses stacks of so many slices by these methods.
fn fused_well(cases: &[(usize, &[Method])]) {
    for &(count, methods) in cases {
        let case = front(&Rig { seed: 5, ..Rig::sized(180, 120, count) }, &Scene::plates(5));
        let best = case.slices.iter().map(|slice| case.score(slice)).fold(0.0, f64::max);
        for &method in methods {
            let image = fused(&case.slices, &case.by(method)).image;
            let score = case.score(&image);
            println!("{method:?}, {count} slices: {score:.2} dB, the best slice {best:.2}");
            assert!(score > best + if count == 2 { 0.5 } else { 4.0 }, "{method:?}, {count}: {score:.2} of {best:.2}");
        }
    }
}

#[test]
fn stacks_of_2_and_of_200_slices_are_fused_well() {
    fused_well(&[(2, &Method::ALL), (200, &[Method::HaloCorrected])]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_stacks_of_200_slices_are_fused_well() {
    fused_well(&[(200, &[Method::Guided, Method::Pyramid])]);
}
