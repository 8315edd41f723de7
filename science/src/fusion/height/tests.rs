//! The height map against rendered truth, and by property.

use super::{HeightMap, axis::HeightAxis};
use crate::{
    fusion::{
        Fused, FusionRequest, Plan,
        run::Run,
        sample_format::FormattedSlices,
        tests::rendered::{Rendered, rendered},
    },
    imaging::{Plane, Raster},
    synth::{Light, Rig, Scene},
    types::{NoControl, fusion_options::Method},
};

fn fused(slices: &[Raster], plan: &Plan, object: Option<&Plane<u8>>, tile: usize) -> Fused {
    let (request, folder) =
        (FusionRequest { metrics: false, object, shown: None, decision: false }, std::env::temp_dir());
    let slices = FormattedSlices::open(&slices, plan).unwrap();
    Run { slices, plan, request: &request, scratch_dir: &folder, control: &NoControl, tile, decision_map: None }
        .fuse()
        .unwrap()
}

/// A plan with a height map in steps, 0 in the first slice.
fn in_steps(plan: Plan, method: Method) -> Plan {
    let axis = HeightAxis::steps(plan.slices.len(), 0, None);
    Plan { method, height_map: Some(axis), ..plan }
}

fn beetle() -> Rendered {
    let rig = Rig { seed: 4, softness_px: 0.7, ..Rig::sized(240, 160, 7) };
    rendered(&rig, &Scene::insect(4), Light::Front)
}

/// Root mean square of the errors of the heights, and of those of the index, over the pixels of the object with a
/// height whose index is on the right surface: within a step and a half of the truth.
fn errors(case: &Rendered, fused: &Fused, map: &HeightMap) -> [f64; 2] {
    let mut sums = [0.0, 0.0, 0.0];
    for (at, &truth) in case.truth.slice.data.iter().enumerate().filter(|(_, truth)| !truth.is_nan()) {
        let (x, y) = (at % map.values.width, at / map.values.width);
        if let Some((height, _)) = map.at(x, y) {
            let index = f64::from(fused.index.at(x, y));
            if (index - f64::from(truth)).abs() > 1.5 {
                continue;
            }
            sums[0] += (height - f64::from(truth)).powi(2);
            sums[1] += (index - f64::from(truth)).powi(2);
            sums[2] += 1.0;
        }
    }
    [sums[0], sums[1]].map(|sum| (sum / sums[2]).sqrt())
}

#[test]
fn it_is_nearer_to_the_truth_than_the_index_with_every_method() {
    let case = beetle();
    let object = case.truth.mask.clone();
    for method in Method::ALL {
        let plan = in_steps(case.plan.clone(), method);
        let fused = fused(&case.slices, &plan, Some(&object), 512);
        let map = fused.height_map.as_ref().unwrap();
        let [height, index] = errors(&case, &fused, map);
        println!("{method:?}: {height:.3} steps, index {index:.3}, {:.3} of the object", map.valid_fraction);
        assert!(height < 0.8 * index, "{method:?}: {height} against {index}");
        assert!(map.valid_fraction > 0.6, "{method:?}: {}", map.valid_fraction);
        let outside = object.data.iter().zip(&map.values.data).filter(|&(&object, &value)| object == 0 && value != 0);
        assert_eq!(outside.count(), 0, "nothing is known outside the object");
    }
}

#[test]
fn it_does_not_depend_on_threads_and_tiles() {
    let case = beetle();
    let plan = in_steps(case.plan.clone(), Method::Pyramid);
    let by = |threads: usize, tile: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fused(&case.slices, &plan, None, tile).height_map.unwrap())
    };
    let whole = by(1, 512);
    assert!(whole == by(3, 96));
}

#[test]
fn uneven_rail_positions_count_and_the_unit_changes_nothing_else() {
    let mut rig = Rig { seed: 5, softness_px: 0.7, noise: 0.5, ..Rig::sized(240, 160, 7) };
    let (first, last) = (rig.rail_mm[0], rig.rail_mm[6]);
    let uneven = [0.0, 0.7, 2.2, 3.0, 3.7, 5.2, 6.0];
    rig.rail_mm = uneven.map(|at| first + (last - first) * at / 6.0).to_vec();
    let case = rendered(&rig, &Scene::insect(5), Light::Front);
    let plan = Plan {
        height_map: Some(HeightAxis { heights: uneven.to_vec(), ..HeightAxis::steps(7, 0, None) }),
        method: Method::HaloCorrected,
        ..case.plan.clone()
    };
    let fused = fused(&case.slices, &plan, Some(&case.truth.mask), 512);
    let map = fused.height_map.as_ref().unwrap();
    let mut errors: Vec<f64> = (0..240 * 160)
        .filter_map(|at| {
            let (x, y) = (at % 240, at / 240);
            let slice = f64::from(case.truth.slice.at(x, y));
            let right = (f64::from(fused.index.at(x, y)) - slice).abs() < 1.0;
            let (height, _) = map.at(x, y).filter(|_| right)?;
            let below = (slice as usize).min(5);
            let truth = uneven[below] + (slice - below as f64) * (uneven[below + 1] - uneven[below]);
            Some((height - truth).abs())
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    assert!(errors[errors.len() / 2] < 0.2, "median error {} mean steps", errors[errors.len() / 2]);
}

#[test]
fn a_stack_without_detail_or_of_one_slice_has_no_heights() {
    let flat = vec![Raster::eight(40, 30, 1, vec![90; 1200]); 3];
    for slices in [&flat[..], &flat[..1]] {
        let plan = in_steps(Plan::aligned(40, 30, slices.len()), Method::HaloCorrected);
        let map = fused(slices, &plan, None, 512).height_map.unwrap();
        assert!(map.values.data.iter().all(|&value| value == 0));
        assert_eq!((map.median_sigma, map.valid_fraction), (None, 0.0));
    }
}
