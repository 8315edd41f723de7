//! The grid of dots: labels, positions, pitch, and the positions where a grid would go on.

use std::collections::BTreeMap;

use super::{dlt, statistics::median};

/// Column and row of a dot in the grid. The origin and the direction of the columns are arbitrary, but the same for all
/// slices of a stack.
pub(super) type Label = [i32; 2];

/// Positions of labelled dots.
pub(super) type Places = BTreeMap<Label, [f64; 2]>;

/// A grid of dots.
#[derive(Debug, Clone)]
pub(super) struct Lattice {
    /// Position of each dot.
    pub places: Places,
    /// Distance between neighbouring dots, px: median over both directions.
    pub pitch: f64,
}

impl Lattice {
    /// True when this grid is more plausible than `other`, which was found in the same image with the other polarity.
    /// The larger one wins, except when the pitches differ by sqrt(2): the gaps between dots also form a grid, rotated
    /// by 45 degrees and with twice as many positions.
    pub(super) fn outdoes(&self, other: &Self) -> bool {
        let between = |ratio: f64| (ratio / std::f64::consts::SQRT_2 - 1.0).abs() < 0.03;
        match self.pitch / other.pitch {
            ratio if between(ratio) => 3 * self.places.len() > other.places.len(),
            ratio if between(1.0 / ratio) => self.places.len() > 3 * other.places.len(),
            _ => self.places.len() > other.places.len(),
        }
    }
}

/// Fewest dots that make a grid.
pub(super) const MIN_DOTS: usize = 12;

/// Steps to the four neighbours of a label.
pub(super) const STEPS: [Label; 4] = [[1, 0], [-1, 0], [0, 1], [0, -1]];

/// Least and largest label along an axis; `(i32::MAX, i32::MIN)` without labels.
pub(super) fn label_range(labels: impl Iterator<Item = Label>, axis: usize) -> (i32, i32) {
    labels.fold((i32::MAX, i32::MIN), |(low, high), label| (low.min(label[axis]), high.max(label[axis])))
}

/// Median distance between grid neighbours.
pub(super) fn pitch_of(places: &Places) -> f64 {
    let mut lengths = Vec::new();
    for (label, p) in places {
        for step in [[1, 0], [0, 1]] {
            if let Some(q) = places.get(&[label[0] + step[0], label[1] + step[1]]) {
                lengths.push((p[0] - q[0]).hypot(p[1] - q[1]));
            }
        }
    }
    median(&mut lengths)
}

/// Predicted positions of the dots that are missing in the grid or lie beside it, corners included: linear
/// extrapolation from two dots in line, averaged over the directions.
pub(super) fn beside(places: &Places) -> Places {
    let mut ring = in_line(places);
    let both = |label: Label| places.get(&label).or_else(|| ring.get(&label)).copied();
    let mut corners = Places::new();
    for label in ring.keys() {
        for [i, j] in STEPS {
            // a step sideways from a position beside the grid, and the parallel step inside the grid
            let (next, base) = ([label[0] + i, label[1] + j], both(*label));
            let across = [[j, i], [-j, -i]].map(|[a, b]| {
                let (inner, outer) = (both([label[0] + a, label[1] + b]), both([next[0] + a, next[1] + b]));
                inner.zip(outer)
            });
            if both(next).is_some() {
                continue;
            }
            if let (Some(p), Some((inner, outer))) = (base, across.into_iter().flatten().next()) {
                corners.insert(next, [p[0] + outer[0] - inner[0], p[1] + outer[1] - inner[1]]);
            }
        }
    }
    ring.extend(corners);
    evened(places, ring)
}

/// Most dots that the homography of the whole grid is fitted to.
const MAPPED: usize = 400;

/// Refines the positions beside the grid: the homography of the whole grid plus the mean deviation of the dots nearby.
/// Extrapolation from two dots alone would double the error of the outer one; and where a dot is drawn in too far out,
/// its neighbour is measured too far out in the next round.
fn evened(places: &Places, ring: Places) -> Places {
    let unit = |l: &Label| l.map(f64::from);
    // inner dots, where there are enough: the outermost depend on what is drawn in beside them
    let is_inner = |l: &Label| STEPS.iter().all(|[i, j]| places.contains_key(&[l[0] + i, l[1] + j]));
    let mut inner: Places = places.iter().filter(|(l, _)| is_inner(l)).map(|(l, p)| (*l, *p)).collect();
    if inner.len() < MIN_DOTS {
        inner.clone_from(places);
    }
    let every = inner.len().div_ceil(MAPPED).max(1);
    let pairs: Vec<dlt::Pair> = inner.iter().step_by(every).map(|(l, p)| (unit(l), *p)).collect();
    let Some(grid) = (pairs.len() >= MIN_DOTS).then(|| dlt::fit(&pairs)).flatten() else { return ring };
    let even = |label: Label| {
        let around = (-2..=2).flat_map(|i| (-2..=2).map(move |j| [label[0] + i, label[1] + j]));
        let (mut off, mut count) = ([0.0, 0.0], 0.0_f64);
        for (l, p) in around.filter_map(|l| inner.get(&l).map(|p| (l, p))) {
            let there = grid.apply(unit(&l));
            off = [off[0] + p[0] - there[0], off[1] + p[1] - there[1]];
            count += 1.0;
        }
        let at = grid.apply(unit(&label));
        let count = count.max(1.0);
        let place = [at[0] + off[0] / count, at[1] + off[1] / count];
        (label, place)
    };
    ring.into_keys().map(even).collect()
}

fn in_line(places: &Places) -> Places {
    let mut sums: BTreeMap<Label, ([f64; 2], f64)> = BTreeMap::new();
    for (label, p) in places {
        for step in STEPS {
            let (next, back) = ([label[0] + step[0], label[1] + step[1]], [label[0] - step[0], label[1] - step[1]]);
            if places.contains_key(&next) {
                continue;
            }
            if let Some(q) = places.get(&back) {
                let sum = sums.entry(next).or_default();
                sum.0 = [sum.0[0] + 2.0 * p[0] - q[0], sum.0[1] + 2.0 * p[1] - q[1]];
                sum.1 += 1.0;
            }
        }
    }
    sums.into_iter().map(|(label, (sum, n))| (label, [sum[0] / n, sum[1] / n])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_positions_beside_a_grid_extrapolate_it() {
        let places: Places =
            (0..9).map(|k| ([k % 3, k / 3], [f64::from(k % 3) * 10.0, f64::from(k / 3) * 10.0])).collect();
        let ring = beside(&places);
        assert_eq!(ring.len(), 16);
        assert_eq!(ring[&[3, 3]], [30.0, 30.0]);
        assert_eq!(ring[&[-1, 3]], [-10.0, 30.0]);
        assert_eq!(ring[&[3, 1]], [30.0, 10.0]);
        assert_eq!(ring[&[0, -1]], [0.0, -10.0]);
    }
}
