//! Further lights: against rendered truth, and by property.

use std::sync::Arc;

use super::{
    rendered::{Rendered, rendered},
    *,
};
use crate::{
    quality::full_reference::psnr,
    synth::{Light, Rig, Scene},
};

/// The picture under another lamp, with the exposure of a slice of this `gain`: each channel is a share of that of the
/// front light, and dark becomes bright.
fn other_lamp(slice: &Raster, gain: f64) -> Raster {
    let Samples::Eight(samples) = &slice.samples else { panic!("8 bits") };
    let shares = [0.5, 0.7, 0.8];
    let lit = |(at, &sample): (usize, &u8)| (shares[at % 3] * (255.0 / gain - f64::from(sample))).round() as u8;
    Raster { samples: Samples::Eight(samples.iter().enumerate().map(lit).collect()), ..slice.clone() }
}

/// The slices of `case` under another lamp.
fn under_other_lamp(case: &Rendered) -> Vec<Raster> {
    case.slices.iter().zip(&case.plan.slices).map(|(slice, plan)| other_lamp(slice, plan.gain)).collect()
}

fn plan(rendered: &Rendered, method: Method) -> Plan {
    Plan { method, ..rendered.plan.clone() }
}

fn case(scene: &Scene, seed: u64) -> Rendered {
    rendered(&Rig { seed, ..Rig::sized(480, 320, 11) }, scene, Light::Front)
}

/// The fused front light, and a further light.
fn both(front: &[Raster], light: &[Raster], plan: &Plan) -> (Fused, FusedLight) {
    let (folder, request) =
        (std::env::temp_dir(), FusionRequest { decision: true, metrics: true, ..Default::default() });
    let fused = fuse(&front, plan, &request, &folder, &NoControl).unwrap();
    let decision = fused.decision.as_ref().expect("it was requested");
    let light = fuse_further_light(&light, plan, decision, &request, &folder, &NoControl).unwrap();
    (fused, light)
}

/// The pixels within 8 px of a depth step, and all others but a margin.
fn edges(truth: &Plane<f32>) -> [Plane<u8>; 2] {
    let depth = |x: usize, y: usize| Some(truth.at(x, y)).filter(|slice| !slice.is_nan()).unwrap_or(99.0);
    let (right, bottom) = (truth.width - 1, truth.height - 1);
    let is_step = |x: usize, y: usize| {
        let here = depth(x, y);
        (here - depth((x + 1).min(right), y)).abs() > 1.0 || (here - depth(x, (y + 1).min(bottom))).abs() > 1.0
    };
    let step = Plane::from_fn(truth.width, truth.height, is_step);
    let near_step = |x: usize, y: usize| {
        (y.saturating_sub(8)..(y + 9).min(bottom))
            .any(|v| step.row(v)[x.saturating_sub(8)..(x + 9).min(right)].iter().any(|&step| step))
    };
    let counted = |x: usize, y: usize| (16..right - 16).contains(&x) && (16..bottom - 16).contains(&y);
    [true, false].map(|edge| {
        let is_of = |x: usize, y: usize| counted(x, y) && near_step(x, y) == edge;
        Plane::from_fn(truth.width, truth.height, |x, y| if is_of(x, y) { 255 } else { 0 })
    })
}

fn as_near_as_alone(scenes: impl IntoIterator<Item = (Scene, u64)>) {
    for (scene, seed) in scenes {
        let case = case(&scene, seed);
        let light = under_other_lamp(&case);
        let (masks, truth) = (edges(&case.truth.slice), other_lamp(&case.truth.sharp, 1.0));
        let score =
            |picture: &Raster| masks.each_ref().map(|mask| psnr(&picture.luma(), &truth.luma(), Some(mask)).unwrap());
        for method in Method::ALL {
            let (_, other) = both(&case.slices, &light, &plan(&case, method));
            let alone = fused(&light, &plan(&case, method));
            let (of_light, alone) = (score(&other.image), score(&alone.image));
            println!("seed {seed} {method:?}: edges and elsewhere {of_light:.2?} dB, fused by itself {alone:.2?} dB");
            // a pyramid has fewer seams at edges than a mosaic of the sharpest slices
            let least = if method == Method::HaloCorrected { [0.3, 0.8] } else { [1.6, 1.5] };
            for (of_light, (alone, least)) in of_light.iter().zip(alone.iter().zip(least)) {
                assert!(*of_light > alone - least, "seed {seed} {method:?}: {of_light:.2} dB, by itself {alone:.2} dB");
            }
        }
    }
}

#[test]
fn a_further_light_is_as_near_to_its_truth_as_if_it_were_fused_by_itself() {
    as_near_as_alone([(Scene::plates(3), 5)]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_further_lights_are_as_near_as_if_it_were_fused_by_itself() {
    as_near_as_alone([(Scene::insect(2), 6), (Scene::flower(2), 7), (Scene::plates(8), 8)]);
}

#[test]
fn a_light_without_detail_shows_the_slices_that_the_front_light_chose() {
    let case = case(&Scene::insect(2), 6);
    // the gains of the profile would change these levels
    let level = |plan: &Plan| Plan {
        slices: plan.slices.iter().map(|of| SlicePlan { gain: 1.0, ..*of }).collect(),
        ..plan.clone()
    };
    let grey = |slice: usize| Raster::eight(480, 320, 1, vec![20 * slice as u8 + 10; 480 * 320]);
    let light: Vec<Raster> = (0..case.slices.len()).map(grey).collect();
    for method in Method::ALL {
        let (front, light) = both(&case.slices, &light, &level(&plan(&case, method)));
        let Samples::Eight(samples) = &light.image.samples else { panic!("8 bits") };
        assert_eq!((light.image.channels, samples.len()), (1, 480 * 320));
        let near = samples.iter().zip(&front.index.data).filter(|(sample, index)| {
            let slice = (f32::from(**sample) - 10.0) / 20.0;
            (slice - f32::from(**index)).abs() <= 1.5
        });
        let share = near.count() as f64 / samples.len() as f64;
        // without a decision map, what is smooth comes from any slice
        let least = if method == Method::HaloCorrected { 0.95 } else { 0.8 };
        println!("{method:?}: {share:.3}");
        assert!(share > least, "{method:?}: {share}");
        assert_eq!(light.alignment.expect("it was requested").residual_p50_px, None, "there is nothing to compare");
    }
}

#[test]
fn slices_of_a_further_light_that_do_not_fit_the_profile_show_in_its_alignment() {
    let case = case(&Scene::insect(2), 6);
    let plan = plan(&case, Method::HaloCorrected);
    let moved = |slice: usize, raster: &Raster| {
        let Samples::Eight(samples) = &raster.samples else { panic!("8 bits") };
        let at = |at: usize| samples[(at + 3 * slice).min(samples.len() - 1 - (samples.len() - 1 - at) % 3)];
        Raster { samples: Samples::Eight((0..samples.len()).map(at).collect()), ..raster.clone() }
    };
    let drifted: Vec<Raster> = case.slices.iter().enumerate().map(|(slice, raster)| moved(slice, raster)).collect();
    for (light, fits) in [(&case.slices, true), (&drifted, false)] {
        let (_, light) = both(&case.slices, light, &plan);
        let similarity = light.alignment.expect("it was requested").similarity.expect("the scene has texture");
        assert_eq!(!crate::quality::is_misfit(&similarity), fits, "{similarity:?}");
    }
}

#[test]
fn it_keeps_bits_and_channels_of_its_own_and_is_the_same_for_any_tile_and_threads() {
    let case = case(&Scene::plates(3), 5);
    let plan = plan(&case, Method::HaloCorrected);
    let deep = |slice: &Raster| {
        let Samples::Eight(samples) = &slice.samples else { panic!("8 bits") };
        Raster::sixteen(480, 320, 3, samples.iter().map(|&sample| u16::from(sample) * 257).collect())
    };
    let deep: Vec<Raster> = case.slices.iter().map(deep).collect();
    let (_, light) = both(&case.slices, &deep, &plan);
    assert_eq!((light.image.depth(), light.image.channels), (Depth::Sixteen, 3));
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let [one, four] = [1, 4].map(|threads| pool(threads).install(|| both(&case.slices, &case.slices, &plan).1));
    assert_eq!(one, four);
}

#[test]
fn a_decision_of_another_stack_is_refused_and_none_is_kept_unless_requested() {
    let case = case(&Scene::plates(3), 5);
    let plan = plan(&case, Method::Pyramid);
    let fused = fused(&case.slices, &plan);
    assert_eq!(fused.decision, None);
    let (folder, request) = (std::env::temp_dir(), FusionRequest::default());
    let slices = case.slices.as_slice();
    for decision in [
        Decision::by_sharpest(&Arc::new(Plane::filled(480, 320, 0)), 10),
        Decision::by_sharpest(&Arc::new(Plane::filled(320, 480, 0)), 11),
    ] {
        let stop = fuse_further_light(&slices, &plan, &decision, &request, &folder, &NoControl).unwrap_err();
        assert!(matches!(stop, Interrupted::Failed(error) if error.detail.contains("of another stack")));
    }
}
