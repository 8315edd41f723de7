//! Phase windows of dots: the grid steps, the selection of dots, and the dot position from a phase measurement.

use crate::calibration::lattice::{Label, Places};
use crate::calibration::phase::{self, PhaseMeasurement, Window};
use crate::calibration::{statistics::median_point, working_image::WorkingImage};

/// Most dots that are measured per slice; more do not improve its homography.
pub(in crate::calibration) const MAX_DOTS: usize = 1200;
/// Largest distance of a dot from its predicted position, grid steps.
pub(super) const MAX_SHIFT: f64 = 0.3;

/// The dots whose windows lie in the image; an even selection when there are very many.
pub(super) fn selected_labels(image: &WorkingImage, places: &Places) -> Vec<Label> {
    let steps = grid_steps(places);
    let fits = |p: &[f64; 2]| phase::inside(&Window { at: *p, steps }, image.plane.width, image.plane.height);
    let all: Vec<Label> = places.iter().filter(|(_, p)| fits(p)).map(|(label, _)| *label).collect();
    even_selection(all)
}

/// At most [`MAX_DOTS`] of `labels`, evenly spread: half of them, like the squares of one colour of a chessboard, as
/// often as needed. Each selection contains the next smaller one, so slices that show other parts of the grid share
/// their dots.
fn even_selection(mut labels: Vec<Label>) -> Vec<Label> {
    let mut step = 1;
    while labels.len() > MAX_DOTS {
        labels.retain(|[i, j]| (i.div_euclid(step) + j.div_euclid(step)).rem_euclid(2) == 0);
        if labels.len() <= MAX_DOTS {
            break;
        }
        step *= 2;
        labels.retain(|[i, j]| i.rem_euclid(step) == 0 && j.rem_euclid(step) == 0);
    }
    labels
}

/// The windows of `labels`, with local grid steps where both neighbours are known.
pub(super) fn windows_at(labels: &[Label], places: &Places, scale: f64, steps: [[f64; 2]; 2]) -> Vec<Window> {
    let local = |[i, j]: Label, axis: usize| {
        let d: Label = if axis == 0 { [1, 0] } else { [0, 1] };
        let (next, back) = (places.get(&[i + d[0], j + d[1]]), places.get(&[i - d[0], j - d[1]]));
        let (Some(next), Some(back)) = (next, back) else { return steps[axis].map(|s| s * scale) };
        [0.5 * (next[0] - back[0]), 0.5 * (next[1] - back[1])]
    };
    labels
        .iter()
        .filter_map(|label| places.get(label).map(|at| Window { at: *at, steps: [local(*label, 0), local(*label, 1)] }))
        .collect()
}

/// The dot position that the phase in a window gives.
pub(super) fn dot_position(window: &Window, phase: &PhaseMeasurement, sign: f64) -> [f64; 2] {
    let shift = phase.harmonics.map(|h| h.shift(sign));
    [0, 1].map(|a| window.at[a] + shift[0] * window.steps[0][a] + shift[1] * window.steps[1][a])
}

/// True when `p`, px of the working image, lies in it.
pub(super) fn in_picture(image: &WorkingImage, p: &[f64; 2]) -> bool {
    p[0] >= 0.0 && p[1] >= 0.0 && p[0] <= image.plane.width as f64 - 1.0 && p[1] <= image.plane.height as f64 - 1.0
}

/// The two grid steps: medians over all neighbours.
pub(in crate::calibration) fn grid_steps(places: &Places) -> [[f64; 2]; 2] {
    [[1, 0], [0, 1]].map(|step: Label| {
        let between: Vec<[f64; 2]> = places
            .iter()
            .filter_map(|(label, p)| {
                places.get(&[label[0] + step[0], label[1] + step[1]]).map(|q| [q[0] - p[0], q[1] - p[1]])
            })
            .collect();
        median_point(&between)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(columns: i32, rows: i32) -> Vec<Label> {
        (0..rows).flat_map(|j| (0..columns).map(move |i| [i - 7, j - 3])).collect()
    }

    #[test]
    fn an_even_selection_of_a_large_grid_keeps_the_limit() {
        for (columns, rows) in [(69, 69), (3, 1600), (35, 35), (200, 150), (34, 34)] {
            let all = grid(columns, rows);
            let selected = even_selection(all.clone());
            assert!(selected.len() <= MAX_DOTS, "{columns} x {rows}: {}", selected.len());
            assert!(3 * selected.len() > MAX_DOTS || selected.len() == all.len(), "{columns} x {rows}");
        }
    }

    #[test]
    fn slices_that_show_different_parts_of_a_grid_select_the_same_dots() {
        let (large, small) = (even_selection(grid(100, 100)), even_selection(grid(60, 60)));
        let shown: Vec<Label> = large.into_iter().filter(|l| grid(60, 60).contains(l)).collect();
        assert!(shown.iter().all(|label| small.contains(label)) && shown.len() > 200, "{}", shown.len());
    }
}
