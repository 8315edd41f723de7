//! A rendered stack, and the faults that are made in it.

use pinstack_science::{
    fusion::{Fused, FusionRequest, Plan, SlicePlan, fuse},
    imaging::{Plane, Raster, Samples},
    synth::{Light, Rig, Scene, Stage},
    types::{Homography, NoControl, fusion_options::Method},
};

/// A rendered stack with its plan.
#[derive(Clone)]
pub struct Stack {
    pub slices: Vec<Raster>,
    pub plan: Plan,
    pub object: Plane<u8>,
}

impl Stack {
    /// The front-lit slices of a scene, and the true geometry and brightness of the rig.
    pub fn of(rig: &Rig, scene: &Scene) -> Self {
        let stage = Stage::new(rig, scene);
        let slices = (0..rig.slices()).map(|i| stage.render(Light::Front, i)).collect();
        Self { slices, plan: true_plan(rig), object: stage.mask() }
    }

    pub fn count(&self) -> usize {
        self.slices.len()
    }

    pub fn fused(&self) -> Fused {
        fused(&self.slices, &self.plan, Some(&self.object))
    }

    /// Only the slices for which `keep` is true, and their part of the plan.
    pub fn only(mut self, keep: impl Fn(usize) -> bool) -> Self {
        let kept: Vec<usize> = (0..self.count()).filter(|&n| keep(n)).collect();
        self.slices = kept.iter().map(|&n| self.slices[n].clone()).collect();
        self.plan.slices = kept.iter().map(|&n| self.plan.slices[n]).collect();
        self.plan.reference = kept.len() / 2;
        self
    }

    pub fn swapped(mut self, a: usize, b: usize) -> Self {
        self.slices.swap(a, b);
        self
    }

    /// The samples of a slice multiplied by a factor per channel.
    pub fn scaled(mut self, slice: usize, by: [f32; 3]) -> Self {
        let Samples::Eight(samples) = &mut self.slices[slice].samples else { panic!("8 bits expected") };
        for pixel in samples.chunks_exact_mut(3) {
            for (sample, by) in pixel.iter_mut().zip(by) {
                *sample = (f32::from(*sample) * by).round().min(255.0) as u8;
            }
        }
        self
    }

    /// Each homography followed by a similarity (scale, shift) about the centre of the image.
    pub fn with_profile_error(mut self, left: impl Fn(f64) -> (f64, [f64; 2])) -> Self {
        let middle = [self.plan.width, self.plan.height].map(|side| (side as f64 - 1.0) / 2.0);
        for (n, slice) in self.plan.slices.iter_mut().enumerate() {
            let (scale, shift) = left(n as f64);
            let shift = [0, 1].map(|axis| middle[axis] * (1.0 - scale) + shift[axis]);
            slice.homography =
                slice.homography.then(&Homography::similarity(scale, shift)).expect("an invertible homography");
        }
        self
    }
}

/// The plan with the true geometry and brightness of `rig`, and the method of a job by default.
pub fn true_plan(rig: &Rig) -> Plan {
    let slice =
        |i: usize| SlicePlan { homography: rig.homography(i), gain: rig.gain(i), rail_mm: rig.rail_mm.get(i).copied() };
    Plan {
        slices: (0..rig.slices()).map(slice).collect(),
        reference: rig.reference,
        near_first: Some(true),
        method: Method::HaloCorrected,
        ..Plan::aligned(rig.width, rig.height, rig.slices())
    }
}

/// Fuses slices; with `object`, measures the metrics on it.
pub fn fused(slices: &[Raster], plan: &Plan, object: Option<&Plane<u8>>) -> Fused {
    let request = FusionRequest { metrics: object.is_some(), object, shown: None, decision: false };
    fuse(&slices, plan, &request, &std::env::temp_dir(), &NoControl).expect("fused")
}
