//! The outline of one mask as a signed distance.
//!
//! In: the mask of a view, alpha 0..255. Out: at each pixel the distance to the outline, px, positive inside. The
//! outline runs where the bilinear interpolation of alpha is half, so a soft edge places it between pixels. Within
//! [`BAND`] px of the outline the distance is that to its line segments; farther out it is a lower bound by a chamfer
//! transform (Borgefors 1986), which is all that the octree needs.

use crate::{
    imaging::{Plane, Rect},
    types::pinhole::PinholeCamera,
};

/// Alpha of the outline.
const HALF: f32 = 127.5;
/// Distance up to which distances are exact, px.
const BAND: usize = 3;
/// Pixels of background that are kept around the object.
const MARGIN: usize = 4;
/// Chamfer distances with steps of 1 and root 2 are too large by 8.24 % at most.
const CHAMFER_BOUND: f32 = 0.92;

/// The silhouette of a view, of the part of the picture that has the object.
#[derive(Debug, Clone)]
pub(super) struct Silhouette {
    /// The camera of the reduced and cropped mask.
    pub camera: PinholeCamera,
    /// Signed distances, px of the reduced mask.
    distances: Plane<f32>,
    /// The whole object is in the picture: what is outside of the picture is outside of the object.
    is_whole: bool,
    /// Mean position of the object, px.
    pub middle: [f64; 2],
    /// Width of a pixel of the reduced mask, px of the picture.
    pub reduction: usize,
}

impl Silhouette {
    /// The silhouette of a mask, reduced by the smallest whole factor with which the object is at most `longest` px
    /// long. `None` if the mask has no object.
    pub(super) fn of(camera: &PinholeCamera, mask: &Plane<u8>, longest: usize) -> Option<Self> {
        let object = object_rect(mask)?;
        let reduction = object.width.max(object.height).div_ceil(longest.max(1));
        let kept = object.grown(MARGIN * reduction, mask.width, mask.height);
        let [left, top] = [kept.x / reduction, kept.y / reduction];
        let width = (kept.x + kept.width).div_ceil(reduction) - left;
        let height = (kept.y + kept.height).div_ceil(reduction) - top;
        let alpha = reduced(mask, reduction, Rect { x: left, y: top, width, height });
        let camera = camera.reduced(reduction, [left, top], [width, height]);
        let is_whole = object.x > 0
            && object.y > 0
            && object.x + object.width < mask.width
            && object.y + object.height < mask.height;
        let (mut sum, mut count) = ([0.0; 2], 0.0_f64);
        for (at, _) in alpha.data.iter().enumerate().filter(|(_, alpha)| **alpha > HALF) {
            sum = [sum[0] + (at % width) as f64, sum[1] + (at / width) as f64];
            count += 1.0;
        }
        let middle = sum.map(|s| s / count.max(1.0));
        Some(Self { camera, distances: signed_distances(&alpha), is_whole, middle, reduction })
    }

    /// Distance of a position of the reduced mask from the outline, px, positive inside; bilinear. Beyond the picture
    /// the mask goes on as at its border, or is empty when the whole object is in the picture.
    pub(super) fn signed(&self, [x, y]: [f64; 2]) -> f32 {
        let Plane { width, height, ref data } = self.distances;
        let [right, bottom] = [width - 1, height - 1].map(|last| last as f64);
        let (cx, cy) = (x.clamp(0.0, right), y.clamp(0.0, bottom));
        let (column, row) = ((cx as usize).min(width.saturating_sub(2)), (cy as usize).min(height.saturating_sub(2)));
        let (u, v) = ((cx - column as f64) as f32, (cy - row as f64) as f32);
        let at = row * width + column;
        let (next, below) = (usize::from(width > 1), if height > 1 { width } else { 0 });
        let upper = data[at] + u * (data[at + next] - data[at]);
        let lower = data[at + below] + u * (data[at + below + next] - data[at + below]);
        let inner = upper + v * (lower - upper);
        let beyond = (x - cx).hypot(y - cy) as f32;
        if beyond > 0.0 && self.is_whole { -inner.min(0.0).hypot(beyond) } else { inner }
    }
}

/// The rectangle of the pixels inside.
fn object_rect(mask: &Plane<u8>) -> Option<Rect> {
    let is_object = |alpha: &u8| f32::from(*alpha) > HALF;
    let mut rows = (0..mask.height).filter(|&y| mask.row(y).iter().any(is_object));
    let (y, mut left, mut right) = (rows.next()?, usize::MAX, 0);
    let bottom = rows.next_back().unwrap_or(y);
    for row in y..=bottom {
        let row = mask.row(row);
        left = left.min(row.iter().position(is_object).unwrap_or(usize::MAX));
        right = right.max(row.iter().rposition(is_object).unwrap_or(0));
    }
    Some(Rect { x: left, y, width: right + 1 - left, height: bottom + 1 - y })
}

/// Means of squares of `factor` px; `rect` counts such squares. A mask without soft edges that is not reduced is
/// smoothed by the binomial filter of 3 px: its outline would otherwise be a staircase.
fn reduced(mask: &Plane<u8>, factor: usize, rect: Rect) -> Plane<f32> {
    let mean = |x: usize, y: usize| {
        let columns = (rect.x + x) * factor..((rect.x + x + 1) * factor).min(mask.width);
        let rows = (rect.y + y) * factor..((rect.y + y + 1) * factor).min(mask.height);
        let count = (columns.len() * rows.len()) as f32;
        let sum: u32 = rows.map(|row| mask.row(row)[columns.clone()].iter().map(|a| u32::from(*a)).sum::<u32>()).sum();
        sum as f32 / count
    };
    let alpha = Plane::from_fn(rect.width, rect.height, mean);
    if factor > 1 || mask.data.iter().any(|alpha| !matches!(alpha, 0 | 255)) {
        return alpha;
    }
    let [last_x, last_y] = [rect.width - 1, rect.height - 1];
    let across = Plane::from_fn(rect.width, rect.height, |x, y| {
        let row = alpha.row(y);
        0.25 * row[x.saturating_sub(1)] + 0.5 * row[x] + 0.25 * row[(x + 1).min(last_x)]
    });
    Plane::from_fn(rect.width, rect.height, |x, y| {
        0.25 * across.at(x, y.saturating_sub(1)) + 0.5 * across.at(x, y) + 0.25 * across.at(x, (y + 1).min(last_y))
    })
}

fn signed_distances(alpha: &Plane<f32>) -> Plane<f32> {
    let Plane { width, height, .. } = *alpha;
    let mut distances = Plane::filled(width, height, f32::INFINITY);
    for y in 0..height.saturating_sub(1) {
        for x in 0..width.saturating_sub(1) {
            let corners = [alpha.at(x, y), alpha.at(x + 1, y), alpha.at(x + 1, y + 1), alpha.at(x, y + 1)];
            let inside = corners.iter().filter(|alpha| **alpha > HALF).count();
            if inside > 0 && inside < 4 {
                add_segments(&mut distances, [x, y], corners);
            }
        }
    }
    chamfer(&mut distances);
    for (distance, alpha) in distances.data.iter_mut().zip(&alpha.data) {
        let far = (*distance - BAND as f32).max(0.0);
        // a picture without an outline is all inside
        let bound = if far.is_finite() { *distance - (1.0 - CHAMFER_BOUND) * far } else { (width + height) as f32 };
        *distance = if *alpha > HALF { bound } else { -bound };
    }
    distances
}

/// The segments of the outline in the square of four pixels whose first is at `[x, y]` (marching squares): from each
/// crossing into the object to the next one out of it, around the square.
fn add_segments(distances: &mut Plane<f32>, [x, y]: [usize; 2], corners: [f32; 4]) {
    const CORNERS: [[f32; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let crossing = |side: usize| {
        let next = (side + 1) % 4;
        let share = (HALF - corners[side]) / (corners[next] - corners[side]);
        let along = |axis: usize| CORNERS[side][axis] + share * (CORNERS[next][axis] - CORNERS[side][axis]);
        [x as f32 + along(0), y as f32 + along(1)]
    };
    let is_inside = |corner: usize| corners[corner % 4] > HALF;
    for entry in (0..4).filter(|&side| !is_inside(side) && is_inside(side + 1)) {
        let exit = (entry + 1..entry + 4).find(|&side| is_inside(side) && !is_inside(side + 1)).unwrap_or(entry);
        let (from, to) = (crossing(entry), crossing(exit % 4));
        for row in y.saturating_sub(BAND)..(y + 2 + BAND).min(distances.height) {
            for column in x.saturating_sub(BAND)..(x + 2 + BAND).min(distances.width) {
                let distance = to_segment([column as f32, row as f32], from, to);
                let known = &mut distances.row_mut(row)[column];
                *known = known.min(distance);
            }
        }
    }
}

fn to_segment(point: [f32; 2], from: [f32; 2], to: [f32; 2]) -> f32 {
    let along = [to[0] - from[0], to[1] - from[1]];
    let start = [point[0] - from[0], point[1] - from[1]];
    let length = along[0] * along[0] + along[1] * along[1];
    let share = ((start[0] * along[0] + start[1] * along[1]) / length.max(1e-12)).clamp(0.0, 1.0);
    (start[0] - share * along[0]).hypot(start[1] - share * along[1])
}

/// Completes distances from neighbour to neighbour, forwards and backwards.
fn chamfer(distances: &mut Plane<f32>) {
    let (width, height) = (distances.width, distances.height);
    let diagonal = 2.0_f32.sqrt();
    for backwards in [false, true] {
        for step in 0..height {
            let y = if backwards { height - 1 - step } else { step };
            if step > 0 {
                let other = if backwards { y + 1 } else { y - 1 };
                for x in 0..width {
                    let row = distances.row(other);
                    let left = if x > 0 { row[x - 1] } else { f32::INFINITY };
                    let right = row.get(x + 1).copied().unwrap_or(f32::INFINITY);
                    let nearest = (row[x] + 1.0).min(left.min(right) + diagonal);
                    let known = &mut distances.data[y * width + x];
                    *known = known.min(nearest);
                }
            }
            let row = distances.row_mut(y);
            for at in 1..width {
                let (x, before) = if backwards { (width - 1 - at, width - at) } else { (at, at - 1) };
                row[x] = row[x].min(row[before] + 1.0);
            }
        }
    }
}
