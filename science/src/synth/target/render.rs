//! Slices of a target, rendered from its formula.

use std::f64::consts::PI;

use super::beyond::Beyond;
use super::disc_overlap::{PIXEL_MOMENT, overlap, overlap_middle, wave_left};
use super::faults::filmic;
use super::specks::{Speck, specks};
use super::{DotTarget, Flaws, Replacement};
use crate::imaging::{Raster, Samples};
use crate::synth::rig::Rig;
use crate::synth::sensor::expose_as;
use crate::target::dot_size;
use crate::types::Homography;

/// Slice `i` of a stack of the target: every pixel is the share of its circle of confusion that lies on
/// dots (overlap of two circles), with the rig's drift, exposure, vignetting and noise.
///
/// The square of the pixel is taken as a disc of the same second moment; everything is symmetric about the
/// dot's centre, so no position is biased by sampling. On a tilted plate each dot is blurred as its centre
/// is.
pub fn render_target(rig: &Rig, target: &DotTarget, i: usize) -> Raster {
    let replacement = target.flaws.faults.replaced.filter(|replaced| replaced.0 == i).map(|replaced| replaced.1);
    match replacement {
        None => render_slice(rig, target, i),
        Some(Replacement::Black) => expose_as(rig, i, 0xd075, |light| light, |_, _| {}),
        Some(Replacement::Blank) => {
            let missing = (0..target.columns * target.rows).collect();
            render_slice(rig, &DotTarget { missing, ..target.clone() }, i)
        }
        Some(Replacement::Mirrored) => mirrored(render_slice(rig, target, i)),
        Some(Replacement::Other) => {
            let other = DotTarget {
                pitch_mm: 1.37 * target.pitch_mm,
                dot_diameter_mm: 1.37 * target.dot_diameter_mm,
                rotation_deg: target.rotation_deg + 23.0,
                ..target.clone()
            };
            render_slice(rig, &other, i)
        }
    }
}

/// The same picture, left for right.
fn mirrored(mut raster: Raster) -> Raster {
    fn flip<T>(samples: &mut [T], width: usize, channels: usize) {
        for row in samples.chunks_exact_mut(width * channels) {
            row.reverse();
            row.chunks_exact_mut(channels).for_each(<[T]>::reverse);
        }
    }
    match &mut raster.samples {
        Samples::Eight(samples) => flip(samples, raster.width, raster.channels),
        Samples::Sixteen(samples) => flip(samples, raster.width, raster.channels),
    }
    raster
}

fn render_slice(rig: &Rig, target: &DotTarget, i: usize) -> Raster {
    let map = target.to_slice(rig, i);
    let both = Homography::from_matrix(&map).and_then(|map| Some((map, map.inverse()?)));
    let Some((map, back)) = both else {
        return expose_as(rig, i, 0xd075, |light| light, |_, _| {});
    };
    let flaws = &target.flaws;
    let faults = &flaws.faults;
    let colours = if faults.channels_differ() { 3 } else { 1 };
    let grids: Vec<Grid> = (0..colours).map(|channel| Grid::new(rig, target, i, faults.axial_px[channel])).collect();
    let specks = specks(rig, target, i, &map);
    let beyond = Beyond::new(rig, target, i);
    let monitor = flaws.raster_px.map(|period| Monitor::new(rig, target, i, period));
    let exposure = faults.exposure(i);
    let centre = rig.centre();
    expose_as(
        rig,
        i,
        0xd075,
        |light| flaws.response(light),
        |y, row| {
            let near: Vec<&Speck> = specks.iter().filter(|speck| speck.touches_row(y as f64)).collect();
            let stripe = faults.stripe(flaws.seed, i, y);
            for (x, light) in row.iter_mut().enumerate() {
                let px = [x as f64, y as f64];
                let stretch = faults.stretch(rig, px);
                let ideal = faults.undistort(rig, px);
                let channel = |grid: &Grid, lateral: f64| {
                    let ideal = if lateral == 0.0 {
                        ideal
                    } else {
                        [0, 1].map(|axis| centre[axis] + (ideal[axis] - centre[axis]) / (1.0 + lateral))
                    };
                    let place = back.apply(ideal);
                    let zoom = back.scale_at(ideal) * stretch;
                    let mut value = grid.light(place, zoom);
                    if let Some(beyond) = &beyond {
                        value = beyond.around(value, place, zoom);
                    }
                    if let Some(monitor) = &monitor {
                        value *= monitor.share(place);
                    }
                    for speck in &near {
                        value *= 1.0 - speck.shade(px);
                    }
                    value += flaws.glare_at(rig, px);
                    value * stripe
                };
                *light = match &grids[..] {
                    [grid] => [channel(grid, 0.0); 3],
                    grids => std::array::from_fn(|at| channel(&grids[at], faults.lateral[at])),
                }
                .map(|value| value as f32);
                if exposure != [1.0; 3] {
                    light.iter_mut().zip(exposure).for_each(|(light, factor)| *light *= factor as f32);
                }
            }
        },
    )
}

impl Flaws {
    /// What the sensor stores for `light`, both 0..1 of full scale; not yet clipped.
    pub(super) fn response(&self, light: f32) -> f32 {
        let light = if self.overexposure == 1.0 { light } else { light * self.overexposure as f32 };
        if !self.gamma && !self.faults.filmic {
            return light;
        }
        let light = if self.faults.filmic { filmic(light) } else { light };
        let light = light.clamp(0.0, 1.0);
        if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
    }

    fn glare_at(&self, rig: &Rig, px: [f64; 2]) -> f64 {
        let (width, height) = (rig.width as f64, rig.height as f64);
        let patch = |glare: &super::Glare| {
            let radius = glare.radius * width.min(height);
            let squared = (px[0] - glare.at[0] * width).powi(2) + (px[1] - glare.at[1] * height).powi(2);
            glare.light * (-0.5 * squared / (radius * radius)).exp()
        };
        self.glare.iter().map(patch).sum()
    }
}

/// The dots as one slice sees them.
struct Grid<'a> {
    target: &'a DotTarget,
    printed: Vec<bool>,
    middle: [f64; 2],
    /// Radius of the largest dot in pitches.
    dot: f64,
    /// Radius of each dot in pitches, where they differ: on a coded target, and with print errors.
    coded: Option<Vec<f64>>,
    /// Per dot the radius of its blur, the pixel's own included, px; one for all when the plate is parallel.
    blurs: Vec<f64>,
    largest: f64,
    plate: f64,
    mark: f64,
}

impl<'a> Grid<'a> {
    /// `axial_px` is added to the signed radius of the blur: positive in slices after the one in focus.
    fn new(rig: &Rig, target: &'a DotTarget, i: usize, axial_px: f64) -> Self {
        let side = if i as f64 >= target.slice_in_focus(rig) { 1.0 } else { -1.0 };
        let with_pixel = |blur: f64| ((blur + side * axial_px).powi(2) + PIXEL_MOMENT).sqrt();
        let middle = target.middle();
        let blur_of = |dot: usize| {
            let place = target.grid_position(dot % target.columns, dot / target.columns);
            with_pixel(target.blur_at(rig, i, [place[0] - middle[0], place[1] - middle[1]]))
        };
        let blurs = if target.tilt_deg == [0.0; 2] {
            vec![with_pixel(target.blur_radius_px(rig, i))]
        } else {
            (0..target.columns * target.rows).map(blur_of).collect()
        };
        let (plate, mark) = if target.invert { (target.black, target.white) } else { (target.white, target.black) };
        let dot = target.dot_diameter_mm / target.pitch_mm / 2.0;
        let coded = target.code.map(|[column, row]| {
            let at = |k: usize| [column + (k % target.columns) as i64, row + (k / target.columns) as i64];
            let radius = |k| dot * dot_size(at(k)[0], at(k)[1]).factor();
            (0..target.columns * target.rows).map(radius).collect::<Vec<f64>>()
        });
        let faults = &target.flaws.faults;
        let coded = if faults.print_error == 0.0 {
            coded
        } else {
            let error = |k: usize| faults.print_error(target.flaws.seed, k % target.columns, k / target.columns)[2];
            let nominal = |k: usize| coded.as_ref().map_or(dot, |coded| coded[k]);
            Some((0..target.columns * target.rows).map(|k| (nominal(k) + error(k)).max(0.0)).collect())
        };
        Self {
            target,
            printed: target.printed(),
            middle,
            dot: coded.iter().flatten().copied().fold(dot, f64::max),
            coded,
            largest: blurs.iter().copied().fold(0.0, f64::max),
            blurs,
            plate,
            mark,
        }
    }

    /// Light at a place (grid units from the middle) where a px is `zoom` grid units wide.
    fn light(&self, place: [f64; 2], zoom: f64) -> f64 {
        let target = self.target;
        let (column, line) = (place[0] + self.middle[0], place[1] + self.middle[1]);
        let faults = &target.flaws.faults;
        let reach = self.dot + self.largest * zoom * faults.kernel.reach() + faults.print_error;
        let near = |at: f64, reach: f64, count: usize| {
            let first = (at - reach).ceil().max(0.0) as usize;
            let end = ((at + reach).floor() + 1.0).clamp(0.0, count as f64) as usize;
            first..end.max(first)
        };
        let step = target.row_step();
        // rows that may be shifted to the right are found by looking further to the left
        let shift = if target.asymmetric { 0.25 } else { 0.0 };
        let at = [column, line];
        let uneven = faults.illumination != [0.0; 2] || faults.spot != 0.0;
        let (mut covered, mut shaded) = (0.0, 0.0);
        for c in near(column - shift, reach + shift, target.columns) {
            for r in near(line / step, reach / step, target.rows) {
                let dot = r * target.columns + c;
                if !self.printed[dot] {
                    continue;
                }
                let blur = self.blurs[if self.blurs.len() == 1 { 0 } else { dot }] * zoom;
                let centre = target.grid_position(c, r);
                let distance = (column - centre[0]).hypot(line - centre[1]);
                let radius = self.coded.as_ref().map_or(self.dot, |coded| coded[dot]);
                for &[size, share] in faults.kernel.discs() {
                    let blur = size * blur;
                    let area = share * overlap(radius, blur, distance) / (PI * blur * blur);
                    covered += area;
                    if uneven && area != 0.0 {
                        // the light is linear in place, nearly: what counts is the middle of the shared area
                        let towards = overlap_middle(radius, blur, distance) / distance.max(1e-12);
                        let middle = [0, 1].map(|axis| place[axis] + towards * (centre[axis] - at[axis]));
                        shaded += area * (faults.light_at(middle) - 1.0);
                    }
                }
            }
        }
        if !uneven {
            return self.plate + (self.mark - self.plate) * covered;
        }
        (self.plate * faults.light_at(place) + (self.mark - self.plate) * (covered + shaded)).max(0.0)
    }
}

/// The pixels of a monitor as one slice sees them: waves across and down.
struct Monitor {
    /// Period in grid units.
    period: f64,
    /// What blur leaves of the waves.
    depth: f64,
}

impl Monitor {
    fn new(rig: &Rig, target: &DotTarget, i: usize, period_px: f64) -> Self {
        const DEPTH: f64 = 0.7;
        let blur = (target.blur_radius_px(rig, i).powi(2) + PIXEL_MOMENT).sqrt();
        let period = period_px / target.pitch_px(rig, rig.reference);
        Self { period, depth: DEPTH * wave_left(blur, period * target.pitch_px(rig, i)) }
    }

    fn share(&self, place: [f64; 2]) -> f64 {
        let wave = |at: f64| 1.0 + self.depth * (2.0 * PI * at / self.period).cos();
        0.5 * wave(place[0]) * wave(place[1])
    }
}
