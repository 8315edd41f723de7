//! Ellipsoids and capsules in space, and where a ray meets them.

use nalgebra::{Matrix3, Vector3};

/// A half line from the centre of projection.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ray {
    pub from: Vector3<f64>,
    /// Of any length: distances along the ray are in units of it.
    pub towards: Vector3<f64>,
}

impl Ray {
    fn at(&self, distance: f64) -> Vector3<f64> {
        self.from + distance * self.towards
    }
}

/// Where a ray meets a solid for the first time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hit {
    /// In units of [`Ray::towards`].
    pub distance: f64,
    pub point: Vector3<f64>,
    /// Outward unit normal.
    pub normal: Vector3<f64>,
}

/// A convex part of a specimen. Lengths in mm.
#[derive(Debug, Clone, PartialEq)]
pub enum Solid {
    /// All points `centre + turn * (a x, b y, c z)` with `x^2 + y^2 + z^2 <= 1`, where a, b, c are the radii.
    Ellipsoid {
        /// Its middle.
        centre: Vector3<f64>,
        /// Columns are the directions of the axes.
        turn: Matrix3<f64>,
        /// Half of each axis.
        radii: Vector3<f64>,
    },
    /// All points within `radius` of a line segment.
    Capsule {
        /// One end of the segment.
        from: Vector3<f64>,
        /// Its other end.
        to: Vector3<f64>,
        /// Half of its thickness.
        radius: f64,
    },
}

impl Solid {
    /// Moves it, mm.
    pub(super) fn shift(&mut self, by: Vector3<f64>) {
        match self {
            Self::Ellipsoid { centre, .. } => *centre += by,
            Self::Capsule { from, to, .. } => (*from, *to) = (*from + by, *to + by),
        }
    }

    /// Its middle.
    pub(super) fn centre(&self) -> Vector3<f64> {
        match self {
            Self::Ellipsoid { centre, .. } => *centre,
            Self::Capsule { from, to, .. } => (from + to) / 2.0,
        }
    }

    /// Balls that together contain the solid.
    pub(super) fn balls(&self) -> Vec<(Vector3<f64>, f64)> {
        match self {
            Self::Ellipsoid { centre, radii, .. } => vec![(*centre, radii.max())],
            Self::Capsule { from, to, radius } => vec![(*from, *radius), (*to, *radius)],
        }
    }

    /// Whether a point is inside or on the surface.
    pub(super) fn contains(&self, point: Vector3<f64>) -> bool {
        match self {
            Self::Ellipsoid { centre, turn, radii } => {
                turn.tr_mul(&(point - centre)).component_div(radii).norm_squared() <= 1.0
            }
            Self::Capsule { from, to, radius } => {
                let axis = to - from;
                let share = ((point - from).dot(&axis) / axis.norm_squared()).clamp(0.0, 1.0);
                (point - (from + share * axis)).norm_squared() <= radius * radius
            }
        }
    }

    /// The largest radius around the axis from pole to pole.
    pub(super) fn widest(&self) -> f64 {
        match self {
            Self::Ellipsoid { radii, .. } => radii.x.max(radii.y),
            Self::Capsule { radius, .. } => *radius,
        }
    }

    /// The point of the surface at this polar angle, 0 to pi from the first pole, and longitude, 0 to 2 pi. The poles
    /// of a capsule are its ends, the first one that of `to`; on its mantle `along` says where between `from` and `to`.
    pub(super) fn surface_point(&self, polar_angle: f64, longitude: f64, along: f64) -> Vector3<f64> {
        let (ring, pole) = polar_angle.sin_cos();
        let (y, x) = longitude.sin_cos();
        let unit = Vector3::new(ring * x, ring * y, pole);
        match self {
            Self::Ellipsoid { centre, turn, radii } => centre + turn * unit.component_mul(radii),
            Self::Capsule { from, to, radius } => {
                let axis = (to - from).normalize();
                let right = axis.cross(&Vector3::ith(axis.iamin(), 1.0)).normalize();
                let up = axis.cross(&right);
                from + along * (to - from) + *radius * (unit.x * right + unit.y * up + unit.z * axis)
            }
        }
    }

    /// The first point in which the ray enters the solid. The ray begins outside.
    pub(super) fn hit(&self, ray: &Ray) -> Option<Hit> {
        match self {
            Self::Ellipsoid { centre, turn, radii } => {
                let unit = unit_ball(ray, centre, turn, radii);
                let distance = first_root(unit.towards.norm_squared(), unit.from.dot(&unit.towards), {
                    unit.from.norm_squared() - 1.0
                })?;
                let normal = turn * unit.at(distance).component_div(radii);
                Some(Hit { distance, point: ray.at(distance), normal: normal.normalize() })
            }
            Self::Capsule { from, to, radius } => capsule_hit(ray, from, to, *radius),
        }
    }

    /// How far along the ray its point nearest to the solid is: to the centre of an ellipsoid in the coordinates in
    /// which it is a ball, or to the axis of a capsule. At the outline of the solid this is where the ray meets it.
    pub(super) fn nearest(&self, ray: &Ray) -> f64 {
        match self {
            Self::Ellipsoid { centre, turn, radii } => {
                let unit = unit_ball(ray, centre, turn, radii);
                -unit.from.dot(&unit.towards) / unit.towards.norm_squared()
            }
            Self::Capsule { from, to, .. } => nearest_to_line(ray, from, to).0,
        }
    }
}

/// The ray in coordinates in which the ellipsoid is the unit ball; distances along it stay.
fn unit_ball(ray: &Ray, centre: &Vector3<f64>, turn: &Matrix3<f64>, radii: &Vector3<f64>) -> Ray {
    Ray {
        from: turn.tr_mul(&(ray.from - centre)).component_div(radii),
        towards: turn.tr_mul(&ray.towards).component_div(radii),
    }
}

/// The smaller root of `a t^2 + 2 b t + c` if it is positive.
fn first_root(a: f64, b: f64, c: f64) -> Option<f64> {
    let discriminant = b * b - a * c;
    let root = (-b - discriminant.max(0.0).sqrt()) / a;
    (discriminant >= 0.0 && root > 0.0).then_some(root)
}

/// The ray meets the round mantle, or else the ball at one of the ends.
fn capsule_hit(ray: &Ray, from: &Vector3<f64>, to: &Vector3<f64>, radius: f64) -> Option<Hit> {
    let axis = to - from;
    let start = ray.from - from;
    let length_squared = axis.norm_squared();
    let (along, across) = (axis.dot(&ray.towards), axis.dot(&start));
    let mantle = first_root(
        length_squared * ray.towards.norm_squared() - along * along,
        length_squared * ray.towards.dot(&start) - across * along,
        length_squared * (start.norm_squared() - radius * radius) - across * across,
    )
    .filter(|distance| (0.0..=length_squared).contains(&(across + distance * along)));
    let ball = |centre: &Vector3<f64>| {
        let start = ray.from - centre;
        first_root(ray.towards.norm_squared(), ray.towards.dot(&start), start.norm_squared() - radius * radius)
    };
    let distance = mantle.into_iter().chain(ball(from)).chain(ball(to)).min_by(f64::total_cmp)?;
    let point = ray.at(distance);
    let share = ((point - from).dot(&axis) / length_squared).clamp(0.0, 1.0);
    Some(Hit { distance, point, normal: (point - (from + share * axis)).normalize() })
}

/// How far along the ray its point nearest to the line between two points is, and that distance.
fn nearest_to_line(ray: &Ray, from: &Vector3<f64>, to: &Vector3<f64>) -> (f64, f64) {
    let axis = to - from;
    let start = ray.from - from;
    let (a, b, c) = (ray.towards.norm_squared(), ray.towards.dot(&axis), axis.norm_squared());
    let (d, e) = (ray.towards.dot(&start), axis.dot(&start));
    let share = ((a * e - b * d) / (a * c - b * b).max(1e-12 * a * c)).clamp(0.0, 1.0);
    let distance = (share * b - d) / a;
    (distance, (ray.at(distance) - (from + share * axis)).norm())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    fn solids() -> [Solid; 2] {
        let turn = Rotation3::from_euler_angles(0.3, -0.5, 1.1).into_inner();
        [
            Solid::Ellipsoid { centre: Vector3::new(1.0, -0.5, 0.3), turn, radii: Vector3::new(4.0, 2.0, 1.5) },
            Solid::Capsule { from: Vector3::new(-2.0, 1.0, 0.0), to: Vector3::new(3.0, 0.5, 2.0), radius: 0.7 },
        ]
    }

    /// Zero on the surface, negative inside.
    fn level(solid: &Solid, point: Vector3<f64>) -> f64 {
        match solid {
            Solid::Ellipsoid { centre, turn, radii } => {
                turn.tr_mul(&(point - centre)).component_div(radii).norm() - 1.0
            }
            Solid::Capsule { from, to, radius } => {
                let axis = to - from;
                let share = ((point - from).dot(&axis) / axis.norm_squared()).clamp(0.0, 1.0);
                (point - (from + share * axis)).norm() - radius
            }
        }
    }

    fn ray(pan: f64, tilt: f64, aim: [f64; 3]) -> Ray {
        let from = 20.0 * Vector3::new(tilt.cos() * pan.cos(), tilt.cos() * pan.sin(), tilt.sin());
        Ray { from, towards: 0.1 * (Vector3::from(aim) - from) }
    }

    proptest! {
        #[test]
        fn a_ray_enters_where_it_first_meets_the_surface(
            pan in 0.0..6.3f64,
            tilt in -1.5..1.5f64,
            aim in [-5.0..5.0f64, -5.0..5.0f64, -5.0..5.0f64],
        ) {
            let ray = ray(pan, tilt, aim);
            for solid in solids() {
                let nearest = level(&solid, ray.at(solid.nearest(&ray)));
                let Some(hit) = solid.hit(&ray) else {
                    prop_assert!(nearest > -1e-9, "missed, though {nearest} inside");
                    continue;
                };
                prop_assert!(level(&solid, hit.point).abs() < 1e-9);
                prop_assert!(hit.normal.dot(&ray.towards) <= 1e-9, "it faces the camera");
                let outside = (0..50).map(|k| level(&solid, ray.at(hit.distance * f64::from(k) / 50.0)));
                prop_assert!(outside.into_iter().all(|level| level > 0.0), "nothing was met before");
                let along = |by: f64| level(&solid, hit.point + by * hit.normal);
                prop_assert!(along(1e-4) > 0.0 && along(-1e-4) < 0.0, "the normal points outwards");
            }
        }

        #[test]
        fn at_the_outline_the_nearest_point_is_where_the_ray_meets(
            pan in 0.0..6.3f64,
            tilt in -1.5..1.5f64,
            aim in [-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64],
        ) {
            for solid in solids() {
                // between a ray that hits and one that misses
                let at = |share: f64| {
                    let centre = solid.centre() + share * 8.0 * Vector3::from(aim).cross(&Vector3::new(0.3, 0.2, 1.0));
                    ray(pan, tilt, centre.into())
                };
                if solid.hit(&at(0.0)).is_none() || solid.hit(&at(1.0)).is_some() {
                    continue;
                }
                let (mut inside, mut outside) = (0.0, 1.0);
                for _ in 0..60 {
                    let middle = (inside + outside) / 2.0;
                    if solid.hit(&at(middle)).is_some() { inside = middle } else { outside = middle }
                }
                let edge = at(inside);
                let hit = solid.hit(&edge).expect("just inside");
                prop_assert!((hit.distance - solid.nearest(&edge)).abs() < 1e-3 * hit.distance);
            }
        }
    }
}
