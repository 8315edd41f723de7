//! Triangle meshes, and what follows from their geometry.

/// A closed surface of triangles.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// The vertices, in the unit of the world.
    pub positions: Vec<[f32; 3]>,
    /// Outward unit normals of the vertices.
    pub normals: Vec<[f32; 3]>,
    /// Colours of the vertices, gamma-encoded RGB as the pictures have them; empty without pictures.
    pub colours: Vec<[u8; 3]>,
    /// Three indices of vertices each, anticlockwise when seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// The corners of a triangle.
    fn corners(&self, triangle: &[u32; 3]) -> [[f64; 3]; 3] {
        triangle.map(|at| self.positions[at as usize].map(f64::from))
    }

    /// The volume that the surface encloses, in the cube of the unit of the world.
    pub fn volume(&self) -> f64 {
        // from a point of the mesh, so that a mesh far from the origin is as exact
        let origin = self.positions.first().map_or([0.0; 3], |first| first.map(f64::from));
        let tetrahedron = |triangle: &[u32; 3]| {
            let [a, b, c] = self.corners(triangle).map(|corner| minus(corner, origin));
            dot(a, cross(b, c)) / 6.0
        };
        self.triangles.iter().map(tetrahedron).sum()
    }

    /// The area of the surface, in the square of the unit of the world.
    pub fn area(&self) -> f64 {
        self.triangles.iter().map(|triangle| 0.5 * length(self.doubled_normal(triangle))).sum()
    }

    /// The bounding box: its lowest and highest coordinates; `None` of an empty mesh.
    pub fn bounds(&self) -> Option<[[f32; 3]; 2]> {
        let first = *self.positions.first()?;
        Some(self.positions.iter().fold([first, first], |[low, high], point| {
            [[0, 1, 2].map(|axis| low[axis].min(point[axis])), [0, 1, 2].map(|axis| high[axis].max(point[axis]))]
        }))
    }

    /// Normal of a triangle, of twice its area.
    fn doubled_normal(&self, triangle: &[u32; 3]) -> [f64; 3] {
        let [a, b, c] = self.corners(triangle);
        cross(minus(b, a), minus(c, a))
    }

    /// Computes the normals of the vertices: the mean of those of their triangles, by area.
    pub(super) fn add_normals(&mut self) {
        let mut sums = vec![[0.0_f64; 3]; self.positions.len()];
        for triangle in &self.triangles {
            let normal = self.doubled_normal(triangle);
            for &at in triangle {
                let sum = &mut sums[at as usize];
                *sum = [0, 1, 2].map(|axis| sum[axis] + normal[axis]);
            }
        }
        let unit = |sum: [f64; 3]| match length(sum) {
            0.0 => [0.0, 0.0, 1.0],
            length => sum.map(|value| (value / length) as f32),
        };
        self.normals = sums.into_iter().map(unit).collect();
    }

    /// Multiplies all coordinates.
    pub(super) fn scale(&mut self, factor: f64) {
        for position in &mut self.positions {
            *position = position.map(|value| (f64::from(value) * factor) as f32);
        }
    }

    /// Keeps the connected parts with at least this share of the volume of the largest; returns how many parts were
    /// removed.
    pub(super) fn remove_small_parts(&mut self, least_share: f64) -> usize {
        let mut roots: Vec<u32> = (0..self.positions.len() as u32).collect();
        for &[a, b, c] in &self.triangles {
            for (a, b) in [(a, b), (b, c)] {
                let (a, b) = (root(&mut roots, a), root(&mut roots, b));
                roots[a.max(b) as usize] = a.min(b);
            }
        }
        let origin = self.positions.first().map_or([0.0; 3], |first| first.map(f64::from));
        let mut volumes = vec![0.0; self.positions.len()];
        for triangle in &self.triangles {
            let [a, b, c] = self.corners(triangle).map(|corner| minus(corner, origin));
            volumes[root(&mut roots, triangle[0]) as usize] += dot(a, cross(b, c)) / 6.0;
        }
        let least = least_share * volumes.iter().copied().fold(0.0, f64::max);
        let is_root = |at: &usize| roots[*at] as usize == *at;
        let small = (0..roots.len()).filter(is_root).filter(|&at| volumes[at] < least).count();
        if small == 0 {
            return 0;
        }
        let is_kept: Vec<bool> =
            (0..roots.len() as u32).map(|at| volumes[root(&mut roots, at) as usize] >= least).collect();
        let mut count = 0;
        let kept_index = |kept: &bool| {
            count += u32::from(*kept);
            count.saturating_sub(1)
        };
        let new: Vec<u32> = is_kept.iter().map(kept_index).collect();
        let keep = |(position, kept): (&[f32; 3], &bool)| kept.then_some(*position);
        self.positions = self.positions.iter().zip(&is_kept).filter_map(keep).collect();
        self.triangles.retain(|triangle| is_kept[triangle[0] as usize]);
        for triangle in &mut self.triangles {
            *triangle = triangle.map(|at| new[at as usize]);
        }
        small
    }
}

/// The first vertex of the part of a vertex, with shorter ways on the way.
fn root(roots: &mut [u32], mut at: u32) -> u32 {
    while roots[at as usize] != at {
        roots[at as usize] = roots[roots[at as usize] as usize];
        at = roots[at as usize];
    }
    at
}

pub(super) fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|axis| a[axis] - b[axis])
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn length(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}
