//! Marching cubes (Lorensen and Cline 1987) whose surface is closed and manifold for every combination of signs.
//!
//! The table of a cube is derived instead of listed. On each face of a cube the surface runs from each crossing into
//! the object to the next one out of it, so on a face with four crossings the object's corners are separated. Two cubes
//! that share a face find the same segments, in opposite directions. So each segment belongs to exactly two polygons.
//! A diagonal of a polygon could coincide with that of a neighbour only on a face with four crossings; polygons with
//! such a face are divided from a point in their middle.

use std::sync::LazyLock;

/// Corner `c` of a cube is at `(c & 1, c >> 1 & 1, c >> 2)`.
pub(super) const CORNERS: usize = 8;

/// An edge of a cube: its corner with the lower coordinate, and its axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub(super) struct Edge {
    pub corner: usize,
    pub axis: usize,
}

/// A closed polygon of the surface in a cube, anticlockwise when seen from outside the object.
#[derive(Debug, Clone, Default)]
pub(super) struct Polygon {
    /// The edges of the cube on which its corners lie.
    pub edges: Vec<Edge>,
    /// It must be divided from a point in its middle.
    pub has_middle: bool,
}

/// The polygons for each set of corners inside, by its bits.
pub(super) static POLYGONS: LazyLock<Vec<Vec<Polygon>>> = LazyLock::new(|| (0..1 << CORNERS).map(polygons).collect());

fn polygons(inside: usize) -> Vec<Polygon> {
    let mut segments: Vec<(Edge, Edge, bool)> = Vec::new();
    for face in 0..6 {
        let around = corners_of_face(face);
        let is_inside = |at: usize| inside >> around[at % 4] & 1 == 1;
        let entries: Vec<usize> = (0..4).filter(|&at| !is_inside(at) && is_inside(at + 1)).collect();
        for &entry in &entries {
            let exit = (entry + 1..entry + 4).find(|&at| is_inside(at) && !is_inside(at + 1)).unwrap_or(entry);
            let edge = |at: usize| edge_between(around[at % 4], around[(at + 1) % 4]);
            segments.push((edge(entry), edge(exit), entries.len() > 1));
        }
    }
    let mut polygons = Vec::new();
    while let Some((first, mut end, is_ambiguous)) = segments.pop() {
        let mut polygon = Polygon { edges: vec![first], has_middle: is_ambiguous };
        while end != first {
            polygon.edges.push(end);
            let Some(at) = segments.iter().position(|(from, ..)| *from == end) else { break };
            let (_, to, is_ambiguous) = segments.swap_remove(at);
            polygon.has_middle |= is_ambiguous;
            end = to;
        }
        polygon.has_middle &= polygon.edges.len() > 3;
        polygons.push(polygon);
    }
    polygons
}

/// The corners of a face, anticlockwise when seen from outside the cube.
fn corners_of_face(face: usize) -> [usize; 4] {
    let (axis, side) = (face / 2, face % 2);
    let (second, third) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
    let first = side << axis;
    let around = [first, first + second, first + second + third, first + third];
    if side == 1 { around } else { [around[0], around[3], around[2], around[1]] }
}

fn edge_between(a: usize, b: usize) -> Edge {
    Edge { corner: a.min(b), axis: (a ^ b).trailing_zeros() as usize }
}
