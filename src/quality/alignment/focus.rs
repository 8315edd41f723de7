//! Which slices show a window near its focus.
//!
//! Where both slices are far out of focus, the veil of nearer and farther parts spreads differently in the two
//! and moves what is left of the texture, though the profile is exact. Near the focus the texture is strong and
//! stays where it is.

use rayon::prelude::*;

use super::Window;
use crate::imaging::{Plane, Rect};

/// A slice is near the focus of a window when it holds this share of the fine texture of the sharpest slice.
const NEAR: f64 = 0.4;

/// The fine texture of every window in every slice.
pub(super) struct Focus {
    /// By slice, then window.
    texture: Vec<Vec<f64>>,
    /// The largest of all slices, by window.
    sharpest: Vec<f64>,
}

impl Focus {
    pub(super) fn of(slices: usize, read: &Window<'_>, windows: &[Rect]) -> Self {
        let of_window =
            |slice: usize, window: &Rect| read(slice, *window).map_or(0.0, |(luma, valid)| fine_texture(&luma, &valid));
        let of_slice = |slice: usize| windows.iter().map(|window| of_window(slice, window)).collect();
        let texture: Vec<Vec<f64>> = (0..slices).into_par_iter().map(of_slice).collect();
        let largest = |index: usize| texture.iter().map(|slice: &Vec<f64>| slice[index]).fold(0.0, f64::max);
        let sharpest = (0..windows.len()).map(largest).collect();
        Self { texture, sharpest }
    }

    /// Whether both slices show window `index` near its focus.
    pub(super) fn in_both(&self, from: usize, to: usize, index: usize) -> bool {
        let near = |slice: usize| self.texture[slice][index] >= NEAR * self.sharpest[index];
        near(from) && near(to)
    }
}

/// Mean squared difference of pixels two apart in both directions, over what is valid: 0 without any. Two
/// apart, noise weighs less than with neighbours.
fn fine_texture(luma: &Plane<f32>, valid: &Plane<u8>) -> f64 {
    let samples = luma.width * luma.height;
    if luma.data.len() != samples || valid.data.len() != samples {
        return 0.0;
    }
    let (mut sum, mut count) = (0.0f64, 0usize);
    for y in 2..luma.height {
        let (row, above) = (luma.row(y), luma.row(y - 2));
        let (covered, covered_above) = (valid.row(y), valid.row(y - 2));
        for x in 2..luma.width {
            if covered[x] != 0 && covered[x - 2] != 0 && covered_above[x] != 0 {
                sum += f64::from((row[x] - row[x - 2]).powi(2) + (row[x] - above[x]).powi(2));
                count += 1;
            }
        }
    }
    sum / count.max(1) as f64
}
