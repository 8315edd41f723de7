//! The focus range of rendered stacks: whether the object extends beyond an end of the stack, by the map of each
//! method.

use super::{
    rendered::{Rendered, rendered},
    *,
};
use crate::synth::{Light, Rig, Scene};

/// `plates(seed)` taken by `rig` without the first and the last `missing` slices, fused by `method`: whether the range
/// is too short near and far.
fn too_short(rig: &Rig, seed: u64, missing: usize, method: Method) -> [Option<bool>; 2] {
    let rig = Rig { seed, softness_px: 0.7, ..rig.clone() };
    let Rendered { slices, plan, truth } = rendered(&rig, &Scene::plates(seed), Light::Front);
    let kept = missing..slices.len() - missing;
    let plan = Plan { method, reference: plan.reference - missing, slices: plan.slices[kept.clone()].to_vec(), ..plan };
    let request = FusionRequest { metrics: true, object: Some(&truth.mask), shown: None, decision: false };
    let folder = std::env::temp_dir();
    let focus = fuse(&&slices[kept], &plan, &request, &folder, &NoControl).unwrap().quality.unwrap().focus;
    [focus.range_too_short_near, focus.range_too_short_far]
}

#[test]
fn plates_that_reach_both_ends_of_the_stack_do_not_extend_beyond_them() {
    assert_eq!(too_short(&Rig::sized(400, 266, 11), 5, 0, Method::Guided), [Some(false); 2]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_plates_that_reach_both_ends_of_the_stack_do_not_extend_beyond_them() {
    assert_eq!(too_short(&Rig::sized(400, 300, 13), 2, 0, Method::Guided), [Some(false); 2]);
}

#[test]
fn plates_extend_beyond_both_ends_when_slices_are_missing_there() {
    let too_short = too_short(&Rig::sized(300, 225, 13), 2, 2, Method::Guided);
    assert_eq!(too_short, [Some(true); 2]);
}
