//! The pairs of neighbouring slices that show a window near its focus.
//!
//! Far from focus, the blur of nearer and farther parts spreads differently in two slices and shifts the remaining
//! texture, although the profile is exact. Near focus the texture is strong and does not shift.

use rayon::prelude::*;

use super::shift::ReadWindow;
use crate::imaging::{Plane, Rect};

/// A slice is near the focus of a window if it has at least this share of the fine texture of the sharpest slice.
const NEAR: f64 = 0.4;

/// Most pairs of neighbours that are compared per window.
const MOST_PAIRS: usize = 4;
/// In a stack of at least this many slices, texture must vary with focus ...
const MANY: usize = 5;
/// ... by at least this factor. Texture that does not vary is noise, or a fixed pattern of the camera.
const LEAST_VARIATION: f64 = 1.5;

/// Fine texture of every window in every slice.
pub(super) struct WindowTexture {
    /// By slice, then by window.
    texture: Vec<Vec<f64>>,
    /// By window: the largest over all slices; infinite where texture does not vary with focus.
    sharpest: Vec<f64>,
}

impl WindowTexture {
    pub(super) fn of(slices: usize, read: &ReadWindow<'_>, windows: &[Rect]) -> Self {
        let of_strip =
            |slice: usize, strip: Rect| read(slice, strip).map_or(0.0, |(luma, valid)| fine_texture(&luma, &valid));
        let of_window = |slice: usize, window: &Rect| strips(*window).map(|strip| of_strip(slice, strip)).iter().sum();
        let of_slice = |slice: usize| windows.iter().map(|window| of_window(slice, window)).collect();
        let texture: Vec<Vec<f64>> = (0..slices).into_par_iter().map(of_slice).collect();
        let sharpest = |index: usize| {
            let of_slices = || texture.iter().map(|slice: &Vec<f64>| slice[index]).filter(|&value| value > 0.0);
            let (least, largest) = (of_slices().fold(f64::INFINITY, f64::min), of_slices().fold(0.0, f64::max));
            let shows_focus = of_slices().count() < MANY || largest >= LEAST_VARIATION * least;
            if shows_focus { largest } else { f64::INFINITY }
        };
        let sharpest = (0..windows.len()).map(sharpest).collect();
        Self { texture, sharpest }
    }

    /// Whether the texture of window `index` varies with focus, so that it is neither noise nor a fixed pattern.
    pub(super) fn shows_focus(&self, index: usize) -> bool {
        self.sharpest[index].is_finite() && self.sharpest[index] > 0.0
    }

    /// The pairs of neighbours that show window `index` nearest to its focus, best first, by the index of their first
    /// slice.
    pub(super) fn pairs(&self, index: usize) -> Vec<usize> {
        let texture = |slice: usize| self.texture[slice][index];
        let weaker = |slice: usize| texture(slice).min(texture(slice + 1));
        let slices = self.texture.len();
        let near = |slice: &usize| weaker(*slice) >= NEAR * self.sharpest[index];
        let mut pairs: Vec<usize> = (0..slices.saturating_sub(1)).filter(near).collect();
        pairs.sort_by(|a, b| weaker(*b).total_cmp(&weaker(*a)).then(a.cmp(b)));
        pairs.truncate(MOST_PAIRS);
        pairs
    }
}

/// Three horizontal strips of a window that represent its texture: a fraction of the reading.
fn strips(window: Rect) -> [Rect; 3] {
    let height = (window.height / 8).max(5).min(window.height);
    [1, 3, 5].map(|sixths| {
        let middle = window.y + window.height * sixths / 6;
        let y = middle.saturating_sub(height / 2).clamp(window.y, window.y + window.height - height);
        Rect { y, height, ..window }
    })
}

/// Mean squared difference of pixels two apart, in both directions, over the valid pixels; 0 without any. At a distance
/// of two, texture outweighs noise more than at a distance of one.
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
