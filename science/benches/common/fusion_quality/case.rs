//! A scene and a rig, rendered as a stack with its truth, and fused.

use pinstack_science::{
    fusion::{Fused, FusionRequest, Plan, SlicePlan, UNCOVERED, fuse, fuse_by_decision_map},
    imaging::{Coverage, Plane, Raster, Sample, Samples, warp::Warp},
    synth::{Light, Rig, Stage, Truth, scene::SceneFromSeed},
    types::{
        NoControl,
        fusion_options::{GuidedParams, Method},
    },
};
use rayon::prelude::*;

pub const SLICES: usize = 13;

/// The stack to render.
#[derive(Debug, Clone)]
pub struct Case {
    pub scene: &'static str,
    pub make: SceneFromSeed,
    pub seed: u64,
    pub size: (usize, usize),
    /// Factor on the blur of the rig.
    pub blur: f64,
    /// Softness of the lens, px.
    pub softness: f64,
    /// Whether the plan says which end of the stack is near.
    pub near_end_known: bool,
}

impl Case {
    pub fn name(&self) -> String {
        format!("{} {} {}x{} blur {}", self.scene, self.seed, self.size.0, self.size.1, self.blur)
    }

    pub fn render(&self) -> Stack {
        let plain = Rig::sized(self.size.0, self.size.1, SLICES);
        let mut rig = Rig { seed: self.seed, softness_px: self.softness, ..plain };
        rig.f_number /= self.blur;
        let stage = Stage::new(&rig, &(self.make)(self.seed));
        let slices = (0..SLICES).map(|i| stage.render(Light::Front, i)).collect();
        Stack { truth: stage.truth(), slices, rig, near_end_known: self.near_end_known }
    }
}

/// A rendered stack and its truth.
pub struct Stack {
    pub rig: Rig,
    pub slices: Vec<Raster>,
    pub truth: Truth,
    near_end_known: bool,
}

impl Stack {
    fn plan(&self, method: Method) -> Plan {
        let slice = |i: usize| SlicePlan {
            homography: self.rig.homography(i),
            gain: self.rig.gain(i),
            rail_mm: Some(self.rig.rail_mm[i]),
        };
        Plan {
            width: self.rig.width,
            height: self.rig.height,
            slices: (0..self.slices.len()).map(slice).collect(),
            reference: self.rig.reference,
            method,
            params: GuidedParams::default(),
            near_first: self.near_end_known.then_some(true),
            height_map: None,
            distortion: None,
            lateral_colour: None,
        }
    }

    pub fn fuse(&self, method: Method) -> Fused {
        let (slices, folder) = (&self.slices[..], std::env::temp_dir());
        let request = FusionRequest::default();
        fuse(&slices, &self.plan(method), &request, &folder, &NoControl).expect("the stack can be fused")
    }

    /// The default method with the true decision map on the object, and its own on the background: there a slice in
    /// which the silhouette is in focus is better than the last one, which it covers with its blur.
    pub fn fuse_by_truth(&self) -> Fused {
        let (slices, folder) = (&self.slices[..], std::env::temp_dir());
        let slice = |slice: &f32| if slice.is_nan() { UNCOVERED } else { slice.round().max(0.0) as u16 };
        let of = &self.truth.slice;
        let map = Plane { width: of.width, height: of.height, data: of.data.iter().map(slice).collect() };
        let plan = self.plan(Method::HaloCorrected);
        fuse_by_decision_map(&slices, &plan, &map, &folder, &NoControl).expect("the stack can be fused")
    }

    /// The pixels that all slices cover. Elsewhere the slice in focus may be missing, and no method can show it.
    pub fn covered(&self) -> Vec<bool> {
        let size = (self.rig.width, self.rig.height);
        let mut covered = vec![true; size.0 * size.1];
        for i in 0..self.slices.len() {
            let warp = Warp::new(&self.rig.homography(i), self.rig.gain(i), size, size).expect("a sane rig");
            for (y, row) in covered.chunks_exact_mut(size.0).enumerate() {
                let span = warp.coverage().span(y);
                row.iter_mut().enumerate().for_each(|(x, covered)| *covered &= span.contains(&x));
            }
        }
        covered
    }

    /// The slices as other programs get them: warped by the true homographies, with equal brightness. Uncovered pixels
    /// are filled from the nearest covered pixel, which suits these programs better than black.
    pub fn warped(&self) -> Vec<Raster> {
        let size = (self.rig.width, self.rig.height);
        (0..self.slices.len())
            .into_par_iter()
            .map(|i| {
                let warp = Warp::new(&self.rig.homography(i), self.rig.gain(i), size, size).expect("a sane rig");
                let mut samples = warp.apply(samples(&self.slices[i]).to_vec(), 3);
                fill(&mut samples, size.0, warp.coverage());
                Raster::eight(size.0, size.1, 3, samples)
            })
            .collect()
    }
}

/// The samples of a rendered image: 8-bit RGB.
pub fn samples(raster: &Raster) -> &[u8] {
    match &raster.samples {
        Samples::Eight(_) => u8::of(&raster.samples).unwrap_or_default(),
        Samples::Sixteen(_) => panic!("the rigs of this bench have 8 bits"),
    }
}

fn fill(samples: &mut [u8], width: usize, coverage: &Coverage) {
    let height = coverage.height();
    let covered: Vec<usize> = (0..height).filter(|&y| !coverage.span(y).is_empty()).collect();
    let source = samples.to_vec();
    for y in 0..height {
        let Some(&row) = covered.iter().min_by_key(|row| row.abs_diff(y)) else { return };
        let span = coverage.span(row);
        for x in (0..width).filter(|x| row != y || !span.contains(x)) {
            let from = (row * width + x.clamp(span.start, span.end - 1)) * 3;
            samples[(y * width + x) * 3..][..3].copy_from_slice(&source[from..from + 3]);
        }
    }
}
