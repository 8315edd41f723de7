//! The surface of a specimen as triangles: what a reconstruction of its scan should find.
//!
//! Each limb is divided by lines of equal polar angle and longitude. Triangles that lie within another limb are left
//! out. Where limbs penetrate each other the triangles at the seam are kept whole, so they reach into the body by less
//! than the length of an edge.

use std::f64::consts::PI;
use std::io::{self, Write};

use nalgebra::Vector3;

use super::{Limb, Solid, Specimen};

/// Triangles in space, in mm, in the coordinates of [`crate::types::view`].
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    /// The corners. Those within another limb are used by no triangle, and poles are repeated.
    pub points: Vec<Vector3<f64>>,
    /// Three indices of corners each, anticlockwise when seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Surface {
    /// The outer surface of a specimen, with edges of about `edge_mm`, at most 1.5 times as long.
    pub fn of(specimen: &Specimen, edge_mm: f64) -> Self {
        let mut surface = Self { points: Vec::new(), triangles: Vec::new() };
        for (at, limb) in specimen.limbs.iter().enumerate() {
            let others: Vec<&Limb> =
                specimen.limbs.iter().enumerate().filter(|(other, _)| *other != at).map(|(_, limb)| limb).collect();
            surface.add(&limb.solid, &others, edge_mm);
        }
        surface
    }

    /// Adds what of a solid is not within the others.
    fn add(&mut self, solid: &Solid, others: &[&Limb], edge_mm: f64) {
        let first = self.points.len();
        let rows = rows(solid, edge_mm);
        let columns = ((2.0 * PI * solid.widest() / edge_mm).ceil() as usize).max(6);
        for &(polar_angle, along) in &rows {
            let around = (0..columns).map(|column| 2.0 * PI * column as f64 / columns as f64);
            self.points.extend(around.map(|longitude| solid.surface_point(polar_angle, longitude, along)));
        }
        let within: Vec<bool> =
            self.points[first..].iter().map(|&point| others.iter().any(|limb| limb.solid.contains(point))).collect();
        for row in 1..rows.len() {
            for column in 0..columns {
                let next = (column + 1) % columns;
                let corner = |row: usize, column: usize| row * columns + column;
                let [a, b] = [corner(row - 1, column), corner(row - 1, next)];
                let [c, d] = [corner(row, column), corner(row, next)];
                // at a pole all points of a row are one
                let upper = (row > 1).then_some([a, c, b]);
                let lower = (row < rows.len() - 1).then_some([b, c, d]);
                for triangle in upper.into_iter().chain(lower) {
                    if triangle.iter().any(|&at| !within[at]) {
                        self.triangles.push(triangle.map(|at| (first + at) as u32));
                    }
                }
            }
        }
    }

    /// Writes the triangles as binary PLY, which every program for meshes reads.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_ply(&self, mut out: impl Write) -> io::Result<()> {
        write!(
            out,
            "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty \
             float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
            self.points.len(),
            self.triangles.len()
        )?;
        for point in &self.points {
            for value in point.iter() {
                out.write_all(&(*value as f32).to_le_bytes())?;
            }
        }
        for triangle in &self.triangles {
            out.write_all(&[3])?;
            for at in triangle {
                out.write_all(&at.to_le_bytes())?;
            }
        }
        Ok(())
    }
}

/// Polar angle from pole to pole, 0 to pi, and with it how far along the line of a capsule, 0 to 1, each row of points
/// lies.
fn rows(solid: &Solid, edge_mm: f64) -> Vec<(f64, f64)> {
    let steps = |length: f64| ((length / edge_mm).ceil() as usize).max(3);
    let share = |step: usize, steps: usize| step as f64 / steps as f64;
    match solid {
        Solid::Ellipsoid { radii, .. } => {
            let steps = steps(PI * radii.max());
            (0..=steps).map(|step| (PI * share(step, steps), 0.0)).collect()
        }
        Solid::Capsule { from, to, radius } => {
            let (cap, mantle) = (steps(PI / 2.0 * radius), steps((to - from).norm()));
            let end = (0..=cap).map(|step| (PI / 2.0 * share(step, cap), 1.0));
            let line = (1..mantle).map(|step| (PI / 2.0, 1.0 - share(step, mantle)));
            let start = (0..=cap).map(|step| (PI / 2.0 * (1.0 + share(step, cap)), 0.0));
            end.chain(line).chain(start).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Rotation3};

    use super::*;

    fn specimen(solids: impl IntoIterator<Item = Solid>) -> Specimen {
        let mut specimen = Specimen::beetle(1);
        specimen.limbs = solids.into_iter().map(|solid| Limb { solid, colour: [0.5; 3] }).collect();
        specimen
    }

    fn ball(x: f64, radius: f64) -> Solid {
        Solid::Ellipsoid {
            centre: Vector3::new(x, 0.0, 0.0),
            turn: Matrix3::identity(),
            radii: Vector3::repeat(radius),
        }
    }

    fn corners(surface: &Surface) -> impl Iterator<Item = [Vector3<f64>; 3]> {
        surface.triangles.iter().map(|triangle| triangle.map(|at| surface.points[at as usize]))
    }

    fn area(surface: &Surface) -> f64 {
        corners(surface).map(|[a, b, c]| (b - a).cross(&(c - a)).norm() / 2.0).sum()
    }

    /// Of a closed surface whose triangles face outwards.
    fn volume(surface: &Surface) -> f64 {
        corners(surface).map(|[a, b, c]| a.dot(&b.cross(&c)) / 6.0).sum()
    }

    #[test]
    fn single_solids_have_their_area_and_volume() {
        let turn = Rotation3::from_euler_angles(0.3, -0.5, 1.1).into_inner();
        let ellipsoid =
            Solid::Ellipsoid { centre: Vector3::new(1.0, -2.0, 0.5), turn, radii: Vector3::new(3.0, 2.0, 1.0) };
        let surface = Surface::of(&specimen([ellipsoid]), 0.05);
        assert!((volume(&surface) / (4.0 / 3.0 * PI * 6.0) - 1.0).abs() < 2e-3, "{}", volume(&surface));

        let (from, to) = (Vector3::new(-1.0, 0.5, 0.0), Vector3::new(2.0, 0.5, 4.0));
        let surface = Surface::of(&specimen([Solid::Capsule { from, to, radius: 0.5 }]), 0.02);
        let expected = PI * 0.25 * 5.0 + 4.0 / 3.0 * PI * 0.125;
        assert!((volume(&surface) / expected - 1.0).abs() < 2e-3, "{}", volume(&surface));
        assert!((area(&surface) / (PI * 5.0 + PI) - 1.0).abs() < 2e-3, "{}", area(&surface));
    }

    #[test]
    fn what_is_within_another_limb_is_left_out() {
        // the planes of intersection cut a cap of height 1/2 from each of two unit balls one radius apart
        let both = Surface::of(&specimen([ball(0.0, 1.0), ball(1.0, 1.0)]), 0.01);
        let expected = 2.0 * (4.0 * PI - 2.0 * PI * 0.5);
        assert!((area(&both) / expected - 1.0).abs() < 0.01, "{}, expected {expected}", area(&both));
        let swallowed = Surface::of(&specimen([ball(0.0, 1.0), ball(0.2, 0.5)]), 0.05);
        assert!((area(&swallowed) / (4.0 * PI) - 1.0).abs() < 0.01);
    }

    #[test]
    fn the_corners_lie_on_the_beetle_and_edges_are_as_short_as_promised() {
        let beetle = Specimen::beetle(2);
        let surface = Surface::of(&beetle, 0.2);
        for triangle in corners(&surface) {
            for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                assert!((triangle[a] - triangle[b]).norm() < 0.3);
            }
            // each corner is on a limb: a little farther out, along a line through its middle, that limb has ended
            for corner in triangle {
                let on = |limb: &&Limb| {
                    let middle = limb.solid.centre();
                    let at = |share: f64| limb.solid.contains(middle + share * (corner - middle));
                    at(1.0 - 1e-6) && !at(1.0 + 1e-6)
                };
                assert!(beetle.limbs.iter().any(|limb| on(&limb)), "{corner:?}");
            }
        }
    }

    #[test]
    fn the_ply_file_has_the_size_that_its_header_says() {
        let surface = Surface::of(&specimen([ball(0.0, 1.0)]), 0.3);
        let mut file = Vec::new();
        surface.write_ply(&mut file).expect("written");
        let end = file.windows(11).position(|window| window == b"end_header\n").expect("a header") + 11;
        assert_eq!(file.len() - end, 12 * surface.points.len() + 13 * surface.triangles.len());
    }
}
