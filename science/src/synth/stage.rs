//! A scene in front of a rig: renders slices and ground truth.

use rayon::prelude::*;

use super::Rig;
use super::bake::{Baked, Frame, bake};
use super::disc::{Discs, Patch};
use super::noise::{fractal, key};
use super::scene::Scene;
use super::sensor::{Light, expose, expose_clean, quantise};
use crate::imaging::{Plane, Raster};
use crate::types::Homography;
use crate::types::profile::CaptureMode;

/// Side of the tiles in which images are rendered, px.
const TILE: usize = 96;

/// The ground truth of a stack: the results of a perfect method.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// The front-lit image in the geometry of the reference slice, with everything in focus, without noise, with the
    /// exposure and the vignetting of the reference slice.
    pub sharp: Raster,
    /// 255 where the object covers at least half of the pixel, else 0.
    pub mask: Plane<u8>,
    /// Fraction of the pixel that the object covers; 255 is all of it.
    pub cover: Plane<u8>,
    /// Index of the slice in which the pixel is in focus, fractional between slices; NaN on the background.
    pub slice: Plane<f32>,
}

/// A scene that has been sampled for a rig, from which any slice can be rendered.
///
/// Parts are composited from far to near. Colour and coverage of each are blurred by the circle of confusion of its
/// depth at each pixel. So the defocus spread of a near part covers the far part beyond its outline, as with a real
/// lens.
#[derive(Debug)]
pub struct Stage {
    rig: Rig,
    scene: Scene,
    frame: Frame,
    parts: Vec<Baked>,
    /// Makes the noise of one view of a scan independent of that of another.
    noise_salt: u64,
}

/// The geometry of a slice: slice px -> ideal slice px, and from there by depth to the reference.
struct SliceGeometry {
    straight: Homography,
    /// `None` for the pinhole image of the ground truth.
    slice: Option<usize>,
}

impl Stage {
    /// Samples `scene` for `rig`. Memory per part: 32 bytes per pixel of its bounding box, 8 in pictures of more than
    /// 6 MP; up to three times as much while it is sampled.
    pub fn new(rig: &Rig, scene: &Scene) -> Self {
        let parts = bake(rig, &scene.parts);
        Self { rig: rig.clone(), scene: scene.clone(), frame: Frame::of(rig), parts, noise_salt: 0 }
    }

    /// A stage with parts that were sampled elsewhere, far ones first. Background and back light are those of `scene`,
    /// whose own parts are not rendered. Stages with different `noise_salt` have different noise.
    pub(super) fn of_parts(rig: &Rig, scene: Scene, parts: Vec<Baked>, noise_salt: u64) -> Self {
        Self { rig: rig.clone(), scene, frame: Frame::of(rig), parts, noise_salt }
    }

    /// The rig.
    pub fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Slice `i` as the camera stores it.
    ///
    /// # Panics
    /// When the rig has no slice `i`.
    pub fn render(&self, light: Light, i: usize) -> Raster {
        let straight = self.rig.disturbance(i).try_inverse().and_then(|back| Homography::from_matrix(&back));
        let view = SliceGeometry { straight: straight.unwrap_or(Homography::IDENTITY), slice: Some(i) };
        let picture = match light {
            Light::Front => self.front(&view),
            Light::Back => self.back(&view),
        };
        expose(&self.rig, i, self.noise_salt ^ (light as u64 + 1), copy_rows(&picture, self.rig.width))
    }

    /// The truth, in the geometry of the reference slice.
    pub fn truth(&self) -> Truth {
        let rig = &self.rig;
        let view = SliceGeometry { straight: Homography::IDENTITY, slice: None };
        let picture = self.front(&view);
        let light = expose_clean(rig, 1.0, copy_rows(&picture, rig.width));
        let sharp = quantise(rig, &light, |_, value| value);
        let coverage = self.coverage();
        let mask = coverage.iter().map(|&[cover]| if cover >= 0.5 { 255 } else { 0 }).collect();
        let cover = coverage.iter().map(|&[cover]| (255.0 * cover).round() as u8).collect();
        let slice = (0..rig.width * rig.height)
            .into_par_iter()
            .map(|at| self.slice_in_focus(at % rig.width, at / rig.width))
            .collect();
        let bytes = |data: Vec<u8>| Plane { width: rig.width, height: rig.height, data };
        let slice = Plane { width: rig.width, height: rig.height, data: slice };
        Truth { sharp, mask: bytes(mask), cover: bytes(cover), slice }
    }

    /// [`Truth::mask`] alone, without the rest of the truth.
    pub fn mask(&self) -> Plane<u8> {
        let data = self.coverage().iter().map(|&[cover]| if cover >= 0.5 { 255 } else { 0 }).collect();
        Plane { width: self.rig.width, height: self.rig.height, data }
    }

    /// Fraction of each pixel that the object covers.
    fn coverage(&self) -> Vec<[f32; 1]> {
        let view = SliceGeometry { straight: Homography::IDENTITY, slice: None };
        self.picture::<1>(&view, |_| [0.0], |[below], [cover]| [below * (1.0 - cover) + cover])
    }

    /// The part that contributes most to the pixel decides.
    fn slice_in_focus(&self, x: usize, y: usize) -> f32 {
        let px = [x as f64, y as f64];
        let (mut left, mut best, mut nearest) = (1.0_f32, 0.0_f32, None);
        for part in self.parts.iter().rev() {
            let [cover] = part.sample::<1>(px);
            if left * cover > best {
                (best, nearest) = (left * cover, Some(part));
            }
            left *= 1.0 - cover;
        }
        match nearest {
            Some(part) if left <= 0.5 => self.rig.slice_in_focus(part.depth(px)) as f32,
            _ => f32::NAN,
        }
    }

    fn front(&self, view: &SliceGeometry) -> Vec<[f32; 3]> {
        let background = |px| self.background(px);
        self.picture::<4>(view, background, |below, part| {
            std::array::from_fn(|channel| below[channel] * (1.0 - part[3]) + part[channel])
        })
        .into_iter()
        .map(|[red, green, blue, _]| [red, green, blue])
        .collect()
    }

    fn back(&self, view: &SliceGeometry) -> Vec<[f32; 3]> {
        let shade = self.scene.shade;
        let field = |px| [self.back_light(px)];
        let picture = self.picture::<1>(view, field, |[below], [cover]| [below * (1.0 - cover) + shade * cover]);
        picture.into_iter().map(|[grey]| [grey; 3]).collect()
    }

    /// Colour of the background seen at `px` of the reference picture: it is too far away for any detail.
    fn background(&self, px: [f64; 2]) -> [f32; 4] {
        let [x, y] = self.frame.to_scene(px);
        let cloud = 1.0 + self.scene.clouds * fractal(self.scene.seed ^ key(&[0xc10d]), 3.0 * x, 3.0 * y, 2, 0.4, 0.01);
        let rising = 1.0 - 0.16 * y as f32;
        let [red, green, blue] = self.scene.background.map(|value| (value * cloud * rising).clamp(0.0, 1.0));
        [red, green, blue, 0.0]
    }

    fn back_light(&self, px: [f64; 2]) -> f32 {
        let [x, y] = self.frame.to_scene(px);
        let squared = (x * x + y * y) as f32;
        self.scene.back_light * (1.0 - self.scene.back_light_falloff * (1.4 * squared).min(1.0))
    }

    /// Renders tile by tile: `ground` by reference px, then `over` for each part from far to near.
    fn picture<const C: usize>(
        &self,
        view: &SliceGeometry,
        ground: impl Fn([f64; 2]) -> [f32; C] + Sync,
        over: impl Fn([f32; C], [f32; C]) -> [f32; C] + Sync,
    ) -> Vec<[f32; C]> {
        let (width, height) = (self.rig.width, self.rig.height);
        let largest = view.slice.map_or(0.0, |i| {
            let radii = self.parts.iter().flat_map(|part| part.depths).map(|depth| self.rig.blur_radius_px(i, depth));
            radii.fold(0.0, f64::max)
        });
        let discs = Discs::up_to(largest);
        // with a fixed lens every depth is seen at the same pixel
        let depths_coincide = view.slice.is_some() && self.rig.mode == CaptureMode::FixedLens;
        let columns = width.div_ceil(TILE);
        let tiles: Vec<Vec<[f32; C]>> = (0..columns * height.div_ceil(TILE))
            .into_par_iter()
            .map(|tile| {
                let mut area = Area::new(tile % columns * TILE, tile / columns * TILE, width, height);
                let ground_at = |x: usize, y: usize| ground(self.to_reference(view, [x as f64, y as f64], None));
                let mut out: Vec<[f32; C]> = area.pixels().map(|(x, y)| ground_at(x, y)).collect();
                area.seen = depths_coincide.then(|| ReferencePositions::new(self, view, &area, margin(largest)));
                for part in &self.parts {
                    self.lay_over(view, part, &area, &discs, &mut out, &over);
                }
                out
            })
            .collect();
        let mut picture = vec![[0.0; C]; width * height];
        for (tile, pixels) in tiles.into_iter().enumerate() {
            let area = Area::new(tile % columns * TILE, tile / columns * TILE, width, height);
            for (row, source) in pixels.chunks_exact(area.width).enumerate() {
                let start = (area.y + row) * width + area.x;
                picture[start..start + area.width].copy_from_slice(source);
            }
        }
        picture
    }

    fn lay_over<const C: usize>(
        &self,
        view: &SliceGeometry,
        part: &Baked,
        area: &Area,
        discs: &Discs,
        out: &mut [[f32; C]],
        over: &impl Fn([f32; C], [f32; C]) -> [f32; C],
    ) {
        let blur_at = |depth: f64| view.slice.map_or(0.0, |i| self.rig.blur_radius_px(i, depth));
        let margin = margin(part.depths.into_iter().map(blur_at).fold(0.0, f64::max));
        if !self.touches(view, part, area, margin as f64) {
            return;
        }
        let (width, height) = (area.width + 2 * margin, area.height + 2 * margin);
        let look = |x: usize, y: usize| {
            if let Some(seen) = &area.seen {
                return seen.at(x, y, margin);
            }
            let at = [(area.x + x) as f64 - margin as f64, (area.y + y) as f64 - margin as f64];
            self.to_reference(view, at, Some(part))
        };
        let mut samples = Vec::with_capacity(width * height);
        // per row of the patch: the columns that are covered
        let mut covered = vec![(usize::MAX, 0); height];
        for (y, (first, end)) in covered.iter_mut().enumerate() {
            for x in 0..width {
                let sample = part.sample::<C>(look(x, y));
                if sample[C - 1] > 0.0 {
                    (*first, *end) = ((*first).min(x), x + 1);
                }
                samples.push(sample);
            }
        }
        if covered.iter().all(|&(_, end)| end == 0) {
            return;
        }
        let patch = Patch::new(width, height, &samples);
        for (y, row) in out.chunks_exact_mut(area.width).enumerate() {
            let within_reach = &covered[y..=y + 2 * margin];
            let first = within_reach.iter().map(|rows| rows.0).min().unwrap_or(usize::MAX);
            let end = within_reach.iter().map(|rows| rows.1).max().unwrap_or(0);
            // patch column x + margin can reach from x to x + 2 margin
            let from = first.saturating_sub(2 * margin).min(area.width);
            for (x, below) in row.iter_mut().enumerate().take(end).skip(from) {
                let (x, y) = (x + margin, y + margin);
                let blur = blur_at(part.depth(look(x, y)));
                let mean = patch.mean(discs, x, y, blur as f32).map(|value| value.clamp(0.0, 1.0));
                *below = over(*below, mean);
            }
        }
    }

    /// Px of the reference picture that is seen at `px` of the slice, at the depth of `part` (or at the
    /// depth of the background: that of the last slice).
    fn to_reference(&self, view: &SliceGeometry, px: [f64; 2], part: Option<&Baked>) -> [f64; 2] {
        let Some(i) = view.slice else { return px };
        let ideal = view.straight.apply(px);
        let [cx, cy] = self.rig.centre();
        let at_depth = |depth: f64| {
            let scale = self.rig.scale(i, depth);
            [cx + (ideal[0] - cx) / scale, cy + (ideal[1] - cy) / scale]
        };
        let Some(part) = part else { return at_depth(1.0) };
        let middle = (part.depths[0] + part.depths[1]) / 2.0;
        let first = at_depth(middle);
        if self.rig.mode == CaptureMode::FixedLens {
            return first;
        }
        // with a moving lens the position depends on the depth, which depends a little on the position
        at_depth(part.depth(at_depth(part.depth(first))))
    }

    /// Whether `area` grown by `margin` can see `part`: by its corners, with a margin for the keystone.
    fn touches(&self, view: &SliceGeometry, part: &Baked, area: &Area, margin: f64) -> bool {
        let (left, top) = (area.x as f64 - margin, area.y as f64 - margin);
        let (right, bottom) = ((area.x + area.width) as f64 + margin, (area.y + area.height) as f64 + margin);
        let corners = [[left, top], [right, top], [left, bottom], [right, bottom]]
            .map(|corner| self.to_reference(view, corner, Some(part)));
        let bounds = part.bounds();
        const KEYSTONE_MARGIN_PX: f64 = 3.0;
        let beyond = |axis: usize| {
            corners.iter().all(|corner| corner[axis] < bounds[axis] - KEYSTONE_MARGIN_PX)
                || corners.iter().all(|corner| corner[axis] > bounds[axis + 2] + KEYSTONE_MARGIN_PX)
        };
        !beyond(0) && !beyond(1)
    }
}

/// Px around a tile that blur of `radius` px brings into it.
fn margin(radius: f64) -> usize {
    radius.ceil() as usize + 1
}

/// Per pixel of a tile and its margin: the px of the reference picture that is seen there, where it is the same for all
/// depths.
struct ReferencePositions {
    margin: usize,
    width: usize,
    positions: Vec<[f64; 2]>,
}

impl ReferencePositions {
    fn new(stage: &Stage, view: &SliceGeometry, area: &Area, margin: usize) -> Self {
        let (width, height) = (area.width + 2 * margin, area.height + 2 * margin);
        let position = |k: usize| {
            let at = |start: usize, by: usize| (start + by) as f64 - margin as f64;
            stage.to_reference(view, [at(area.x, k % width), at(area.y, k / width)], None)
        };
        Self { margin, width, positions: (0..width * height).map(position).collect() }
    }

    /// What is seen at pixel (x, y) of the tile with a margin of `margin` px, which is at most the margin of all.
    fn at(&self, x: usize, y: usize, margin: usize) -> [f64; 2] {
        let by = self.margin - margin;
        self.positions[(y + by) * self.width + x + by]
    }
}

/// A tile of the picture.
struct Area {
    x: usize,
    y: usize,
    width: usize,
    height: usize,
    /// What its pixels see of the reference picture.
    seen: Option<ReferencePositions>,
}

impl Area {
    fn new(x: usize, y: usize, width: usize, height: usize) -> Self {
        Self { x, y, width: TILE.min(width - x), height: TILE.min(height - y), seen: None }
    }

    fn pixels(&self) -> impl Iterator<Item = (usize, usize)> {
        (self.y..self.y + self.height).flat_map(move |y| (self.x..self.x + self.width).map(move |x| (x, y)))
    }
}

fn copy_rows(picture: &[[f32; 3]], width: usize) -> impl Fn(usize, &mut [[f32; 3]]) + Sync {
    move |y, row| row.copy_from_slice(&picture[y * width..(y + 1) * width])
}
