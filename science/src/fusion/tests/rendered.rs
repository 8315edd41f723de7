//! Rendered stacks with the true plan and the true image.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, OnceLock, PoisonError},
};

use crate::{
    fusion::{Plan, SlicePlan},
    imaging::Raster,
    synth::{Light, Rig, Scene, Stage, Truth},
};

/// A rendered stack.
#[derive(Clone)]
pub(crate) struct Rendered {
    pub slices: Vec<Raster>,
    pub plan: Plan,
    pub truth: Truth,
}

/// Stacks of this process, by rig, scene and light. To render one takes longer than to fuse it, and several tests take
/// the same. A few megabytes each.
static RENDERED: Mutex<Option<HashMap<String, Arc<OnceLock<Rendered>>>>> = Mutex::new(None);

/// `scene` taken by `rig` under `light`, with the true geometry of the rig as its plan. Rendered once per process.
pub(crate) fn rendered(rig: &Rig, scene: &Scene, light: Light) -> Rendered {
    let mut all = RENDERED.lock().unwrap_or_else(PoisonError::into_inner);
    let name = format!("{rig:?} {scene:?} {light:?}");
    let stack = Arc::clone(all.get_or_insert_default().entry(name).or_default());
    // other stacks can be rendered meanwhile
    drop(all);
    let render = || {
        let stage = Stage::new(rig, scene);
        let slices = (0..rig.slices()).map(|i| stage.render(light, i)).collect();
        Rendered { slices, plan: true_plan(rig), truth: stage.truth() }
    };
    stack.get_or_init(render).clone()
}

/// The plan with the true geometry and brightness of `rig`.
pub(crate) fn true_plan(rig: &Rig) -> Plan {
    Plan {
        slices: slice_plans(rig),
        reference: rig.reference,
        near_first: Some(true),
        ..Plan::aligned(rig.width, rig.height, rig.slices())
    }
}

/// The true geometry and brightness of the slices of `rig`.
pub(crate) fn slice_plans(rig: &Rig) -> Vec<SlicePlan> {
    let slice =
        |i: usize| SlicePlan { homography: rig.homography(i), gain: rig.gain(i), rail_mm: rig.rail_mm.get(i).copied() };
    (0..rig.slices()).map(slice).collect()
}
