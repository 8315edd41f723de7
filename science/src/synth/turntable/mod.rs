//! A specimen on a turntable, photographed from many directions: a scan with known poses.
//!
//! In: a [`Specimen`] in the coordinates of [`crate::types::view`], a [`Rig`] and the angles of a view. Out: a
//! [`Stage`] from which front-lit and back-lit slices and the truth are rendered as for any scene.
//!
//! Each limb is sampled once by rays through the centre of projection of the reference slice. The limbs are then
//! composited from far to near, each blurred by the circle of confusion of its own depth at each pixel. So a far limb
//! is also rendered where the defocus spread of a near one covers it. Where limbs penetrate each other, only the
//! surface of the nearer one is kept.

mod solid;
mod specimen;
mod surface;
#[cfg(test)]
mod tests;

use nalgebra::{Matrix3, RowVector3, Vector3};
use rayon::prelude::*;

pub use solid::Solid;
pub use specimen::{Limb, Specimen};
pub use surface::Surface;

use super::Rig;
use super::bake::{Baked, Grid, stored};
use super::noise::key;
use super::scene::Scene;
use super::stage::Stage;
use crate::types::view::ViewAngles;
use solid::{Hit, Ray};

/// Direction to the light in camera axes (x right, y down, z forward): from the upper left, beside the camera.
const TOWARDS_LIGHT: [f64; 3] = [-0.48, -0.6, -0.64];

/// A rig for scans: 65 mm lens with a sensor 36 mm wide at magnification 0.87 (0.86 with an even number of slices), in
/// focus from 11 mm before to 11 mm behind the point where the axes of the turntable meet. The sensor moves.
///
/// The aspect ratio is 3:2. Noise 1 of 255, drift, rotation and keystone are those of [`Rig::sized`].
pub fn scan_rig(width: usize, slices: usize) -> Rig {
    let base = Rig::sized(width, width * 2 / 3, slices);
    let (focal_mm, middle_mm, half_depth_mm) = (65.0, 141.0, 11.0);
    let sensor = |distance: f64| base.lens().conjugate(distance);
    let (first, last) = (sensor(middle_mm - half_depth_mm), sensor(middle_mm + half_depth_mm));
    let steps = slices.saturating_sub(1).max(1) as f64;
    let reference = slices / 2;
    let rail_mm: Vec<f64> = (0..slices).map(|i| first + (last - first) * i as f64 / steps).collect();
    let pixel_pitch_mm = 36.0 / width as f64;
    let d2 = rail_mm[reference];
    // one step of the rail is 2.4 px of blur diameter
    let aperture_mm = 2.4 * steps * pixel_pitch_mm * d2 / (first - last);
    Rig {
        focal_mm,
        f_number: focal_mm / aperture_mm,
        pixel_pitch_mm,
        magnification: d2 / focal_mm - 1.0,
        rail_mm,
        reference,
        softness_px: 0.5,
        ..base
    }
}

/// Distance of the centre of projection from the origin of the world, mm: the middle of the depths in focus.
pub fn scan_radius(rig: &Rig) -> f64 {
    (rig.object_distance(0.0) + rig.object_distance(1.0)) / 2.0
}

/// The specimen as the rig sees it at these angles, from [`scan_radius`].
pub fn view(rig: &Rig, specimen: &Specimen, angles: ViewAngles) -> Stage {
    let camera = Camera::new(rig, angles);
    let mut order: Vec<usize> = (0..specimen.limbs.len()).collect();
    // far ones first
    order.sort_by(|&a, &b| {
        let depth = |limb: usize| camera.depth(specimen.limbs[limb].solid.centre());
        depth(b).total_cmp(&depth(a))
    });
    let outlines: Vec<Option<[[f64; 2]; 2]>> = specimen.limbs.iter().map(|limb| camera.outline(&limb.solid)).collect();
    let parts = order.iter().enumerate().filter_map(|(place, &limb)| {
        let [low, high] = outlines[limb]?;
        let grid = Grid::covering(rig, low, high)?;
        let farther: Vec<(&Solid, [[f64; 2]; 2])> = order[..place]
            .iter()
            .filter_map(|&other| Some((&specimen.limbs[other].solid, outlines[other]?)))
            .filter(|(_, box_)| overlap(*box_, [low, high]))
            .collect();
        sample_limb(&camera, specimen, &specimen.limbs[limb], &farther, grid)
    });
    let number = key(&[angles.pan_deg.to_bits(), angles.tilt_deg.to_bits()]);
    let scene = Scene { parts: Vec::new(), ..Scene::insect(number) };
    Stage::of_parts(rig, scene, parts.collect(), number)
}

/// The centre of projection of the reference slice and its axes.
struct Camera<'a> {
    rig: &'a Rig,
    /// World to camera.
    rotation: Matrix3<f64>,
    centre: Vector3<f64>,
    /// Principal distance in px.
    focal_px: f64,
}

impl<'a> Camera<'a> {
    fn new(rig: &'a Rig, angles: ViewAngles) -> Self {
        let rotation = Matrix3::from_rows(&angles.rotation().map(RowVector3::from));
        let centre = scan_radius(rig) * Vector3::from(angles.direction());
        Self { rig, rotation, centre, focal_px: rig.principal_distance(rig.reference) / rig.pixel_pitch_mm }
    }

    /// Distance from the centre of projection along the optical axis, mm.
    fn depth(&self, point: Vector3<f64>) -> f64 {
        (self.rotation * (point - self.centre)).z
    }

    /// The ray of `px` of the reference picture. Distances along it are distances from the centre along the optical
    /// axis.
    fn ray(&self, px: [f64; 2]) -> Ray {
        let [cx, cy] = self.rig.centre();
        let towards = Vector3::new((px[0] - cx) / self.focal_px, (px[1] - cy) / self.focal_px, 1.0);
        Ray { from: self.centre, towards: self.rotation.tr_mul(&towards) }
    }

    /// A box in px around the picture of a solid; `None` when it reaches behind the lens.
    fn outline(&self, solid: &Solid) -> Option<[[f64; 2]; 2]> {
        let [cx, cy] = self.rig.centre();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for (centre, radius) in solid.balls() {
            let at = self.rotation * (centre - self.centre);
            let nearest = at.z - radius;
            if nearest <= 0.0 {
                return None;
            }
            for (axis, middle) in [cx, cy].into_iter().enumerate() {
                // the picture of the cube around the ball
                for corner in [at[axis] - radius, at[axis] + radius] {
                    for depth in [nearest, at.z + radius] {
                        let px = middle + self.focal_px * corner / depth;
                        (low[axis], high[axis]) = (low[axis].min(px), high[axis].max(px));
                    }
                }
            }
        }
        Some([low, high])
    }
}

fn overlap(a: [[f64; 2]; 2], b: [[f64; 2]; 2]) -> bool {
    (0..2).all(|axis| a[0][axis] <= b[1][axis] && b[0][axis] <= a[1][axis])
}

/// Colour, coverage and depth of one limb. `farther`: the limbs composited before this one. Where a ray meets one of
/// them first, this limb is left transparent.
fn sample_limb(
    camera: &Camera,
    specimen: &Specimen,
    limb: &Limb,
    farther: &[(&Solid, [[f64; 2]; 2])],
    grid: Grid,
) -> Option<Baked> {
    let pixel_mm = scan_radius(camera.rig) / camera.focal_px;
    let towards_light = camera.rotation.tr_mul(&Vector3::from(TOWARDS_LIGHT).normalize());
    let colour_at = |px: [f64; 2]| -> [f32; 4] {
        let ray = camera.ray(px);
        let Some(hit) = limb.solid.hit(&ray) else { return [0.0; 4] };
        let hidden = farther.iter().any(|(other, [low, high])| {
            let inside = (0..2).all(|axis| (low[axis]..=high[axis]).contains(&px[axis]));
            inside && other.hit(&ray).is_some_and(|other: Hit| other.distance < hit.distance)
        });
        if hidden {
            return [0.0; 4];
        }
        let cos_incidence = -hit.normal.dot(&ray.towards) / ray.towards.norm();
        let [red, green, blue] = specimen.colour(limb, &hit, pixel_mm, cos_incidence, &towards_light);
        [red, green, blue, 1.0]
    };
    // points half a step before each sample; the four around a sample are averaged
    let columns = grid.width + 1;
    let points: Vec<[f32; 4]> = (0..columns * (grid.height + 1))
        .into_par_iter()
        .map(|at| colour_at(grid.sample_position((at % columns) as f64 - 0.5, (at / columns) as f64 - 0.5)))
        .collect();
    let sample = |at: usize| {
        let (x, y) = (at % grid.width, at / grid.width);
        let ray = camera.ray(grid.sample_position(x as f64, y as f64));
        let distance = limb.solid.hit(&ray).map_or_else(|| limb.solid.nearest(&ray), |hit| hit.distance);
        let corner = y * columns + x;
        let around = [corner, corner + 1, corner + columns, corner + columns + 1].map(|point| points[point]);
        (stored(around), camera.rig.depth_of(distance) as f32)
    };
    let (samples, depths) = (0..grid.width * grid.height).into_par_iter().map(sample).unzip();
    Baked::with_depths(grid, samples, depths)
}
