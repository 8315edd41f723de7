//! The surface in the blocks of the octree: marching cubes of the smallest signed distance over the views.
//!
//! At the corner of a cell each view gives the distance of its picture from the outline, converted to a length at the
//! depth of the corner, positive inside. The hull is where the smallest of them (or, with tolerated views, the smallest
//! but so many) is positive. A position on an edge of the grid follows by linear interpolation, so the surface is
//! smooth to a fraction of a cell.

use rayon::prelude::*;

use super::{
    cubes::{CORNERS, Edge, POLYGONS, Polygon},
    mesh::Mesh,
    octree::{BLOCK, Grid, Octree, Part},
};

/// Corners along each side of a block.
const SIDE: usize = BLOCK + 1;
/// Least distance of a vertex from the ends of its edge, as a share of it: no triangle has two equal corners.
const END_SHARE: f32 = 0.02;
/// Signed distances are at most so large, cells; only those of an edge that the surface crosses matter.
const FAR_CELLS: f32 = 100.0;
/// How far outside a corner is when no edge that begins there crosses the surface, cells.
const OUTSIDE_CELLS: f32 = 1.5;
/// Bits of a coordinate in a key.
const BITS: u32 = 20;
/// Code of the middle of a polygon in a key; lower ones are axes.
const MIDDLE: u64 = 3;

/// The surface in one block: vertices with keys, and triangles of their indices. The key of a vertex is the same in
/// every block that has it.
#[derive(Default)]
struct Piece {
    vertices: Vec<(u64, [f32; 3])>,
    triangles: Vec<[u32; 3]>,
}

/// The surface of the hull.
pub(super) fn surface(octree: &Octree<'_>, parts: &[Part]) -> Mesh {
    let with_surface = parts.par_iter().filter(|part| part.side == 1 && !part.views.is_empty());
    let pieces: Vec<Piece> = with_surface.map(|part| Block::of(octree, part).piece()).collect();
    joined(&pieces)
}

/// One vertex for each key.
fn joined(pieces: &[Piece]) -> Mesh {
    let mut vertices: Vec<(u64, [f32; 3])> = pieces.iter().flat_map(|piece| &piece.vertices).copied().collect();
    // stable: of equal keys the first block's comes first, whatever the number of threads
    vertices.par_sort_by_key(|(key, _)| *key);
    vertices.dedup_by_key(|(key, _)| *key);
    let triangles = pieces.par_iter().flat_map_iter(|piece| {
        let index = |key: u64| vertices.partition_point(|(known, _)| *known < key) as u32;
        let indices: Vec<u32> = piece.vertices.iter().map(|(key, _)| index(*key)).collect();
        piece.triangles.iter().map(move |triangle| triangle.map(|corner| indices[corner as usize]))
    });
    let triangles = triangles.collect();
    Mesh { positions: vertices.into_iter().map(|(_, position)| position).collect(), triangles, ..Mesh::default() }
}

/// The values at the corners of the cells of a block.
struct Block<'a> {
    grid: Grid,
    /// The first corner, cells.
    first: [usize; 3],
    values: [f32; SIDE * SIDE * SIDE],
    octree: &'a Octree<'a>,
}

impl<'a> Block<'a> {
    fn of(octree: &'a Octree<'a>, part: &Part) -> Self {
        let first = part.at.map(|block| BLOCK * block);
        let mut block = Self { grid: octree.grid, first, values: [0.0; SIDE * SIDE * SIDE], octree };
        // those that see most of the block outside first, so that few others are asked
        let middle = octree.grid.corner(block.corner([BLOCK / 2; 3]));
        let mut views: Vec<(f32, u16)> = part.views.iter().map(|&view| (octree.value(view, middle), view)).collect();
        views.sort_by(|a, b| a.0.total_cmp(&b.0));
        for at in 0..block.values.len() {
            let corner = block.corner([at % SIDE, at / SIDE % SIDE, at / (SIDE * SIDE)]);
            block.values[at] = block.value(corner, &views, part.tolerated);
        }
        block
    }

    /// The signed distance at a corner; negative at the border of the grid, so that the surface is closed there.
    fn value(&self, corner: [usize; 3], views: &[(f32, u16)], tolerated: usize) -> f32 {
        let cell = self.grid.cell as f32;
        let last = BLOCK * self.grid.blocks;
        if corner.iter().any(|&index| index == 0 || index == last) {
            return -cell;
        }
        let point = self.grid.corner(corner);
        // the smallest values, ascending
        let mut smallest = [FAR_CELLS * cell; MAX_TOLERATED + 1];
        for &(_, view) in views {
            let mut value = self.octree.value(view, point);
            for known in &mut smallest[..=tolerated] {
                if value < *known {
                    std::mem::swap(known, &mut value);
                }
            }
            // no neighbour can be inside
            if smallest[tolerated] < -OUTSIDE_CELLS * cell {
                break;
            }
        }
        smallest[tolerated]
    }

    fn corner(&self, at: [usize; 3]) -> [usize; 3] {
        [0, 1, 2].map(|axis| self.first[axis] + at[axis])
    }

    fn piece(&self) -> Piece {
        let mut piece = Piece::default();
        if self.values.iter().all(|value| *value > 0.0) || self.values.iter().all(|value| *value <= 0.0) {
            return piece;
        }
        let mut known = [u32::MAX; 3 * SIDE * SIDE * SIDE];
        for cell in 0..BLOCK * BLOCK * BLOCK {
            let cell = [cell % BLOCK, cell / BLOCK % BLOCK, cell / (BLOCK * BLOCK)];
            let is_inside = |corner: usize| self.values[index(cell, corner)] > 0.0;
            let inside = (0..CORNERS).map(|corner| usize::from(is_inside(corner)) << corner).sum::<usize>();
            for (number, polygon) in POLYGONS[inside].iter().enumerate() {
                let corner = |edge: &Edge| {
                    let slot = &mut known[3 * index(cell, edge.corner) + edge.axis];
                    if *slot == u32::MAX {
                        *slot = piece.vertices.len() as u32;
                        piece.vertices.push(self.vertex(cell, *edge));
                    }
                    *slot
                };
                let corners: Vec<u32> = polygon.edges.iter().map(corner).collect();
                self.divide(polygon, &corners, key(self.corner(cell), MIDDLE + number as u64), &mut piece);
            }
        }
        piece
    }

    /// Where the surface crosses an edge of a cell.
    fn vertex(&self, cell: [usize; 3], edge: Edge) -> (u64, [f32; 3]) {
        let [from, to] = [edge.corner, edge.corner | 1 << edge.axis].map(|corner| self.values[index(cell, corner)]);
        let share = (from / (from - to)).clamp(END_SHARE, 1.0 - END_SHARE);
        let at = self.corner([0, 1, 2].map(|axis| cell[axis] + (edge.corner >> axis & 1)));
        let mut point = self.grid.corner(at);
        point[edge.axis] += self.grid.cell * f64::from(share);
        (key(at, edge.axis as u64), point.map(|value| value as f32))
    }

    /// Triangles of a polygon: from a point in its middle, or of four corners by the shorter diagonal, or from its
    /// first corner.
    fn divide(&self, polygon: &Polygon, corners: &[u32], middle: u64, piece: &mut Piece) {
        let count = corners.len();
        let position = |at: usize| piece.vertices[corners[at] as usize].1;
        if polygon.has_middle {
            let mean = |axis: usize| (0..count).map(|at| position(at)[axis]).sum::<f32>() / count as f32;
            let mean = [mean(0), mean(1), mean(2)];
            let at = piece.vertices.len() as u32;
            piece.vertices.push((middle, mean));
            piece.triangles.extend((0..count).map(|side| [at, corners[side], corners[(side + 1) % count]]));
            return;
        }
        let squared = |a: usize, b: usize| (0..3).map(|i| (position(a)[i] - position(b)[i]).powi(2)).sum::<f32>();
        let first = usize::from(count == 4 && squared(1, 3) < squared(0, 2));
        let corner = |at: usize| corners[(first + at) % count];
        piece.triangles.extend((1..count - 1).map(|at| [corner(0), corner(at), corner(at + 1)]));
    }
}

/// Most views that may be tolerated.
pub(super) const MAX_TOLERATED: usize = 3;

/// Where the value of a corner of a cell is in a block.
fn index(cell: [usize; 3], corner: usize) -> usize {
    let [x, y, z] = [0, 1, 2].map(|axis| cell[axis] + (corner >> axis & 1));
    (z * SIDE + y) * SIDE + x
}

fn key([x, y, z]: [usize; 3], code: u64) -> u64 {
    ((z as u64) << (2 * BITS) | (y as u64) << BITS | x as u64) << 3 | code
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;

    /// The surface of a field of random signs: every combination of corners occurs, beside every other.
    fn random_surface(seed: u64) -> Mesh {
        let octree = Octree { silhouettes: &[], grid: Grid { origin: [0.0; 3], cell: 1.0, blocks: 4 } };
        let value = |corner: [usize; 3]| {
            let number = corner.iter().fold(seed, |sum, &c| (sum + c as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15));
            let is_border = corner.iter().any(|&c| c == 0 || c == 4 * BLOCK);
            if is_border { -1.0 } else { ((number >> 40) as f32 / (1 << 23) as f32) - 1.0 }
        };
        let piece = |at: usize| {
            let first = [at % 4, at / 4 % 4, at / 16].map(|block| BLOCK * block);
            let mut block = Block { grid: octree.grid, first, values: [0.0; SIDE * SIDE * SIDE], octree: &octree };
            for at in 0..block.values.len() {
                block.values[at] = value(block.corner([at % SIDE, at / SIDE % SIDE, at / (SIDE * SIDE)]));
            }
            block.piece()
        };
        joined(&(0..64).map(piece).collect::<Vec<_>>())
    }

    #[test]
    fn the_surface_is_a_closed_manifold_for_any_combination_of_signs() {
        for seed in 0..20 {
            let mesh = random_surface(seed);
            // of each vertex: the vertex that follows on its ring, by the one before
            let mut rings = vec![HashMap::new(); mesh.positions.len()];
            for &[a, b, c] in &mesh.triangles {
                for [middle, from, to] in [[a, b, c], [b, c, a], [c, a, b]] {
                    let known = rings[middle as usize].insert(from, to);
                    assert_eq!(known, None, "an edge belongs to two triangles in the same direction");
                }
            }
            assert!(rings.len() > 1000);
            for ring in rings {
                let first = *ring.keys().next().expect("no vertex is without triangles");
                let (mut at, mut steps) = (first, 0);
                loop {
                    at = *ring.get(&at).expect("the ring is closed");
                    steps += 1;
                    if at == first {
                        break;
                    }
                }
                assert_eq!(steps, ring.len(), "a vertex has one ring of triangles");
            }
        }
    }

    #[test]
    fn the_volume_of_a_single_corner_is_positive() {
        for axis in 0..3 {
            let octree = Octree { silhouettes: &[], grid: Grid { origin: [0.0; 3], cell: 1.0, blocks: 1 } };
            let mut block =
                Block { grid: octree.grid, first: [0; 3], values: [-1.0; SIDE * SIDE * SIDE], octree: &octree };
            block.values[index([2; 3], 0)] = 1.0;
            block.values[index([2; 3], 1 << axis)] = 1.0;
            let mesh = joined(&[block.piece()]);
            // an octahedron of edges 1/2 around each, and what is between
            assert!((0.3..0.8).contains(&mesh.volume()), "{}", mesh.volume());
        }
    }
}
