//! The height map as integers with an offset and a scale.

use rayon::prelude::*;

use super::{
    axis::{HeightAxis, HeightDirection, HeightUnit},
    regularise::{CELL, Filled, Regularisation},
};
use crate::{
    fusion::run::Run,
    imaging::{Plane, Raster, Rect},
    types::Interrupted,
};

/// Value of a pixel without a height, in both planes of a [`HeightMap`].
pub const INVALID: u16 = 0;
/// Largest valid value.
const LARGEST: f64 = 65_535.0;
/// Standard deviation, steps, above which a height is not valid.
const MAX_SIGMA: f32 = 1.0;

/// A height map. The height of a value `v` above 0 is `offset + (v - 1) scale`, and its standard deviation is
/// `s scale`, where `s` is the value of the same pixel in [`HeightMap::sigmas`]. 0 means that the height is unknown.
/// The height of the plane in focus in the reference slice is 0.
///
/// ```
/// # use std::sync::Arc;
/// # use pinstack_science::fusion::{self, FusionRequest, Plan, SlicePlan, height::axis::HeightAxis};
/// # use pinstack_science::{synth::{Light, Rendered, Rig, Scene, Stage}, types::NoControl};
/// let rig = Rig::sized(120, 80, 7);
/// let slices = Rendered::scene(Arc::new(Stage::new(&rig, &Scene::insect(4))), Light::Front);
/// let slice = |i| SlicePlan { homography: rig.homography(i), gain: rig.gain(i), rail_mm: None };
/// let axis = HeightAxis::steps(7, rig.reference, None);
/// let plan = Plan { slices: (0..7).map(slice).collect(), height_map: Some(axis), ..Plan::aligned(120, 80, 7) };
/// let fused = fusion::fuse(&slices, &plan, &FusionRequest::default(), &std::env::temp_dir(), &NoControl)?;
/// let map = fused.height_map.expect("the plan asks for it");
/// let (height, sigma) = (0..120 * 80).find_map(|at| map.at(at % 120, at / 120)).expect("a pixel with a height");
/// assert!((-4.0..=4.0).contains(&height) && sigma <= 1.1, "{height} +- {sigma} steps");
/// # Ok::<(), pinstack_science::types::Interrupted>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct HeightMap {
    /// Heights.
    pub values: Plane<u16>,
    /// Standard deviations.
    pub sigmas: Plane<u16>,
    /// Unit of `offset`, `scale` and `median_sigma`.
    pub unit: HeightUnit,
    /// Direction in which heights increase.
    pub direction: HeightDirection,
    /// Height of the value 1.
    pub offset: f64,
    /// Difference of the heights of neighbouring values.
    pub scale: f64,
    /// Median of the standard deviations of all valid pixels; `None` if there are none.
    pub median_sigma: Option<f64>,
    /// Fraction of the canvas, or of the silhouette, with a height.
    pub valid_fraction: f64,
}

impl HeightMap {
    /// Regularises and encodes the estimates.
    pub(super) fn of(
        run: &Run<'_>,
        axis: &HeightAxis,
        positions: &[f64],
        regular: &Regularisation<'_>,
    ) -> Result<Self, Interrupted> {
        let (width, height) = (run.plan.width, run.plan.height);
        let code = Code::new(axis, positions);
        let cells = regular.cells();
        let mut values = Plane::filled(width, height, INVALID);
        let mut sigmas = Plane::filled(width, height, INVALID);
        let bands = values.data.par_chunks_mut(width * CELL).zip(sigmas.data.par_chunks_mut(width * CELL)).enumerate();
        bands.try_for_each_init(Filled::default, |filled, (band, (values, sigmas))| {
            run.control.check()?;
            filled.clear();
            for (i, (value, sigma)) in values.iter_mut().zip(sigmas).enumerate() {
                let (x, y) = (i % width, band * CELL + i / width);
                if run.request.object.is_some_and(|object| object.at(x, y) == 0) {
                    continue;
                }
                let estimate = regular.at(x, y, &cells, filled).filter(|&(_, sigma)| sigma <= MAX_SIGMA);
                if let Some((position, of)) = estimate {
                    (*value, *sigma) = code.encode(f64::from(position), f64::from(of));
                }
            }
            Ok::<_, Interrupted>(())
        })?;
        let (median, valid) = median(&sigmas);
        let wanted =
            run.request.object.map_or(width * height, |object| object.data.iter().filter(|&&o| o != 0).count());
        Ok(Self {
            values,
            sigmas,
            unit: axis.unit,
            direction: axis.direction,
            offset: code.offset,
            scale: code.scale,
            median_sigma: median.map(|sigma| f64::from(sigma) * code.scale),
            valid_fraction: valid as f64 / wanted.max(1) as f64,
        })
    }

    /// The height and its standard deviation at (x, y); `None` where it is unknown.
    pub fn at(&self, x: usize, y: usize) -> Option<(f64, f64)> {
        let value = self.values.at(x, y);
        let height = self.offset + (f64::from(value) - 1.0) * self.scale;
        (value != INVALID).then(|| (height, f64::from(self.sigmas.at(x, y)) * self.scale))
    }

    /// The heights of `rect` as a 16-bit grey picture.
    pub fn picture(&self, rect: Rect) -> Raster {
        grey(&self.values, rect)
    }

    /// The standard deviations of `rect` as a 16-bit grey picture.
    pub fn sigma_picture(&self, rect: Rect) -> Raster {
        grey(&self.sigmas, rect)
    }
}

fn grey(plane: &Plane<u16>, rect: Rect) -> Raster {
    let part = plane.crop(rect);
    Raster::sixteen(part.width, part.height, 1, part.data)
}

/// The median of the valid values, and their number.
fn median(sigmas: &Plane<u16>) -> (Option<u16>, usize) {
    let mut counts = vec![0usize; 1 << 16];
    sigmas.data.iter().for_each(|&sigma| counts[usize::from(sigma)] += 1);
    let valid = sigmas.data.len() - counts[0];
    let mut below = 0;
    let median = counts.iter().enumerate().skip(1).find(|&(_, count)| {
        below += count;
        2 * below > valid
    });
    (median.map(|(sigma, _)| sigma as u16).filter(|_| valid > 0), valid)
}

/// From positions in steps to integers.
struct Code<'a> {
    positions: &'a [f64],
    heights: &'a [f64],
    offset: f64,
    scale: f64,
}

impl<'a> Code<'a> {
    /// The scale spreads the heights of all slices, and one step beyond each end, over all values.
    fn new(axis: &'a HeightAxis, positions: &'a [f64]) -> Self {
        let mut code = Self { positions, heights: &axis.heights, offset: 0.0, scale: 1.0 };
        let last = positions.last().copied().unwrap_or(0.0);
        let ends = [code.height(-1.0).0, code.height(last + 1.0).0];
        let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        code.offset = low;
        code.scale = ((high - low) / (LARGEST - 1.0)).max(f64::MIN_POSITIVE);
        code
    }

    /// Height at a position, and its derivative. Linear between slices: over one step the height of a thin lens departs
    /// from that by less than the errors of measurement.
    fn height(&self, position: f64) -> (f64, f64) {
        let count = self.positions.len().min(self.heights.len());
        if count < 2 {
            return (self.heights.first().copied().unwrap_or(0.0) + position, 1.0);
        }
        let below = self.positions[..count].partition_point(|&p| p <= position).clamp(1, count - 1) - 1;
        let slope =
            (self.heights[below + 1] - self.heights[below]) / (self.positions[below + 1] - self.positions[below]);
        (self.heights[below] + slope * (position - self.positions[below]), slope.abs())
    }

    fn encode(&self, position: f64, sigma: f64) -> (u16, u16) {
        let (height, slope) = self.height(position);
        let value = 1.0 + ((height - self.offset) / self.scale).round();
        let sigma = (sigma * slope / self.scale).round();
        (value.clamp(1.0, LARGEST) as u16, sigma.clamp(1.0, LARGEST) as u16)
    }
}
