//! The octree of the silhouettes: which parts of space the surface can pass.
//!
//! In: the silhouettes, and a cube of space divided into blocks. Out: the blocks that are neither outside nor inside,
//! with the views that matter there. A part of space is outside when more than `tolerated` views see all of it beside
//! their silhouette; it is inside when at most `tolerated` views do not see all of it within (Potmesil 1987; Szeliski
//! 1993). One look at the distance transform at the middle of a part decides for a view, whatever the size of the part.

use rayon::prelude::*;

use super::silhouette::Silhouette;

/// Cells along each side of a block.
pub(super) const BLOCK: usize = 4;
/// How much larger than by its first order the picture of a ball may be, and rounding, px.
const BALL_FACTOR: f64 = 1.05;
const BALL_MARGIN_PX: f64 = 1.0;

/// A cube of space, divided into cells.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    /// The corner with the lowest coordinates.
    pub origin: [f64; 3],
    /// Length of the side of a cell.
    pub cell: f64,
    /// Blocks along a side, a power of 2.
    pub blocks: usize,
}

impl Grid {
    /// The smallest grid of cells of this size around a middle that has `longest` on each side.
    pub(super) fn around(middle: [f64; 3], longest: f64, cell: f64) -> Self {
        let blocks = ((longest / (cell * BLOCK as f64)).ceil().max(1.0) as usize).next_power_of_two();
        let half = 0.5 * cell * (BLOCK * blocks) as f64;
        Self { origin: middle.map(|m| m - half), cell, blocks }
    }

    /// The corner of cells with these indices.
    pub(super) fn corner(&self, at: [usize; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.origin[axis] + self.cell * at[axis] as f64)
    }
}

/// A part of space that is not outside: a cube of blocks.
#[derive(Debug, Clone)]
pub(super) struct Part {
    /// Its first block.
    pub at: [usize; 3],
    /// Its side, blocks.
    pub side: usize,
    /// The views that see its surface, by their index; empty if it is inside.
    pub views: Vec<u16>,
    /// How many of these views may see a point outside.
    pub tolerated: usize,
}

/// The octree over a grid.
pub(super) struct Octree<'a> {
    pub silhouettes: &'a [Silhouette],
    pub grid: Grid,
}

impl Octree<'_> {
    /// The parts that are not outside: single blocks with surface, and larger cubes without.
    pub(super) fn parts(&self, tolerated: usize) -> Vec<Part> {
        let views = (0..self.silhouettes.len() as u16).collect();
        self.divide(Part { at: [0; 3], side: self.grid.blocks, views, tolerated })
    }

    /// The lowest and the highest corner of a part.
    pub(super) fn corners(&self, part: &Part) -> [[f64; 3]; 2] {
        [0, part.side].map(|side| self.grid.corner(part.at.map(|block| BLOCK * (block + side))))
    }

    /// How far inside the silhouette of a view a point is, as a length at its depth; negative outside.
    pub(super) fn value(&self, view: u16, point: [f64; 3]) -> f32 {
        let silhouette = &self.silhouettes[usize::from(view)];
        match silhouette.camera.project(point) {
            Some((px, depth)) => silhouette.signed(px) * (depth / silhouette.camera.focal_px[0]) as f32,
            None => f32::NEG_INFINITY,
        }
    }

    fn divide(&self, mut part: Part) -> Vec<Part> {
        if !self.judge(&mut part) {
            return Vec::new();
        }
        if part.views.is_empty() || part.side == 1 {
            return vec![part];
        }
        let side = part.side / 2;
        let children = (0..8_usize).into_par_iter().map(|child| {
            let at = [0, 1, 2].map(|axis| part.at[axis] + side * (child >> axis & 1));
            self.divide(Part { at, side, views: part.views.clone(), tolerated: part.tolerated })
        });
        children.collect::<Vec<_>>().concat()
    }

    /// Keeps the views whose outline passes the part; false if the part is outside.
    fn judge(&self, part: &mut Part) -> bool {
        let half = 0.5 * self.grid.cell * (BLOCK * part.side) as f64;
        let middle = self.grid.corner(part.at.map(|block| BLOCK * block)).map(|corner| corner + half);
        let radius = half * 3.0_f64.sqrt();
        let mut outside = 0;
        part.views.retain(|&view| match self.side(&self.silhouettes[usize::from(view)], middle, radius) {
            Side::Outside => {
                outside += 1;
                false
            }
            Side::Inside => false,
            Side::Both => true,
        });
        if outside > part.tolerated {
            return false;
        }
        part.tolerated -= outside;
        if part.views.len() <= part.tolerated {
            part.views.clear();
        }
        true
    }

    fn side(&self, silhouette: &Silhouette, middle: [f64; 3], radius: f64) -> Side {
        let camera = &silhouette.camera;
        let Some((px, depth)) = camera.project(middle) else { return Side::Outside };
        if depth <= radius {
            return Side::Both;
        }
        let tangent = |axis: usize| (px[axis] - camera.principal_point_px[axis]) / camera.focal_px[axis];
        let slant = (1.0 + tangent(0).powi(2) + tangent(1).powi(2)).sqrt();
        let scale = BALL_FACTOR * slant * camera.focal_px[0].max(camera.focal_px[1]) / (depth - radius);
        let reach = radius * scale + BALL_MARGIN_PX;
        let distance = f64::from(silhouette.signed(px));
        // a view that is inside by more than a cell cannot place the surface
        match distance {
            _ if distance < -reach => Side::Outside,
            _ if distance > reach + scale * self.grid.cell => Side::Inside,
            _ => Side::Both,
        }
    }
}

/// Where a part of space is for a view.
enum Side {
    Outside,
    Inside,
    Both,
}
