//! The error of scores that are measured in sampled blocks, against scores of every pixel.

use super::*;
use crate::{
    fusion::{
        FusionRequest, Plan, SlicePlan, align, guided, method, sample_format::FormattedSlices,
        tests::rendered::slice_plans, tiles,
    },
    imaging::Raster,
    synth::{Light, Rig, Scene, Stage},
    types::{NoControl, metrics::FusionMetrics},
};

/// Scores of a fused stack of `scene`: in the sampled blocks, and in all blocks.
fn sampled_and_whole(rig: &Rig, scene: &Scene, masked: bool) -> [FusionMetrics; 2] {
    let stage = Stage::new(rig, scene);
    let slices: Vec<Raster> = (0..rig.slices()).map(|i| stage.render(Light::Front, i)).collect();
    let object = stage.truth().mask;
    let without_rail = |slice: SlicePlan| SlicePlan { rail_mm: None, ..slice };
    let planned = slice_plans(rig).into_iter().map(without_rail).collect();
    let plan = Plan { slices: planned, ..Plan::aligned(rig.width, rig.height, rig.slices()) };
    let request = FusionRequest { metrics: true, object: masked.then_some(&object), shown: None, decision: false };
    let (folder, slices) = (std::env::temp_dir(), &slices[..]);
    let run = Run {
        slices: FormattedSlices::open(&slices, &plan).unwrap(),
        plan: &plan,
        request: &request,
        scratch_dir: &folder,
        control: &NoControl,
        tile: tiles::TILE,
        decision_map: None,
    };
    let aligned = align::align::<u8, 3>(&run, method::focus_measure(&plan), None).unwrap();
    let fused = guided::blend::<u8, 3>(&run, &aligned).unwrap().pixels;
    let few = Blocks::of(rig.width, rig.height, request.object);
    let row = |y: usize| (0..rig.width).step_by(400).map(move |x| (x, y));
    let all = (0..rig.height).step_by(400).flat_map(row).map(|(x, y)| Rect {
        x,
        y,
        width: 400.min(rig.width - x),
        height: 400.min(rig.height - y),
    });
    let all = Blocks { rects: all.collect() };
    let pixels = |blocks: &Blocks| blocks.rects.iter().map(|rect| rect.width * rect.height).sum::<usize>();
    assert!(pixels(&few) * 2 < pixels(&all), "the canvas is too small to be sampled");
    [few, all].map(|blocks| score::<u8, 3>(&run, &aligned, &blocks, &fused).unwrap().metrics())
}

/// Errors of the sampled scores: absolute for `q_g_top`, `q_w_top` and `overshoot_fraction`, relative for the others.
fn errors([sampled, whole]: &[FusionMetrics; 2]) -> [f64; 6] {
    let numbers = |m: &FusionMetrics| {
        [m.q_g_top, m.q_w_top, m.sharpness_retention, m.spatial_frequency, m.tenengrad, m.overshoot_fraction]
            .map(Option::unwrap)
    };
    let (found, truth) = (numbers(sampled), numbers(whole));
    std::array::from_fn(|i| match i {
        0 | 1 | 5 => found[i] - truth[i],
        _ => found[i] / truth[i] - 1.0,
    })
}

#[test]
fn sampled_scores_are_within_the_documented_error() {
    let rig = Rig::sized(900, 600, 4);
    let errors = errors(&sampled_and_whole(&rig, &Scene::insect(2), true));
    let documented = [0.02, 0.01, 0.03, 0.15, 0.3, 0.01];
    assert!(errors.iter().zip(documented).all(|(error, most)| error.abs() < most), "{errors:?}");
}

/// Prints the error of sampled scores by scene and seed, and its root mean square: the figures on sampling in
/// `docs/METRICS.md`.
#[test]
#[ignore = "a table for the documentation, minutes long: --ignored --nocapture"]
fn table_of_sampling_errors() {
    println!("   scene  seed  mask    q_g     q_w  retention  sf      tenengrad  overshoot");
    let mut squares = ([[0.0; 6]; 2], 0.0);
    for seed in 1..=4 {
        let rig = Rig { seed, ..Rig::sized(1600, 1200, 5) };
        let scenes =
            [("insect", Scene::insect(seed)), ("flower", Scene::flower(seed)), ("plates", Scene::plates(seed))];
        for (name, scene) in scenes {
            for masked in [false, true] {
                let errors = errors(&sampled_and_whole(&rig, &scene, masked));
                println!("{name:>8} {seed:>5} {masked:>6} {}", errors.map(|e| format!("{e:+.4}")).join("  "));
                let sums = &mut squares.0[usize::from(masked)];
                sums.iter_mut().zip(errors).for_each(|(sum, error)| *sum += error * error);
            }
            squares.1 += 1.0;
        }
    }
    for (name, sums) in ["whole", "object"].into_iter().zip(squares.0) {
        println!("rms, {name}: {}", sums.map(|sum| format!("{:.4}", (sum / squares.1).sqrt())).join("  "));
    }
}
