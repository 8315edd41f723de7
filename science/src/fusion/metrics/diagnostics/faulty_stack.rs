//! A rendered stack, and the faults that it can be given.

use crate::{
    fusion::{Fused, FusionRequest, Plan, fuse, tests::rendered::true_plan},
    imaging::{Plane, Raster, Samples},
    synth::{Light, Rig, Scene, Stage},
    types::{Homography, NoControl, fusion_options::Method, metrics::Finding},
};

/// A rendered stack with its plan, possibly with a fault.
#[derive(Clone)]
pub(super) struct Stack {
    pub(super) slices: Vec<Raster>,
    pub(super) plan: Plan,
    pub(super) object: Plane<u8>,
}

impl Stack {
    pub(super) fn of(rig: &Rig, scene: &Scene) -> Self {
        let stage = Stage::new(rig, scene);
        let slices = (0..rig.slices()).map(|i| stage.render(Light::Front, i)).collect();
        // the method of a job by default
        Self { slices, plan: Plan { method: Method::HaloCorrected, ..true_plan(rig) }, object: stage.mask() }
    }

    pub(super) fn count(&self) -> usize {
        self.slices.len()
    }

    pub(super) fn fused(&self, masked: bool) -> Fused {
        let request =
            FusionRequest { metrics: true, object: masked.then_some(&self.object), shown: None, decision: false };
        fuse(&&self.slices[..], &self.plan, &request, &std::env::temp_dir(), &NoControl).unwrap()
    }

    pub(super) fn findings(&self, masked: bool) -> Vec<Finding> {
        self.fused(masked).quality.unwrap().findings
    }

    /// Only the slices for which `keep` is true, and their part of the plan.
    pub(super) fn only(mut self, keep: impl Fn(usize) -> bool) -> Self {
        let kept: Vec<usize> = (0..self.count()).filter(|&n| keep(n)).collect();
        let pick = |n: &usize| self.slices[*n].clone();
        self.slices = kept.iter().map(pick).collect();
        self.plan.slices = kept.iter().map(|&n| self.plan.slices[n]).collect();
        self.plan.reference = kept.len() / 2;
        self
    }

    pub(super) fn swapped(mut self, a: usize, b: usize) -> Self {
        self.slices.swap(a, b);
        self
    }

    pub(super) fn doubled(mut self, slice: usize) -> Self {
        self.slices[slice] = self.slices[slice - 1].clone();
        self
    }

    /// The samples of a slice multiplied by a factor per channel.
    pub(super) fn scaled(mut self, slice: usize, by: [f32; 3]) -> Self {
        let Samples::Eight(samples) = &mut self.slices[slice].samples else { panic!("8 bits expected") };
        for pixel in samples.chunks_exact_mut(3) {
            pixel
                .iter_mut()
                .zip(by)
                .for_each(|(sample, by)| *sample = (f32::from(*sample) * by).round().min(255.0) as u8);
        }
        self
    }

    /// Each homography followed by a similarity (scale, shift) about the centre of the image.
    pub(super) fn with_profile_error(mut self, left: impl Fn(f64) -> (f64, [f64; 2])) -> Self {
        let middle = [(self.plan.width as f64 - 1.0) / 2.0, (self.plan.height as f64 - 1.0) / 2.0];
        for n in 0..self.count() {
            let (scale, shift) = left(n as f64);
            let shift = [0, 1].map(|axis: usize| middle[axis] * (1.0 - scale) + shift[axis]);
            let moved = self.plan.slices[n].homography.then(&Homography::similarity(scale, shift)).unwrap();
            self.plan.slices[n].homography = moved;
        }
        self
    }
}

/// A fault: the code of the finding that must report it, and how a stack gets it.
type Fault = (&'static str, fn(Stack) -> Stack);

/// All faults that are simulated. The first, without a code, is a stack without a fault.
pub(super) const FAULTS: [Fault; 15] = [
    ("", |stack| stack),
    ("range_too_short_near", |stack| {
        let n = stack.count();
        stack.only(|i| i >= n / 3)
    }),
    ("range_too_short_far", |stack| {
        let n = stack.count();
        stack.only(|i| i < n - n / 3)
    }),
    ("coverage_gap", |stack| {
        let n = stack.count();
        stack.only(|i| i < n / 2 - 1 || i > n / 2 + 1)
    }),
    ("uneven_step", |stack| {
        let n = stack.count();
        stack.only(|i| i != n / 2)
    }),
    ("slices_out_of_order", |stack| {
        let n = stack.count();
        stack.swapped(n / 2, n / 2 + 2)
    }),
    ("duplicate_slice", |stack| {
        let n = stack.count();
        stack.doubled(n / 2)
    }),
    ("exposure_flicker", |stack| {
        let n = stack.count();
        stack.scaled(n / 2 + 1, [0.93; 3])
    }),
    ("white_balance_drift", |stack| {
        let n = stack.count();
        stack.scaled(n / 2 - 1, [1.04, 0.985, 1.0])
    }),
    ("exposure_drift", |stack| {
        let n = stack.count();
        (0..n).fold(stack, |s, i| s.scaled(i, [1.0 - 0.2 * i as f32 / n as f32; 3]))
    }),
    ("slice_misaligned", |stack| {
        let n = stack.count() / 2;
        stack.with_profile_error(|i| (1.0, if i == n as f64 { [2.0, -1.0] } else { [0.0; 2] }))
    }),
    ("picture_jumps", |stack| {
        let n = stack.count() / 2;
        stack.with_profile_error(|i| (1.0, if i >= n as f64 { [2.0, -1.0] } else { [0.0; 2] }))
    }),
    ("profile_misfit", |stack| {
        let n = stack.count() as f64;
        stack.with_profile_error(|i| (1.0 + 0.012 * (i / n - 0.5), [0.0; 2]))
    }),
    ("slices_reversed", |mut stack| {
        stack.slices.reverse();
        stack
    }),
    ("clipped", |stack| (0..stack.count()).fold(stack, |s, i| s.scaled(i, [3.0; 3]))),
];
