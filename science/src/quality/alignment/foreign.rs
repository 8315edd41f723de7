//! Foreign slices: those that show another view, or another object, than the slices around them.
//!
//! In: the brightness of the slices in cells, and their windows. Out: runs of at most [`LONGEST`] slices, shorter than
//! the rest of the stack, that resemble neither neighbour although the neighbours resemble each other. At an end of the
//! stack, the two slices beside the run take the place of the neighbours.
//!
//! Two measures must agree, because blur can spoil either. First, for all slices: how much the ratio of brightness
//! varies from cell to cell. Cells are larger than most blur, so it is small for one view, whatever is in focus and
//! however bright the light is. Then, for the slices that this makes suspect: the number of windows that have a common
//! texture, at any shift.

use super::{
    shift::{LEAST_SHIFTS, ReadWindow},
    unfocused_pairs::UnfocusedPairs,
};
use crate::{
    imaging::Rect,
    quality::slice::{Brightness, SliceMeasurements},
};

/// Longest run of foreign slices.
const LONGEST: usize = 3;
/// Variation of the ratio of brightness (half the range of all cells but the outermost 2 % on either side, natural
/// logarithm) from which two slices may show different things ...
const LEAST_VARIATION: f64 = 0.05;
/// ... if it is also this many times that of the two slices around.
const TIMES_NEIGHBOURS: f64 = 2.0;
/// Share of the windows that neighbours have in common which a foreign slice may have in common with them: things that
/// do not turn with the object are in every view.
const COMMON: f64 = 1.0 / 3.0;

/// The foreign slices, ascending. `windows` are of one size, on a canvas of `size`.
pub(super) fn slices(
    measurements: &[SliceMeasurements],
    read: &ReadWindow<'_>,
    windows: &[Rect],
    size: (usize, usize),
) -> Vec<u32> {
    let brightness: Vec<&Brightness> = measurements.iter().map(|slice| &slice.brightness).collect();
    let mut suspects = runs(brightness.len()).filter(|run| run.is_suspect(&brightness)).peekable();
    if suspects.peek().is_none() {
        return Vec::new();
    }
    let Some(pairs) = UnfocusedPairs::new(read, windows, size) else { return Vec::new() };
    let common = |pair: (usize, usize)| pairs.shifts(pair.0, pair.1).len();
    let mut foreign: Vec<u32> = Vec::new();
    for run in suspects {
        // beside foreign slices, a longer run seems foreign too
        let of_run = |slice: &u32| {
            let slice = *slice as usize;
            (run.first..=run.last).contains(&slice) || [run.around.0, run.around.1].contains(&slice)
        };
        if foreign.iter().any(of_run) {
            continue;
        }
        let own = common(run.around);
        let is_apart = |pair: (usize, usize)| common(pair) as f64 <= COMMON * own as f64;
        if own >= LEAST_SHIFTS && run.beside.into_iter().all(is_apart) {
            foreign.extend((run.first..=run.last).map(|slice| slice as u32));
        }
    }
    foreign.sort_unstable();
    foreign
}

/// A run of slices that may be foreign.
struct Run {
    first: usize,
    last: usize,
    /// The slices around it, which must resemble each other.
    around: (usize, usize),
    /// Pairs of a slice of the run and one outside, which must not.
    beside: [(usize, usize); 2],
}

/// All runs of a stack of `count` slices, short ones first.
fn runs(count: usize) -> impl Iterator<Item = Run> {
    let longest = LONGEST.min(count.saturating_sub(1) / 2);
    (1..=longest).flat_map(move |length| {
        (0..=count - length).map(move |first| {
            let last = first + length - 1;
            let (around, beside) = match (first, last + 1 == count) {
                (0, _) => ((last + 1, last + 2), [(last, last + 1), (last, last + 2)]),
                (_, true) => ((first - 2, first - 1), [(first - 2, first), (first - 1, first)]),
                _ => ((first - 1, last + 1), [(first - 1, first), (last, last + 1)]),
            };
            Run { first, last, around, beside }
        })
    })
}

impl Run {
    fn is_suspect(&self, brightness: &[&Brightness]) -> bool {
        let variation = |(a, b): (usize, usize)| brightness[b].variation(brightness[a]);
        let Some(usual) = variation(self.around) else { return false };
        let least = LEAST_VARIATION.max(TIMES_NEIGHBOURS * usual);
        self.beside.into_iter().all(|pair| variation(pair).is_some_and(|variation| variation > least))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_slice_is_compared_with_two_slices_that_are_not_in_its_run() {
        for count in 0..12 {
            let mut single = 0;
            for Run { first, last, around, beside } in runs(count) {
                assert!(last < count && 2 * (last + 1 - first) < count, "{first} to {last} of {count}");
                let outside = |slice: usize| slice < count && !(first..=last).contains(&slice);
                assert!(outside(around.0) && outside(around.1) && around.0 < around.1);
                for (a, b) in beside {
                    assert!(a < b && outside(a) != outside(b), "{a} and {b} for {first} to {last} of {count}");
                }
                single += usize::from(first == last);
            }
            assert_eq!(single, if count < 3 { 0 } else { count });
        }
    }
}
