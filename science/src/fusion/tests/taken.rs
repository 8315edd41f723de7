//! Rendered stacks with the plan and the truth that belong to them.

use crate::{
    fusion::Plan,
    imaging::Raster,
    synth::{Light, Rig, Scene, Stage, Truth},
};

/// A stack of which everything is known.
pub(crate) struct Taken {
    pub slices: Vec<Raster>,
    pub plan: Plan,
    pub truth: Truth,
}

/// `scene` taken by `rig` under `light`, with a profile that is true.
pub(crate) fn taken(rig: &Rig, scene: &Scene, light: Light) -> Taken {
    let stage = Stage::new(rig, scene);
    let plan = Plan {
        homographies: (0..rig.slices()).map(|i| rig.homography(i)).collect(),
        gains: (0..rig.slices()).map(|i| rig.gain(i)).collect(),
        reference: rig.reference,
        rail: Some(rig.rail_mm.clone()),
        near_first: Some(true),
        ..Plan::aligned(rig.width, rig.height, rig.slices())
    };
    Taken { slices: (0..rig.slices()).map(|i| stage.render(light, i)).collect(), plan, truth: stage.truth() }
}
