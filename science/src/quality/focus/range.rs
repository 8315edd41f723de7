//! Focus range: whether the object extends beyond an end of the stack.

use super::curve;

/// The object extends beyond an end if more than this share of the textured pixels peak outside, judged one by one, ...
const BEYOND: f64 = 0.01;
/// ... and more than this share lie in cells whose mean peaks outside.
const IN_CELLS: f64 = 0.012;
/// A peak farther before the end slice than this, in units of the distance between the slices compared, is outside the
/// range.
const OUTSIDE: f32 = 0.75;
/// The same two limits for a decision map that is not refined. It has more pixels beside outlines in the end slice.
/// There saliency falls with defocus more slowly than on a surface, which moves the peak of the parabola outwards.
const IN_CELLS_UNREFINED: f64 = 0.013;
const OUTSIDE_UNREFINED: f32 = 1.5;
/// Cells in each direction over the canvas, and the fewest points of a cell.
const GRID: usize = 20;
const LEAST_POINTS: usize = 6;

/// Whether a considerable part of the object is in focus beyond an end of the stack. `curves` are the textured pixels
/// that are labelled with the end slice: position, and saliency in the end slice and in two slices after it, all
/// equally far apart. `textured` is the number of all textured pixels, `noise` the saliency of noise, `refined` as in
/// [`super::DecisionMap`].
///
/// Two tests must agree. A single pixel is unreliable: noise and defocus spread change its three values, and where a
/// large part lies just inside the end, as a plate may, some of its pixels seem to lie outside. Means over a cell are
/// reliable, but a cell also counts the pixels of other parts beside a thin part that extends outside.
pub(super) fn extends_beyond(
    curves: impl Iterator<Item = ((usize, usize), [f32; 3])>,
    textured: usize,
    (width, height): (usize, usize),
    noise: f32,
    refined: bool,
) -> bool {
    let (outside, share_in_cells) = if refined { (OUTSIDE, IN_CELLS) } else { (OUTSIDE_UNREFINED, IN_CELLS_UNREFINED) };
    let mut cells = vec![(0usize, [0.0f32; 3]); GRID * GRID];
    let mut single = 0usize;
    for ((x, y), saliency) in curves {
        single += usize::from(curve::peaks_before(saliency, noise, outside));
        if saliency[2] > 0.0 {
            let cell = &mut cells[(y * GRID / height.max(1)) * GRID + x * GRID / width.max(1)];
            cell.0 += 1;
            cell.1.iter_mut().zip(saliency).for_each(|(sum, value)| *sum += value);
        }
    }
    let is_outside = |(count, sums): &&(usize, [f32; 3])| {
        *count >= LEAST_POINTS && curve::peaks_before(sums.map(|sum| sum / *count as f32), noise, outside)
    };
    let in_cells: usize = cells.iter().filter(is_outside).map(|(count, _)| count).sum();
    let share = |part: usize| part as f64 / textured.max(1) as f64;
    share(single) > BEYOND && share(in_cells) > share_in_cells
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels in focus at `z` (below 0: before the end slice), with scattered saliency.
    fn curves(z: f32, count: usize) -> Vec<((usize, usize), [f32; 3])> {
        let one = |i: usize| {
            let scatter = |n: usize| 1.0 + 0.3 * (((i * 7919 + n * 104_729) % 101) as f32 / 101.0 - 0.5);
            let value = |n: usize| 3.0 + 40.0 / (1.0 + ((n as f32 - z) / 1.5).powi(2)) * scatter(n);
            ((i % 400, i / 400), [value(0), value(1), value(2)])
        };
        (0..count).map(one).collect()
    }

    fn extends(z: f32, count: usize, refined: bool) -> bool {
        extends_beyond(curves(z, count).into_iter(), 40_000, (400, 300), 3.0, refined)
    }

    #[test]
    fn a_part_just_inside_the_end_is_not_reported_although_single_pixels_scatter_outside() {
        let alone = curves(-0.3, 4000).iter().filter(|(_, s)| curve::peaks_before(*s, 3.0, OUTSIDE)).count();
        assert!(alone > 200, "{alone} of 4000 seem to lie outside when judged singly");
        assert!(!extends(-0.3, 4000, true) && !extends(0.2, 4000, true));
    }

    #[test]
    fn a_part_that_lies_steps_outside_is_reported_if_it_is_large_enough() {
        assert!(extends(-2.0, 4000, true) && extends(-2.0, 4000, false));
        assert!(!extends(-2.0, 300, true) && !extends(-2.0, 0, true));
        // between the limits of the two kinds of decision maps
        assert!(extends(-2.0, 500, true) && !extends(-2.0, 500, false));
    }
}
