//! Whether the object goes on beyond an end of the stack.

use super::curve;

/// More than this share of the textured pixels in focus beyond an end, one by one ...
const BEYOND: f64 = 0.01;
/// ... and this share where neighbours are asked together, when doubtful choices of slices were settled, and when they
/// are as the sharpest slice said: then more of the veil beside near parts is among them.
const TOGETHER: f64 = 0.012;
const TOGETHER_UNSETTLED: f64 = 0.015;
/// Cells in each direction over the canvas, and the fewest points of one.
const GRID: usize = 20;
const LEAST_POINTS: usize = 6;

/// Whether more than a little of the object would be in focus beyond an end. `curves` are the textured pixels that are
/// sharpest in the end slice: where they lie, and their saliency in it and in the two slices after it.
///
/// One pixel says little: noise and the veil of nearer parts bend its three values, and where much lies just inside of
/// the end, as a plate does, some of it seems to lie outside. Their means over a cell say more. But cells alone would
/// take in the many pixels of other parts with thin ones that reach out, so both are asked.
pub(super) fn extends_beyond(
    curves: impl Iterator<Item = ((usize, usize), [f32; 3])>,
    textured: usize,
    (width, height): (usize, usize),
    noise: f32,
    settled: bool,
) -> bool {
    let mut cells = vec![(0usize, [0.0f32; 3]); GRID * GRID];
    let mut alone = 0usize;
    for ((x, y), saliency) in curves {
        alone += usize::from(curve::peaks_before(saliency, noise));
        if saliency[2] > 0.0 {
            let cell = &mut cells[(y * GRID / height.max(1)) * GRID + x * GRID / width.max(1)];
            cell.0 += 1;
            cell.1.iter_mut().zip(saliency).for_each(|(sum, value)| *sum += value);
        }
    }
    let outside = |(count, sums): &&(usize, [f32; 3])| {
        *count >= LEAST_POINTS && curve::peaks_before(sums.map(|sum| sum / *count as f32), noise)
    };
    let together: usize = cells.iter().filter(outside).map(|(count, _)| count).sum();
    let share = |part: usize| part as f64 / textured.max(1) as f64;
    share(alone) > BEYOND && share(together) > if settled { TOGETHER } else { TOGETHER_UNSETTLED }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels in focus at `z` before the end slice, whose saliency scatters.
    fn curves(z: f32, count: usize) -> Vec<((usize, usize), [f32; 3])> {
        let one = |i: usize| {
            let scatter = |n: usize| 1.0 + 0.3 * (((i * 7919 + n * 104_729) % 101) as f32 / 101.0 - 0.5);
            let value = |n: usize| 3.0 + 40.0 / (1.0 + ((n as f32 - z) / 1.5).powi(2)) * scatter(n);
            ((i % 400, i / 400), [value(0), value(1), value(2)])
        };
        (0..count).map(one).collect()
    }

    fn told(z: f32, count: usize, settled: bool) -> bool {
        extends_beyond(curves(z, count).into_iter(), 40_000, (400, 300), 3.0, settled)
    }

    #[test]
    fn what_lies_just_inside_scatters_to_the_outside_and_is_not_told() {
        let alone = curves(-0.3, 4000).iter().filter(|(_, s)| curve::peaks_before(*s, 3.0)).count();
        assert!(alone > 200, "{alone} of 4000 seem to lie outside one by one");
        assert!(!told(-0.3, 4000, true) && !told(0.2, 4000, true));
    }

    #[test]
    fn what_lies_steps_outside_is_told_when_it_is_enough() {
        assert!(told(-2.0, 4000, true) && told(-2.0, 4000, false));
        assert!(!told(-2.0, 300, true) && !told(-2.0, 0, true));
        // cells that hold enough, but pixels that are few
        assert!(told(-2.0, 560, true) && !told(-2.0, 560, false));
    }
}
