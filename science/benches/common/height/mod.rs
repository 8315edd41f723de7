//! Parts of the bench of height maps: stacks with their truth, scores, and the relief of image files.

use std::{fmt, path::Path};

use pinstack_science::{
    fusion::{
        Fused, FusionRequest, Plan, SlicePlan, fuse,
        height::{axis::HeightAxis, relief::relief},
    },
    imaging::{
        Plane, Raster,
        codec::{Limits, Metadata, decode, encode_png},
        filter::focus::{FocusEnergy, Rows},
    },
    synth::{Light, Rig, Stage, Truth, scene::SceneFromSeed},
    types::{NoControl, fusion_options::Method},
};

const SIZE: (usize, usize) = (600, 400);
/// Softness of the lens, px.
const SOFTNESS: f64 = 0.7;
/// Focus energy of the truth, squared grey levels, from which a pixel has texture.
const TEXTURED: f32 = 4.0;
/// Distance, px, up to which a pixel is near a depth step or an outline.
const NEAR: usize = 8;

/// The stack to render.
pub struct Case {
    pub make: SceneFromSeed,
    pub seed: u64,
    pub slices: usize,
    /// Standard deviation of the noise, grey levels of 255.
    pub noise: f64,
    /// Factor on the blur of the rig.
    pub blur: f64,
}

/// A rendered stack.
pub struct Stack {
    rig: Rig,
    slices: Vec<Raster>,
    truth: Truth,
}

impl Case {
    pub fn render(&self) -> Stack {
        // the same range of focus and the same aperture for every number of slices
        let base = Rig::sized(SIZE.0, SIZE.1, 13);
        let plain = Rig::sized(SIZE.0, SIZE.1, self.slices);
        let f_number = base.f_number / self.blur;
        let rig = Rig { f_number, seed: self.seed, softness_px: SOFTNESS, noise: self.noise, ..plain };
        let stage = Stage::new(&rig, &(self.make)(self.seed));
        let slices = (0..self.slices).map(|i| stage.render(Light::Front, i)).collect();
        Stack { truth: stage.truth(), slices, rig }
    }
}

/// Where errors are measured.
#[derive(Clone, Copy, PartialEq)]
enum Region {
    Outside,
    Textured,
    Plain,
    Near,
}

impl Stack {
    fn regions(&self) -> Plane<Region> {
        let truth = &self.truth.slice;
        let (width, height) = (truth.width, truth.height);
        let step = |x: usize, y: usize| {
            let here = truth.at(x, y);
            let beside = [truth.at((x + 1).min(width - 1), y), truth.at(x, (y + 1).min(height - 1))];
            beside.iter().any(|beside| here.is_nan() != beside.is_nan() || (here - beside).abs() > 0.75)
        };
        let steps = Plane::from_fn(width, height, step);
        let energy = FocusEnergy::for_decision_map().plane(&self.truth.sharp.luma(), &mut Rows::default());
        Plane::from_fn(width, height, |x, y| {
            // a margin of the canvas is not covered by every slice
            let inside = (24..width - 24).contains(&x) && (24..height - 24).contains(&y);
            if !inside || truth.at(x, y).is_nan() {
                return Region::Outside;
            }
            let near = (y - NEAR..=y + NEAR).any(|v| steps.row(v)[x - NEAR..=x + NEAR].contains(&true));
            match near {
                true => Region::Near,
                false if energy.at(x, y) >= TEXTURED => Region::Textured,
                false => Region::Plain,
            }
        })
    }

    fn fuse(&self, method: Method) -> Fused {
        let rig = &self.rig;
        let slice =
            |i: usize| SlicePlan { homography: rig.homography(i), gain: rig.gain(i), rail_mm: Some(rig.rail_mm[i]) };
        let count = self.slices.len();
        let plan = Plan {
            slices: (0..count).map(slice).collect(),
            method,
            near_first: Some(true),
            height_map: Some(HeightAxis::steps(count, 0, None)),
            ..Plan::aligned(rig.width, rig.height, count)
        };
        let request = FusionRequest { metrics: false, object: Some(&self.truth.mask), shown: None, decision: false };
        fuse(&&self.slices[..], &plan, &request, &std::env::temp_dir(), &NoControl).expect("the stack can be fused")
    }

    /// Errors by `method`, by region.
    pub fn score(&self, method: Method) -> Score {
        let fused = self.fuse(method);
        let map = fused.height_map.expect("the plan asks for heights");
        let regions = self.regions();
        let mut score = Score::default();
        for (at, &truth) in self.truth.slice.data.iter().enumerate() {
            let (x, y) = (at % map.values.width, at / map.values.width);
            let part = match regions.at(x, y) {
                Region::Outside => continue,
                Region::Textured => 0,
                Region::Plain => 1,
                Region::Near => 2,
            };
            let errors = &mut score.0[part];
            let index = f64::from(fused.index.at(x, y)) - f64::from(truth);
            errors.index.push(index.abs());
            if let Some((height, sigma)) = map.at(x, y) {
                let error = (height - f64::from(truth)).abs();
                errors.height.push(error);
                errors.relative.push(error / sigma);
            }
        }
        score
    }
}

/// Errors of a region, steps.
#[derive(Default)]
struct Errors {
    index: Vec<f64>,
    height: Vec<f64>,
    /// Error / standard deviation.
    relative: Vec<f64>,
}

/// Errors in textured areas, plain areas, and near depth steps.
#[derive(Default)]
pub struct Score([Errors; 3]);

impl Score {
    pub const HEADER: &str = "\
| stack | method | region | index RMS | height RMS | index > 1 | height > 1 | covered | error / sigma |
|---|---|---|---:|---:|---:|---:|---:|---:|";
}

fn rms(errors: &[f64]) -> f64 {
    (errors.iter().map(|error| error * error).sum::<f64>() / errors.len().max(1) as f64).sqrt()
}

/// Share of errors above one step, percent.
fn outliers(errors: &[f64]) -> f64 {
    100.0 * errors.iter().filter(|error| **error > 1.0).count() as f64 / errors.len().max(1) as f64
}

/// The factor by which sigma is too small: the median of error / sigma, over that of a normal distribution.
fn calibration(relative: &[f64]) -> f64 {
    let mut sorted = relative.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).map_or(f64::NAN, |median| median / 0.6745)
}

impl fmt::Display for Score {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, (name, errors)) in ["textured", "plain", "near steps"].iter().zip(&self.0).enumerate() {
            let covered = 100.0 * errors.height.len() as f64 / errors.index.len().max(1) as f64;
            let line = format!(
                "| {name} | {:.3} | {:.3} | {:.1} % | {:.1} % | {covered:.1} % | {:.2} |",
                rms(&errors.index),
                rms(&errors.height),
                outliers(&errors.index),
                outliers(&errors.height),
                calibration(&errors.relative),
            );
            write!(f, "{}{line}", if i == 0 { "" } else { "\n| | " })?;
        }
        Ok(())
    }
}

/// Measures the height map of the aligned image files in `folder`, in the order of their names, and writes its relief.
pub fn relief_of(folder: &Path, to: &Path, method: Method) {
    let is_picture = |path: &Path| {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_lowercase();
        ["png", "jpg", "jpeg", "tif", "tiff"].contains(&extension.as_str())
    };
    let entries = std::fs::read_dir(folder).unwrap_or_else(|why| panic!("{}: {why}", folder.display()));
    let mut files: Vec<_> =
        entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| is_picture(path)).collect();
    files.sort();
    let load = |file: &std::path::PathBuf| {
        let bytes = std::fs::read(file).unwrap_or_else(|why| panic!("{}: {why}", file.display()));
        decode(&bytes, &Limits::default()).unwrap_or_else(|why| panic!("{}: {why}", file.display()))
    };
    let slices: Vec<Raster> = files.iter().map(load).collect();
    let first = slices.first().unwrap_or_else(|| panic!("{} contains no pictures", folder.display()));
    let plan = Plan::aligned(first.width, first.height, slices.len());
    let plan = Plan { method, height_map: Some(HeightAxis::steps(slices.len(), 0, None)), ..plan };
    let fused = fuse(&&slices[..], &plan, &FusionRequest::default(), &std::env::temp_dir(), &NoControl)
        .unwrap_or_else(|why| panic!("{why}"));
    let map = fused.height_map.expect("the plan asks for heights");
    println!("median sigma {:?} steps, {:.1} % valid", map.median_sigma, 100.0 * map.valid_fraction);
    let file = std::fs::File::create(to).unwrap_or_else(|why| panic!("{}: {why}", to.display()));
    encode_png(file, &relief(&map.values), &Metadata::default())
        .unwrap_or_else(|why| panic!("{}: {why}", to.display()));
}
