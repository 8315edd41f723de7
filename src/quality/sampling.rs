//! The sparse grid of pixels on which the saliency of every slice is kept.

/// At most this many pixels are kept per slice.
pub(super) const MOST: usize = 65_536;

/// Every `step`-th pixel of every `step`-th row, the same for every slice of a stack.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sampling {
    width: usize,
    height: usize,
    step: usize,
}

impl Sampling {
    pub(super) fn new(width: usize, height: usize) -> Self {
        let mut step = 1;
        while width.div_ceil(step) * height.div_ceil(step) > MOST {
            step += 1;
        }
        Self { width, height, step }
    }

    /// The pixels (x, y), row by row.
    pub(super) fn positions(self) -> impl Iterator<Item = (usize, usize)> {
        let Self { width, height, step } = self;
        // centred, but never beyond a canvas that is narrower than a step
        let first = move |size: usize| ((step - 1) / 2).min(size.saturating_sub(1));
        let columns = move || (first(width)..width).step_by(step);
        (first(height)..height).step_by(step).flat_map(move |y| columns().map(move |x| (x, y)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_large_canvas_is_sampled_sparsely_and_a_small_one_wholly() {
        let large = Sampling::new(6000, 4000).positions().count();
        assert!((MOST / 2..=MOST).contains(&large), "{large}");
        assert_eq!(Sampling::new(40, 30).positions().count(), 1200);
        assert!(Sampling::new(6001, 4003).positions().all(|(x, y)| x < 6001 && y < 4003));
    }

    #[test]
    fn a_canvas_of_one_row_is_sampled() {
        assert_eq!(Sampling::new(300_000, 1).positions().count(), 60_000);
    }
}
