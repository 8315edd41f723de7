//! The positions of a row whose neighbourhood is inside the slice, so that it can be read without bounds checks.

use std::ops::Range;

use super::parts::PHASE_BITS;

/// The range of positions whose 4 x 4 pixels are inside the slice, in 1/1024 px.
#[derive(Debug, Clone, Copy)]
pub(super) struct Inside {
    most: [i32; 2],
}

impl Inside {
    /// For a slice of `width` x `height` px. A read covers `columns` columns (at least four), starting one before the
    /// pixel.
    pub(super) fn of(width: usize, height: usize, columns: usize) -> Self {
        let most = |length: usize, after: usize| i32::try_from(length.saturating_sub(after) << PHASE_BITS).unwrap_or(0);
        Self { most: [most(width, columns.max(4) - 2), most(height, 2)] }
    }

    /// The indices from the first to the last such position of `us`, `vs`; empty when one between them is outside.
    #[inline(always)]
    pub(super) fn run(self, us: &[i32], vs: &[i32]) -> Range<usize> {
        const LEAST: i32 = 1 << PHASE_BITS;
        let [most_u, most_v] = self.most;
        let inside = |(&u, &v): (&i32, &i32)| (u >= LEAST) & (v >= LEAST) & (u < most_u) & (v < most_v);
        let count = us.len().min(vs.len());
        let (us, vs) = (&us[..count], &vs[..count]);
        let Some(first) = us.iter().zip(vs).position(inside) else { return 0..0 };
        let last = us.iter().zip(vs).rposition(inside).unwrap_or(first);
        let all = us[first..=last].iter().zip(&vs[first..=last]).fold(true, |all, place| all & inside(place));
        if all { first..last + 1 } else { 0..0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_contains_the_positions_with_a_complete_neighbourhood() {
        let (width, height) = (9, 7);
        let inside = Inside::of(width, height, 4);
        let deep = |at: i32, length: usize| (1..length as i32 - 2).contains(&(at >> PHASE_BITS));
        for v in (0..(height as i32) << PHASE_BITS).step_by(301) {
            let us: Vec<i32> = (0..(width as i32) << PHASE_BITS).step_by(97).collect();
            let run = inside.run(&us, &vec![v; us.len()]);
            for (i, &u) in us.iter().enumerate() {
                assert_eq!(run.contains(&i), deep(u, width) && deep(v, height), "{u}, {v}");
            }
        }
        // wider reads end further from the right border
        assert_eq!(Inside::of(9, 7, 6).run(&[4 << PHASE_BITS, 5 << PHASE_BITS], &[2 << PHASE_BITS; 2]), 0..1);
    }

    #[test]
    fn a_run_with_a_gap_is_none() {
        let places = [2 << PHASE_BITS, 0, 2 << PHASE_BITS];
        assert_eq!(Inside::of(9, 9, 4).run(&places, &[2 << PHASE_BITS; 3]), 0..0);
    }
}
