//! Bodies whose surface is known, and their masks from a turntable.

use nalgebra::Vector3;

use super::super::{Mesh, ViewPictures};
use crate::{
    imaging::{Plane, Raster},
    types::{Error, pinhole::PinholeCamera, view::ViewAngles},
};

/// Distance of the cameras from the origin.
const RADIUS: f64 = 100.0;
/// Width and height of the pictures, px. What is 20 long at the origin appears 0.8 of it long.
pub(super) const SIDE: usize = 200;
/// Rays per pixel along each axis.
const RAYS: usize = 3;

/// Width of a pixel at the origin.
pub(super) const PIXEL: f64 = 20.0 / (0.8 * SIDE as f64);

/// A part of a body.
#[derive(Debug, Clone, Copy)]
pub(super) enum Shape {
    /// Middle and half axes.
    Ellipsoid([f64; 3], [f64; 3]),
    /// Half sides of a box about the origin.
    Box([f64; 3]),
    /// All points this near to a line between two points.
    Leg([f64; 3], [f64; 3], f64),
}

impl Shape {
    /// Distance of a point from the surface, negative inside; of an ellipsoid to first order.
    pub(super) fn distance(&self, point: [f64; 3]) -> f64 {
        let point = Vector3::from(point);
        match *self {
            Self::Ellipsoid(middle, radii) => {
                let unit = (point - Vector3::from(middle)).component_div(&Vector3::from(radii));
                let slope = unit.component_div(&Vector3::from(radii)).norm() / unit.norm().max(1e-9);
                (unit.norm() - 1.0) / slope.max(1e-9)
            }
            Self::Box(half) => {
                let over = point.abs() - Vector3::from(half);
                over.map(|over| over.max(0.0)).norm() + over.max().min(0.0)
            }
            Self::Leg(from, to, radius) => {
                let (from, to) = (Vector3::from(from), Vector3::from(to));
                let axis = to - from;
                let share = ((point - from).dot(&axis) / axis.norm_squared()).clamp(0.0, 1.0);
                (point - (from + share * axis)).norm() - radius
            }
        }
    }

    /// Whether a ray meets it.
    fn is_met(&self, from: Vector3<f64>, towards: Vector3<f64>) -> bool {
        match *self {
            Self::Ellipsoid(middle, radii) => {
                let start = (from - Vector3::from(middle)).component_div(&Vector3::from(radii));
                let along = towards.component_div(&Vector3::from(radii)).normalize();
                start.norm_squared() - start.dot(&along).powi(2) <= 1.0
            }
            Self::Box(half) => {
                let (mut first, mut last) = (f64::NEG_INFINITY, f64::INFINITY);
                for axis in 0..3 {
                    let [a, b] = [-half[axis], half[axis]].map(|side| (side - from[axis]) / towards[axis]);
                    (first, last) = (first.max(a.min(b)), last.min(a.max(b)));
                }
                first <= last
            }
            Self::Leg(a, b, radius) => {
                // the nearest points of the ray and the line between the ends
                let (a, axis) = (Vector3::from(a), Vector3::from(b) - Vector3::from(a));
                let (along, start) = (towards.normalize(), from - a);
                let (across, square) = (along.dot(&axis), axis.norm_squared());
                let slant = square - across * across;
                let share = (axis.dot(&start) - across * along.dot(&start)) / slant.max(1e-9 * square);
                let to_ray = a + share.clamp(0.0, 1.0) * axis - from;
                (to_ray - to_ray.dot(&along) * along).norm() <= radius
            }
        }
    }
}

/// Cameras around the z axis that look at the origin.
pub(super) fn turntable(pans: usize, tilts: &[f64]) -> Vec<PinholeCamera> {
    let camera = |pan: usize, tilt_deg: f64| {
        let angles = ViewAngles { pan_deg: 360.0 * pan as f64 / pans as f64, tilt_deg };
        PinholeCamera {
            rotation: angles.rotation(),
            centre: angles.direction().map(|c| RADIUS * c),
            focal_px: [RADIUS / PIXEL; 2],
            principal_point_px: [SIDE as f64 / 2.0 - 0.5; 2],
            radial: [0.0; 2],
            size: [SIDE; 2],
        }
    };
    tilts.iter().flat_map(|&tilt| (0..pans).map(move |pan| camera(pan, tilt))).collect()
}

/// The mask of a body: the share of the rays through each pixel that meet it.
pub(super) fn mask(body: &[Shape], camera: &PinholeCamera) -> Plane<u8> {
    Plane::from_fn(camera.size[0], camera.size[1], |x, y| {
        let ray = |at: usize| {
            let part = |at: usize| (at as f64 + 0.5) / RAYS as f64 - 0.5;
            let px = [x as f64 + part(at % RAYS), y as f64 + part(at / RAYS)];
            let towards = Vector3::from(camera.direction(px));
            body.iter().any(|shape| shape.is_met(camera.centre.into(), towards))
        };
        let met = (0..RAYS * RAYS).filter(|&at| ray(at)).count();
        (255 * met / (RAYS * RAYS)) as u8
    })
}

/// Masks and pictures in memory.
#[derive(Default)]
pub(super) struct Views {
    pub masks: Vec<Plane<u8>>,
    pub pictures: Vec<Raster>,
}

impl ViewPictures for Views {
    fn mask(&self, view: usize) -> Result<Plane<u8>, Error> {
        Ok(self.masks[view].clone())
    }

    fn picture(&self, view: usize) -> Result<Option<Raster>, Error> {
        Ok(self.pictures.get(view).cloned())
    }
}

/// Median and 95 % quantile of the distances of the vertices from the surface of a body, px.
pub(super) fn distances(mesh: &Mesh, body: &[Shape]) -> [f64; 2] {
    let of_point = |point: &[f32; 3]| {
        body.iter().map(|shape| shape.distance(point.map(f64::from))).fold(f64::INFINITY, f64::min).abs() / PIXEL
    };
    let mut found: Vec<f64> = mesh.positions.iter().map(of_point).collect();
    found.sort_by(f64::total_cmp);
    [0.5, 0.95].map(|share| found[(share * (found.len() - 1) as f64) as usize])
}

/// The edges that do not belong to exactly two triangles, once in each direction.
pub(super) fn open_edges(mesh: &Mesh) -> usize {
    let mut edges = std::collections::HashMap::<[u32; 2], i64>::new();
    for &[a, b, c] in &mesh.triangles {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            // one direction counts 1, the other 1 << 32
            *edges.entry([from.min(to), from.max(to)]).or_default() += if from < to { 1 } else { 1 << 32 };
        }
    }
    edges.values().filter(|count| **count != 1 + (1 << 32)).count()
}
