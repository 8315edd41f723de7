//! Samples the parts of a scene once, in the geometry of the reference slice. Slices are resampled from them.

use rayon::prelude::*;

use super::Rig;
use super::scene::{Part, Relief, Shape};

/// Up to this number of pixels, parts are sampled at twice the density of the pixels.
const DENSE_UP_TO_PX: usize = 6_000_000;
/// How far beyond the reference picture parts are kept: other slices may see more. Share of a side.
const BORDER: f64 = 0.12;
/// Side of the blocks of samples that are known to be empty or not.
const BLOCK: usize = 8;

/// From px of the reference picture to scene coordinates.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    centre: [f64; 2],
    /// Scene units per px.
    pub(super) pixel: f64,
}

impl Frame {
    pub(super) fn of(rig: &Rig) -> Self {
        Self { centre: rig.centre(), pixel: 1.0 / rig.width.min(rig.height).max(1) as f64 }
    }

    pub(super) fn to_scene(self, px: [f64; 2]) -> [f64; 2] {
        [(px[0] - self.centre[0]) * self.pixel, (px[1] - self.centre[1]) * self.pixel]
    }

    fn to_px(self, point: [f64; 2]) -> [f64; 2] {
        [point[0] / self.pixel + self.centre[0], point[1] / self.pixel + self.centre[1]]
    }
}

/// One part as a raster of colour and coverage (premultiplied), averaged over two steps of the samples: 1 px up to
/// [`DENSE_UP_TO_PX`], 2 px above.
#[derive(Debug)]
pub(super) struct Baked {
    grid: Grid,
    samples: Vec<[u16; 4]>,
    /// Per block: whether any sample in it or beside it is covered.
    occupied: Vec<bool>,
    depths_at: Depths,
    /// Smallest and largest depth on the part.
    pub(super) depths: [f64; 2],
}

/// The depth of a part at every point of the picture.
#[derive(Debug)]
enum Depths {
    Relief(Relief, Frame),
    /// One per sample.
    Sampled(Vec<f32>),
}

/// The raster of a part: where its samples lie in the picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    /// Reference px of sample (0, 0).
    pub(super) origin: [f64; 2],
    /// Samples per px.
    pub(super) per_px: usize,
    pub(super) width: usize,
    pub(super) height: usize,
}

impl Grid {
    /// The raster for what lies between `low` and `high` px of the reference picture; `None` when that is outside of
    /// the picture and its border ([`BORDER`]).
    pub(super) fn covering(rig: &Rig, low: [f64; 2], high: [f64; 2]) -> Option<Self> {
        let per_px = if rig.width * rig.height <= DENSE_UP_TO_PX { 2 } else { 1 };
        let within = |value: f64, side: usize| value.clamp(-BORDER * side as f64, (1.0 + BORDER) * side as f64);
        let origin = [within(low[0] - 2.0, rig.width).floor(), within(low[1] - 2.0, rig.height).floor()];
        let end = [within(high[0] + 2.0, rig.width).ceil(), within(high[1] + 2.0, rig.height).ceil()];
        let [width, height] = [0, 1].map(|axis| (end[axis] - origin[axis]) as usize * per_px);
        (width > 0 && height > 0).then_some(Self { origin, per_px, width, height })
    }

    /// Distance of two samples, px.
    pub(super) fn step(&self) -> f64 {
        1.0 / self.per_px as f64
    }

    /// The position of sample (x, y), which need not be whole, in px of the reference picture.
    pub(super) fn sample_position(&self, x: f64, y: f64) -> [f64; 2] {
        [self.origin[0] + x * self.step(), self.origin[1] + y * self.step()]
    }
}

/// Bakes all parts. Those outside the picture, or of which nothing is covered, are omitted.
pub(super) fn bake(rig: &Rig, parts: &[Part]) -> Vec<Baked> {
    let frame = Frame::of(rig);
    let casters: Vec<Caster> = parts.iter().map(Caster::of).collect();
    let baked = parts.iter().enumerate();
    baked.filter_map(|(index, part)| bake_part(rig, frame, part, &casters[index + 1..])).collect()
}

fn bake_part(rig: &Rig, frame: Frame, part: &Part, casters: &[Caster]) -> Option<Baked> {
    let bounds = part.shape.bounds();
    let grid = Grid::covering(rig, frame.to_px([bounds[0], bounds[1]]), frame.to_px([bounds[2], bounds[3]]))?;
    // points around each sample, which are averaged
    let points = shade_points(frame, part, casters, grid.origin, grid.step(), [grid.width + 1, grid.height + 1]);
    let samples: Vec<[u16; 4]> = (0..grid.width * grid.height)
        .into_par_iter()
        .map(|at| {
            let (x, y) = (at % grid.width, at / grid.width);
            let corner = |dx: usize, dy: usize| points[(y + dy) * (grid.width + 1) + x + dx];
            stored([corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)])
        })
        .collect();
    let depths = depth_range(frame, part, grid, &samples);
    // false for a part of which nothing is covered
    (depths[0] <= depths[1]).then(|| Baked::new(grid, samples, Depths::Relief(part.relief, frame), depths))
}

/// The mean of the colours at four points, as it is stored.
pub(super) fn stored(points: [[f32; 4]; 4]) -> [u16; 4] {
    std::array::from_fn(|c| (points.iter().map(|p| p[c]).sum::<f32>() * 0.25 * 65_535.0).round() as u16)
}

/// Premultiplied colour and coverage at points half a step before each sample.
fn shade_points(
    frame: Frame,
    part: &Part,
    casters: &[Caster],
    origin: [f64; 2],
    step: f64,
    size: [usize; 2],
) -> Vec<[f32; 4]> {
    let soft = frame.pixel * step;
    let shade = |shape: &Shape, x: usize, y: usize| {
        let px = [origin[0] + (x as f64 - 0.5) * step, origin[1] + (y as f64 - 0.5) * step];
        let point = frame.to_scene(px);
        let Some(place) = shape.place_within(point, soft) else { return [0.0; 4] };
        let windows = part.holes.iter().map(|(centre, radius)| radius - distance(point, *centre));
        let outline = windows.fold(place.distance, f64::max);
        let coverage = (0.5 - outline / soft).clamp(0.0, 1.0) as f32;
        if coverage <= 0.0 {
            return [0.0; 4];
        }
        let light = shadow(casters, part, point);
        let colour = part.skin.colour(&place, point, frame.pixel);
        [coverage * light * colour[0], coverage * light * colour[1], coverage * light * colour[2], coverage]
    };
    let mut points = vec![[0.0_f32; 4]; size[0] * size[1]];
    points.par_chunks_mut(size[0]).enumerate().for_each(|(y, row)| {
        let at = frame.to_scene([0.0, origin[1] + (y as f64 - 0.5) * step])[1];
        let shape = part.shape.near_row(at, soft);
        row.iter_mut().enumerate().for_each(|(x, out)| *out = shade(&shape, x, y));
    });
    points
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// What a part throws its shadow with: its outline without hairs.
struct Caster {
    shape: Shape,
    bounds: [f64; 4],
    relief: Relief,
}

impl Caster {
    fn of(part: &Part) -> Self {
        const HAIR: f64 = 0.003;
        let shape = match &part.shape {
            Shape::Strokes(strokes) => {
                Shape::Strokes(strokes.iter().filter(|s| s.radii[0].max(s.radii[1]) > HAIR).copied().collect())
            }
            whole => whole.clone(),
        };
        Self { bounds: shape.bounds(), shape, relief: part.relief }
    }
}

/// What nearer parts leave of the light, which comes from the upper left. Soft, and only for the look.
fn shadow(casters: &[Caster], part: &Part, point: [f64; 2]) -> f32 {
    const UNITS_PER_DEPTH: f64 = 0.16;
    /// Longest way of a shadow, and half its softness there.
    const REACH: f64 = 0.25;
    let own = part.relief.depth(point[0], point[1]);
    let mut light = 1.0;
    for caster in casters {
        let bounds = caster.bounds;
        let [x, y] = point;
        if x < bounds[0] - REACH || y < bounds[1] - REACH || x > bounds[2] + REACH || y > bounds[3] + REACH {
            continue;
        }
        let gap = own - caster.relief.depth(x, y);
        if gap <= 0.0 {
            continue;
        }
        let shift = UNITS_PER_DEPTH * gap;
        let seen = [x - 0.7 * shift, y - shift];
        let soft = 0.006 + 0.6 * shift;
        let Some(place) = caster.shape.place_within(seen, soft) else { continue };
        let cover = (0.5 - place.distance / soft).clamp(0.0, 1.0);
        light *= 1.0 - 0.45 * cover * cover;
    }
    light.max(0.3) as f32
}

fn occupied_blocks(samples: &[[u16; 4]], width: usize, height: usize) -> Vec<bool> {
    let columns = width.div_ceil(BLOCK);
    let rows = height.div_ceil(BLOCK);
    let own: Vec<bool> = (0..columns * rows)
        .map(|block| {
            let (left, top) = (block % columns * BLOCK, block / columns * BLOCK);
            (top..(top + BLOCK).min(height))
                .any(|y| samples[y * width + left..y * width + (left + BLOCK).min(width)].iter().any(|s| s[3] > 0))
        })
        .collect();
    let at = |x: usize, y: usize| own[y * columns + x];
    (0..columns * rows)
        .map(|block| {
            let (x, y) = (block % columns, block / columns);
            (y.saturating_sub(1)..=(y + 1).min(rows - 1))
                .any(|y| (x.saturating_sub(1)..=(x + 1).min(columns - 1)).any(|x| at(x, y)))
        })
        .collect()
}

fn depth_range(frame: Frame, part: &Part, grid: Grid, samples: &[[u16; 4]]) -> [f64; 2] {
    let covered = samples.iter().enumerate().filter(|(_, sample)| sample[3] > 0);
    covered
        .map(|(at, _)| {
            let point = frame.to_scene(grid.sample_position((at % grid.width) as f64, (at / grid.width) as f64));
            part.relief.depth(point[0], point[1])
        })
        .fold([f64::INFINITY, f64::NEG_INFINITY], |range, depth| [range[0].min(depth), range[1].max(depth)])
}

impl Baked {
    fn new(grid: Grid, samples: Vec<[u16; 4]>, depths_at: Depths, depths: [f64; 2]) -> Self {
        let occupied = occupied_blocks(&samples, grid.width, grid.height);
        Self { grid, samples, occupied, depths_at, depths }
    }

    /// A part with a depth per sample; `None` when nothing of it is covered.
    pub(super) fn with_depths(grid: Grid, samples: Vec<[u16; 4]>, depths_at: Vec<f32>) -> Option<Self> {
        let covered = samples.iter().zip(&depths_at).filter(|(sample, _)| sample[3] > 0);
        let depths = covered.fold([f64::INFINITY, f64::NEG_INFINITY], |range, (_, &depth)| {
            [range[0].min(f64::from(depth)), range[1].max(f64::from(depth))]
        });
        (depths[0] <= depths[1]).then(|| Self::new(grid, samples, Depths::Sampled(depths_at), depths))
    }

    /// Depth at `px` of the reference picture, within the depths that the part has. It is defined beyond the outline,
    /// where the blur of the part goes.
    pub(super) fn depth(&self, px: [f64; 2]) -> f64 {
        let depth = match &self.depths_at {
            Depths::Relief(relief, frame) => {
                let point = frame.to_scene(px);
                relief.depth(point[0], point[1])
            }
            Depths::Sampled(depths_at) => self.sampled_depth(depths_at, px),
        };
        depth.clamp(self.depths[0], self.depths[1])
    }

    /// Bilinear, with repeated borders.
    fn sampled_depth(&self, depths_at: &[f32], px: [f64; 2]) -> f64 {
        let Grid { origin, per_px, width, height } = self.grid;
        let side =
            |axis: usize, count: usize| ((px[axis] - origin[axis]) * per_px as f64).clamp(0.0, (count - 1) as f64);
        let (x, y) = (side(0, width), side(1, height));
        let (left, top) = ((x as usize).min(width.saturating_sub(2)), (y as usize).min(height.saturating_sub(2)));
        let (s, t) = (x - left as f64, y - top as f64);
        let at = |dx: usize, dy: usize| {
            f64::from(depths_at[(top + dy).min(height - 1) * width + (left + dx).min(width - 1)])
        };
        let upper = at(0, 0) * (1.0 - s) + at(1, 0) * s;
        let lower = at(0, 1) * (1.0 - s) + at(1, 1) * s;
        upper * (1.0 - t) + lower * t
    }

    /// Left, top, right, bottom in px of the reference picture.
    pub(super) fn bounds(&self) -> [f64; 4] {
        let [x, y] = self.grid.origin;
        [x, y, x + self.grid.width as f64 * self.grid.step(), y + self.grid.height as f64 * self.grid.step()]
    }

    /// Colour and coverage at `px` of the reference picture, by Catmull-Rom interpolation: the last `C` of
    /// red, green, blue (premultiplied) and coverage.
    pub(super) fn sample<const C: usize>(&self, px: [f64; 2]) -> [f32; C] {
        let Grid { origin, per_px, width, height } = self.grid;
        let [x, y] = [0, 1].map(|axis| (px[axis] - origin[axis]) * per_px as f64);
        if !(x >= 0.0 && y >= 0.0 && x < width as f64 && y < height as f64) {
            return [0.0; C];
        }
        let (left, top) = (x as usize, y as usize);
        if !self.occupied[(top / BLOCK) * width.div_ceil(BLOCK) + left / BLOCK] {
            return [0.0; C];
        }
        let (across, down) = (catmull_rom((x - left as f64) as f32), catmull_rom((y - top as f64) as f32));
        let mut sum = [0.0_f32; C];
        for (j, weight_y) in down.into_iter().enumerate() {
            let Some(row) = (top + j).checked_sub(1).filter(|&row| row < height) else { continue };
            for (i, weight_x) in across.into_iter().enumerate() {
                let Some(column) = (left + i).checked_sub(1).filter(|&column| column < width) else { continue };
                let sample = self.samples[row * width + column];
                for channel in 0..C {
                    sum[channel] += weight_x * weight_y * f32::from(sample[4 - C + channel]);
                }
            }
        }
        sum.map(|value| (value / 65_535.0).clamp(0.0, 1.0))
    }
}

fn catmull_rom(t: f32) -> [f32; 4] {
    [
        0.5 * t * (t * (2.0 - t) - 1.0),
        0.5 * (t * t * (3.0 * t - 5.0) + 2.0),
        0.5 * t * (t * (4.0 - 3.0 * t) + 1.0),
        0.5 * t * t * (t - 1.0),
    ]
}
