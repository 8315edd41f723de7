//! What the target shows, by several slices together: which cells are dots, and which are not.
//!
//! A slice of a larger scale may show no end of the grid where one of a smaller scale does. Compared with the map of
//! all slices whose labels are certain, its dots conflict with the gaps that those slices show.

use std::collections::BTreeMap;

use super::fingerprint::{Fingerprint, OUTSIDE, cut, size};
use super::{cells::CELL, presence::Presence};
use crate::calibration::lattice::{Label, label_range};

/// What the target shows by all `prints` together: cells that one of them shows, and none contradicts. The result has
/// no deviations. `None` without prints.
pub(super) fn of<'a>(prints: impl Iterator<Item = &'a Fingerprint>) -> Option<Fingerprint> {
    let mut votes: BTreeMap<Label, [bool; 2]> = BTreeMap::new();
    let mut any = None;
    for print in prints {
        for (label, k) in print.cells() {
            let [dot, gap] = votes.entry(label).or_default();
            *dot |= print.presence[k] == Presence::Dot;
            *gap |= print.presence[k] == Presence::Gap;
        }
        any = Some(print);
    }
    let any = any?;
    let mut ranges = [0, 1].map(|axis| {
        let (low, high) = label_range(votes.keys().copied(), axis);
        [low, high.max(low)]
    });
    cut(&mut ranges);
    let [columns, rows] = ranges.map(size);
    let origin = [ranges[0][0], ranges[1][0]];
    let shown = |k: usize| {
        let label = [origin[0] + (k % columns) as i32, origin[1] + (k / columns) as i32];
        match votes.get(&label) {
            None => Presence::Invalid,
            Some([true, false]) => Presence::Dot,
            Some([false, true]) => Presence::Gap,
            Some(_) => Presence::Unclear,
        }
    };
    let presence: Vec<Presence> = (0..columns * rows).map(shown).collect();
    let samples = vec![OUTSIDE; presence.len() * CELL];
    Some(Fingerprint { origin, columns, rows, presence: presence.into(), samples: samples.into(), ..any.clone() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::types::Homography;

    /// One row of cells.
    fn row(first: i32, presence: &[Presence]) -> Fingerprint {
        Fingerprint {
            origin: [first, 0],
            columns: presence.len(),
            rows: 1,
            presence: presence.into(),
            samples: vec![0; presence.len() * CELL].into(),
            to_slice: Homography::IDENTITY,
            pitch: 20.0,
        }
    }

    #[test]
    fn the_map_shows_what_one_slice_shows_and_none_contradicts() {
        use Presence::{Dot, Gap, Invalid, Unclear};
        let near = row(0, &[Dot, Dot, Unclear]);
        let wide = row(1, &[Dot, Gap, Invalid, Gap]);
        let map = of([&near, &wide].into_iter()).expect("two slices");
        assert_eq!((map.origin, &map.presence[..]), ([0, 0], &[Dot, Dot, Gap, Invalid, Gap][..]));
        assert!(map.samples.iter().all(|sample| *sample == OUTSIDE));
        let other = row(2, &[Dot]);
        let map = of([&near, &wide, &other].into_iter()).expect("three slices");
        assert_eq!(map.presence[2], Unclear);
        assert!(of(std::iter::empty()).is_none());
    }
}
