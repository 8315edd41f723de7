//! Lamp banding: stripes of light across a slice, by a lamp that flickers while the shutter runs.
//!
//! Stripes move dots towards their bright side, by another amount in each slice. What they leave is the mean of each
//! row (or of each column) of the image after the dots are removed.
//!
//! Stripes whose period is the pitch vary as the dots do: half of them is taken for another shape of the dots, in rows
//! and columns alike, and the other half for another position. So where dots leave white corridors between them, the
//! means are over these alone, as they are seen: those of rows over the corridors that cross the rows, those of columns
//! over the others. In slices too blurred for that, the means are over all samples without the rendered dots.
//!
//! Rows and columns are compared in each ninth of the image: where one end of a tilted target is blurred more, the dots
//! differ from the rendered ones in rows and columns alike. Stripes are everywhere.
//!
//! A lamp that flickers does so in every slice. So stripes that are too weak for one slice are found by the median of
//! all.

use super::lattice::Places;
use super::{dlt, radial_profile::RadialProfile, statistics::median};
use crate::imaging::Plane;
use crate::types::Homography;

/// Rows or columns over which slow changes of light are removed, in grid steps.
const SLOW: f64 = 4.0;
/// Parts along each side of the image.
const PARTS: usize = 3;
/// Least samples of a line, and of one in corridors.
const MIN_SAMPLES: [f64; 2] = [50.0, 15.0];
/// Ratio of the stripes in one direction to those in the other from which they are lamp banding.
const CLEAR: f64 = 3.0;
/// Least amplitude, as a share of the light; the second in corridors.
const LEAST: [f64; 2] = [0.006, 0.003];
/// The same ratio in the median of the slices with corridors, and the least number of these.
const CLEAR_IN_ALL: (f64, usize) = (2.0, 3);
/// Least amplitude in that median.
const LEAST_IN_ALL: f64 = 0.0015;
/// Least width of a corridor, grid steps.
const MIN_WIDTH: f64 = 0.12;
/// Places that determine where the corridors run.
const MAX_PLACES: usize = 150;

/// The contrast of a slice.
pub(super) struct Contrast<'a> {
    /// The contrast image.
    pub seen: &'a Plane<f32>,
    /// The same of the dots alone.
    pub rendered: &'a Plane<f32>,
    /// 1 where a sample shows the target.
    pub ground: &'a Plane<u8>,
    /// The dots, px.
    pub places: &'a Places,
    /// Distance of neighbouring dots, px.
    pub pitch: f64,
    /// The two grid steps, px.
    pub steps: [[f64; 2]; 2],
    /// The radial profile of a dot.
    pub profile: &'a RadialProfile,
}

/// Sum and number of samples of each line.
type Lines = Vec<[f64; 2]>;

/// How much the light changes from row to row, and from column to column: medians, as shares of the light. For stripes
/// it is `sqrt(1/2)` of their amplitude.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ripple {
    rows: f64,
    columns: f64,
    in_corridors: bool,
}

impl Ripple {
    /// Amplitude of the stripes, as a share of the light; `None` when there are none that this slice alone shows.
    pub(super) fn stripes(&self) -> Option<f64> {
        let (most, least) = (self.rows.max(self.columns), self.rows.min(self.columns));
        let amplitude = std::f64::consts::SQRT_2 * most;
        (most > CLEAR * least && amplitude > LEAST[usize::from(self.in_corridors)]).then_some(amplitude)
    }

    /// Amplitude of stripes across the rows, without what rows and columns have in common; negative across the columns.
    fn excess(&self) -> f64 {
        let squares = 2.0 * (self.rows.powi(2) - self.columns.powi(2));
        squares.abs().sqrt().copysign(squares)
    }
}

/// Amplitude of the stripes in each slice of a stack, as a share of the light.
pub(super) fn stripes(slices: &[Option<Ripple>]) -> Vec<Option<f64>> {
    let in_corridors = || slices.iter().flatten().filter(|ripple| ripple.in_corridors);
    let mut ratios: Vec<f64> = in_corridors().map(|ripple| (ripple.rows / ripple.columns).ln()).collect();
    let mut excesses: Vec<f64> = in_corridors().map(Ripple::excess).collect();
    let (clear, fewest) = CLEAR_IN_ALL;
    let in_all = (ratios.len() >= fewest && median(&mut ratios).abs() > clear.ln())
        .then(|| median(&mut excesses).abs())
        .filter(|amplitude| *amplitude > LEAST_IN_ALL);
    slices.iter().map(|ripple| ripple.and_then(|ripple| ripple.stripes().or(in_all))).collect()
}

impl Contrast<'_> {
    /// The changes of the light; `None` when too little of the target is seen.
    pub(super) fn ripple(&self) -> Option<Ripple> {
        let corridors = Corridors::of(self);
        let in_corridors = corridors.is_some();
        let least = MIN_SAMPLES[usize::from(in_corridors)];
        let [rows, columns] = self.lines(corridors.as_ref()).map(|lines| ripple(&lines, self.pitch, least));
        Some(Ripple { rows: rows?, columns: columns?, in_corridors })
    }

    /// The lines along the rows and those along the columns, one list per part.
    fn lines(&self, corridors: Option<&Corridors>) -> [Vec<Lines>; 2] {
        let (width, height) = (self.seen.width, self.seen.height);
        let mut rows = vec![vec![[0.0_f64; 2]; height]; PARTS];
        let mut columns = vec![vec![[0.0_f64; 2]; width]; PARTS];
        let samples = self.seen.data.iter().zip(&self.rendered.data).zip(&self.ground.data).enumerate();
        for (k, ((seen, dots), _)) in samples.filter(|(_, (_, ground))| **ground != 0) {
            let (x, y) = (k % width, k / width);
            let left = f64::from(if corridors.is_some() { *seen } else { seen - dots });
            let [in_row, in_column] = corridors.map_or([true; 2], |c| c.contain([x as f64, y as f64]));
            let add = |line: &mut [f64; 2]| *line = [line[0] + left, line[1] + 1.0];
            if in_row {
                add(&mut rows[x * PARTS / width][y]);
            }
            if in_column {
                add(&mut columns[y * PARTS / height][x]);
            }
        }
        [rows, columns]
    }
}

/// The white corridors between the dots.
struct Corridors {
    /// Px to labels.
    to_grid: Homography,
    /// Which coordinate of the grid is constant along the corridors that cross the rows.
    crossing_rows: usize,
    /// Half their width, grid steps.
    half: f64,
}

impl Corridors {
    /// `None` when the dots leave none.
    fn of(contrast: &Contrast) -> Option<Self> {
        let half = 0.5 - contrast.profile.rim() / contrast.pitch;
        if 2.0 * half < MIN_WIDTH {
            return None;
        }
        let every = contrast.places.len().div_ceil(MAX_PLACES).max(1);
        let pairs: Vec<dlt::Pair> =
            contrast.places.iter().step_by(every).map(|(label, at)| (*at, label.map(f64::from))).collect();
        let steps = contrast.steps;
        let crossing_rows = usize::from(steps[0][1].abs() > steps[1][1].abs());
        Some(Self { to_grid: dlt::fit(&pairs)?, crossing_rows, half })
    }

    /// Whether a sample is in a corridor that crosses the rows, and in one that crosses the columns.
    fn contain(&self, at: [f64; 2]) -> [bool; 2] {
        let grid = self.to_grid.apply(at);
        let is_in = |axis: usize| (grid[axis] - grid[axis].floor() - 0.5).abs() < self.half;
        [is_in(self.crossing_rows), is_in(1 - self.crossing_rows)]
    }
}

/// Median of the changes of the means of the lines, without slow ones, in the median part of the image. Dirt changes
/// few lines.
fn ripple(parts: &[Lines], pitch: f64, min_samples: f64) -> Option<f64> {
    let reach = (0.5 * SLOW * pitch).round() as usize;
    let mut medians = Vec::new();
    for lines in parts {
        let means: Vec<f64> = lines.iter().filter(|l| l[1] >= min_samples).map(|l| l[0] / l[1]).collect();
        let off = |window: &[f64]| (window[reach] - window.iter().sum::<f64>() / window.len() as f64).abs();
        let mut off: Vec<f64> = means.windows(2 * reach + 1).map(off).collect();
        let part = off.len().div_ceil(PARTS).max(1);
        medians.extend(off.chunks_mut(part).map(median));
    }
    (!medians.is_empty()).then(|| median(&mut medians))
}

#[cfg(test)]
mod tests {
    use crate::calibration::calibrate;
    use crate::synth::{Banding, DotTarget, Rig, render_target};
    use crate::types::NoControl;
    use crate::types::calibration_options::CalibrationOptions;
    use crate::types::report::Grade;

    #[test]
    fn stripes_of_a_flickering_lamp_are_reported_and_limit_the_grade() {
        for (strength, is_told) in [(0.0, false), (0.03, true)] {
            let rig = Rig { channels: 1, noise: 1.0, ..Rig::sized(400, 300, 3) };
            let mut target = DotTarget::for_rig(&rig, 14);
            let period_px = 0.7 * target.pitch_px(&rig, rig.reference);
            target.flaws.faults.banding = Some(Banding { period_px, strength });
            let images: Vec<_> = (0..3).map(|i| render_target(&rig, &target, i)).collect();
            let found = calibrate(&&images[..], &CalibrationOptions::default(), &NoControl).expect("a calibration");
            let told: Vec<_> = found.warnings.iter().filter(|w| w.code == "lamp_banding").collect();
            assert_eq!(!told.is_empty(), is_told, "{strength}: {:?}", found.warnings);
            assert!(!is_told || found.report.grade != Grade::Good);
        }
    }
}
