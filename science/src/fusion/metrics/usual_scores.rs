//! Usual scores of fused stacks, from which the limits in `docs/METRICS.md` are taken.

use super::*;
use crate::{
    fusion::{
        FusionRequest, Plan, SlicePlan, align, fuse, method::focus_measure, sample_format::FormattedSlices,
        tests::rendered::slice_plans, tiles,
    },
    imaging::{Raster, Samples},
    synth::{Light, Rig, Stage, scene::SCENES},
    types::{NoControl, fusion_options::Method, metrics::FusionMetrics},
};

/// Scores of the fused image and of the true image, which no method can exceed, within the object.
fn scores(rig: &Rig, stage: &Stage, method: Method) -> [FusionMetrics; 2] {
    let slices: Vec<Raster> = (0..rig.slices()).map(|i| stage.render(Light::Front, i)).collect();
    let truth = stage.truth();
    let without_rail = |slice: SlicePlan| SlicePlan { rail_mm: None, ..slice };
    let planned = slice_plans(rig).into_iter().map(without_rail).collect();
    let plan = Plan { method, slices: planned, ..Plan::aligned(rig.width, rig.height, rig.slices()) };
    let request = FusionRequest { metrics: true, object: Some(&truth.mask), shown: None, decision: false };
    let (folder, slices) = (std::env::temp_dir(), &slices[..]);
    let fused = fuse(&slices, &plan, &request, &folder, &NoControl).unwrap();
    let run = Run {
        slices: FormattedSlices::open(&slices, &plan).unwrap(),
        plan: &plan,
        request: &request,
        scratch_dir: &folder,
        control: &NoControl,
        tile: tiles::TILE,
        decision_map: None,
    };
    let aligned = align::align::<u8, 3>(&run, focus_measure(&plan), None).unwrap();
    let blocks = Blocks::of(rig.width, rig.height, request.object);
    [&fused.image, &truth.sharp].map(|image| {
        let Samples::Eight(samples) = &image.samples else { panic!("8 bits") };
        score::<u8, 3>(&run, &aligned, &blocks, samples).unwrap().metrics()
    })
}

/// Prints the scores of all scenes by all methods, with two lenses, with and without noise: the figures on usual scores
/// in `docs/METRICS.md`.
#[test]
#[ignore = "a table for the documentation, minutes long: --ignored --nocapture"]
fn table_of_usual_scores() {
    println!("   scene seed soft noise    method     q_g    q_w retention | truth q_g    q_w retention");
    for (name, make) in SCENES {
        for (seed, softness_px, noise) in [(1, 0.0, 1.0), (2, 0.0, 1.0), (1, 0.7, 1.0), (2, 0.7, 1.0), (1, 0.7, 0.0)] {
            let rig = Rig { seed, softness_px, noise, ..Rig::sized(600, 400, 13) };
            let stage = Stage::new(&rig, &make(seed));
            for method in Method::ALL {
                let [fused, truth] = scores(&rig, &stage, method).map(|m| {
                    [m.q_g_top, m.q_w_top, m.sharpness_retention]
                        .map(|v| format!("{:>7.3}", v.unwrap_or(f64::NAN)))
                        .join("")
                });
                println!(
                    "{name:>8} {seed:>4} {softness_px:>4} {noise:>5} {:>9} {fused}   | {truth}",
                    format!("{method:?}")
                );
            }
        }
    }
}
