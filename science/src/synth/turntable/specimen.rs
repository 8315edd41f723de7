//! A beetle in three dimensions, with a surface that gives features to match.

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::super::noise::{between, key, lattice_3d, uniform};
use super::solid::{Hit, Solid};

/// Spots per mm of the surface, along a line.
const SPOTS_PER_MM: f64 = 0.75;
/// Distance of the points of the coarsest grain, mm.
const COARSEST_MM: f64 = 2.0;
const OCTAVES: u32 = 5;
/// Strength of each octave of the grain in relation to the coarser one.
const ROUGHNESS: f32 = 0.85;

/// A body of [`Limb`]s about the origin of the world, in the coordinates of [`crate::types::view`]. Lengths in mm.
#[derive(Debug, Clone, PartialEq)]
pub struct Specimen {
    /// Its parts. They may penetrate each other.
    pub limbs: Vec<Limb>,
    seed: u64,
    /// How far it was moved: its surface moves with it.
    moved_by: Vector3<f64>,
}

/// A part of a specimen.
#[derive(Debug, Clone, PartialEq)]
pub struct Limb {
    /// Its shape.
    pub solid: Solid,
    /// Its colour, linear RGB 0..1.
    pub colour: [f32; 3],
}

impl Specimen {
    /// A beetle that hangs head down, as one that is pinned to a turntable: wing cases, thorax, head, six legs in three
    /// segments, two antennae. It fits into a cylinder about the z axis, 20 mm wide and high. Marbling and dark and
    /// bright patches of its surface follow from `seed`, as does how the legs bend.
    pub fn beetle(seed: u64) -> Self {
        const SHELL: [f32; 3] = [0.42, 0.30, 0.16];
        const PLATE: [f32; 3] = [0.34, 0.33, 0.24];
        const LEG: [f32; 3] = [0.46, 0.27, 0.13];
        let limb = |solid, colour| Limb { solid, colour };
        let mut limbs = vec![
            limb(ellipsoid([0.0, 0.0, 2.6], [4.6, 4.2, 6.2], [0.12, -0.08, 0.3]), SHELL),
            limb(ellipsoid([0.4, 0.0, -3.6], [3.5, 3.4, 2.7], [0.0, 0.15, 0.0]), PLATE),
            limb(ellipsoid([0.7, 0.0, -6.6], [2.2, 2.4, 1.9], [0.0, 0.25, 0.4]), SHELL),
            limb(ellipsoid([1.6, 1.7, -7.2], [0.7, 0.7, 0.8], [0.0; 3]), PLATE),
            limb(ellipsoid([1.6, -1.7, -7.2], [0.7, 0.7, 0.8], [0.0; 3]), PLATE),
        ];
        for leg in 0..6_u64 {
            let side = if leg % 2 == 0 { 1.0 } else { -1.0 };
            let pair = (leg / 2) as f64;
            let jitter = |axis: u64| between(key(&[seed, 0x1e9, leg, axis]), -0.5, 0.5);
            let hip = Vector3::new(1.2 - 0.5 * pair, side * 2.6, -4.4 + 1.5 * pair);
            let knee = hip + Vector3::new(1.9 - 1.7 * pair + jitter(0), side * 2.6, 0.6 * pair - 1.4 + jitter(1));
            let ankle = knee + Vector3::new(0.6 - 0.9 * pair, side * 1.7, -0.6 + 1.6 * pair + jitter(2));
            let claw = ankle + Vector3::new(0.5 + jitter(3), side * 0.8, 1.4 * pair - 1.6);
            for (from, to, radius) in [(hip, knee, 0.62), (knee, ankle, 0.45), (ankle, claw, 0.3)] {
                limbs.push(limb(Solid::Capsule { from, to, radius }, LEG));
            }
        }
        for side in [1.0, -1.0] {
            let root = Vector3::new(2.0, side * 1.1, -7.9);
            let bend = root + Vector3::new(1.6, side * 1.2, -0.7);
            let tip = bend + Vector3::new(0.4, side * 1.9, 0.9);
            for (from, to, radius) in [(root, bend, 0.28), (bend, tip, 0.22)] {
                limbs.push(limb(Solid::Capsule { from, to, radius }, PLATE));
            }
        }
        Self { limbs, seed, moved_by: Vector3::zeros() }
    }

    /// The same specimen elsewhere, `by` mm.
    #[must_use]
    pub fn moved(mut self, by: [f64; 3]) -> Self {
        let by = Vector3::from(by);
        self.limbs.iter_mut().for_each(|limb| limb.solid.shift(by));
        self.moved_by += by;
        self
    }

    /// Linear RGB of a limb where a ray meets it. `pixel_mm` is the width of a pixel on a surface that faces the
    /// camera, `cos_incidence` the cosine between the normal and the direction to the camera, `towards_light` a unit
    /// vector.
    pub(super) fn colour(
        &self,
        limb: &Limb,
        hit: &Hit,
        pixel_mm: f64,
        cos_incidence: f64,
        towards_light: &Vector3<f64>,
    ) -> [f32; 3] {
        // a slanted surface shows more of its length per pixel: what is finer than that would only alias
        let finest = 1.2 * pixel_mm / cos_incidence.max(0.1);
        let at = hit.point - self.moved_by;
        let (marble, spot) = (grain(self.seed, at, finest), spot(self.seed, at, finest));
        let diffuse = 0.62 + 0.38 * hit.normal.dot(towards_light).max(0.0) as f32;
        let tone = diffuse * (1.25 * marble).exp() * spot;
        limb.colour.map(|value| (value * tone).clamp(0.004, 1.0))
    }
}

fn ellipsoid(centre: [f64; 3], radii: [f64; 3], angles: [f64; 3]) -> Solid {
    let turn: Matrix3<f64> = Rotation3::from_euler_angles(angles[0], angles[1], angles[2]).into_inner();
    Solid::Ellipsoid { centre: centre.into(), turn, radii: radii.into() }
}

/// Octaves of noise in space, about -1..1. Those finer than `finest` mm fade out.
fn grain(seed: u64, point: Vector3<f64>, finest: f64) -> f32 {
    let (mut sum, mut total, mut strength, mut distance) = (0.0, 0.0, 1.0, COARSEST_MM);
    for octave in 0..OCTAVES {
        let visible = (distance / finest - 1.0).clamp(0.0, 1.0) as f32;
        if visible > 0.0 {
            let scaled = (point / distance).into();
            sum += strength * visible * lattice_3d(key(&[seed, u64::from(octave)]), scaled);
        }
        total += strength;
        strength *= ROUGHNESS;
        distance /= 2.03;
    }
    1.9 * sum / total
}

/// Balls on a jittered lattice, dark or bright; the factor by which they change the surface that cuts them.
fn spot(seed: u64, point: Vector3<f64>, finest: f64) -> f32 {
    let at = point * SPOTS_PER_MM;
    let first = at.map(|x| (x - 0.5).floor());
    let mut factor = 1.0;
    for corner in 0..8_u64 {
        let cell = first + Vector3::new((corner & 1) as f64, (corner >> 1 & 1) as f64, (corner >> 2) as f64);
        let random =
            |what: u64| key(&[seed, 0x5907, cell.x as i64 as u64, cell.y as i64 as u64, cell.z as i64 as u64, what]);
        let middle = cell + Vector3::from_fn(|axis, _| 0.5 + between(random(axis as u64), -0.22, 0.22));
        let radius = between(random(3), 0.14, 0.42);
        let edge = (finest * SPOTS_PER_MM).max(0.03);
        let cover = (0.5 + (radius - (at - middle).norm()) / edge).clamp(0.0, 1.0) as f32;
        let strength = if uniform(random(4)) < 0.5 { 0.35 } else { 1.9 };
        factor *= 1.0 + cover * (strength - 1.0);
    }
    factor
}

#[cfg(test)]
mod tests {
    use super::super::solid::Ray;
    use super::*;

    #[test]
    fn the_beetle_fits_into_a_cylinder_about_the_axis() {
        for seed in 0..20 {
            for limb in Specimen::beetle(seed).limbs {
                for (centre, radius) in limb.solid.balls() {
                    assert!(centre.z.abs() + radius < 10.0, "{limb:?}");
                    assert!(centre.xy().norm() + radius < 10.0, "{limb:?}");
                }
            }
        }
    }

    #[test]
    fn a_moved_specimen_takes_its_surface_with_it() {
        let ray = |y: f64| Ray { from: Vector3::new(100.0, y, 0.3), towards: Vector3::new(-1.0, 0.0, 0.0) };
        let colour = |specimen: &Specimen, ray: &Ray| {
            let limb = &specimen.limbs[0];
            let hit = limb.solid.hit(ray).expect("it is hit");
            specimen.colour(limb, &hit, 0.05, 1.0, &Vector3::x())
        };
        let beetle = Specimen::beetle(3);
        let moved = beetle.clone().moved([0.0, 1.5, 0.0]);
        let apart = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(apart(colour(&beetle, &ray(0.2)), colour(&moved, &ray(1.7))) < 1e-3);
        assert!(apart(colour(&beetle, &ray(0.2)), colour(&moved, &ray(0.2))) > 1e-2);
    }

    #[test]
    fn the_surface_is_the_same_for_every_view_and_other_for_another_seed() {
        let point = Vector3::new(1.2, -0.7, 3.1);
        assert_eq!(grain(1, point, 0.05), grain(1, point, 0.05));
        let points = (0..50).map(|k| Vector3::new(0.13 * f64::from(k), 0.0, 1.0));
        let changed = points.filter(|&p| (grain(1, p, 0.05) - grain(2, p, 0.05)).abs() > 0.05).count();
        assert!(changed > 35, "{changed}");
    }
}
