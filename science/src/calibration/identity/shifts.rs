//! Comparison of two fingerprints over shifts of the labels by whole grid steps.
//!
//! Two kinds of evidence tell shifts apart.
//!
//! - *Conflicts*: cells that show a dot in one slice and a gap in the other. Neither light nor dust on the sensor makes
//!   or removes a dot, so this evidence is always about the target.
//! - *Correlation* of the deviations. What stays with the sensor (dust, reflections) correlates too, so this evidence
//!   counts only where [`super::sensor`] finds that the deviations move with the target.

use super::cells::{CELL, SIDE};
use super::fingerprint::{Fingerprint, OUTSIDE};
use super::presence::Presence;
use crate::calibration::lattice::Label;

/// Largest shift along each grid direction, steps.
pub(super) const REACH: i32 = 4;
/// Largest distance over which deviations extend, steps along each grid direction.
const NEAR: i32 = 2;
/// Fewest cells that two slices must share under a shift.
const MIN_CELLS: usize = 12;
/// Correlation that chance does not reach, in its standard deviations under a wrong shift.
const SIGNIFICANT: f64 = 5.0;
/// Least lead of the best correlation.
const LEAD: f64 = 0.02;
/// Least excess of conflicts under a rejected shift, besides two standard deviations.
const CONFLICTS: f64 = 2.0;

/// All shifts, row by row.
pub(super) fn all() -> impl Iterator<Item = Label> {
    (-REACH..=REACH).flat_map(|j| (-REACH..=REACH).map(move |i| [i, j]))
}

/// Agreement of two slices under one shift: cell `l` of the first is cell `l + shift` of the second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Agreement {
    /// The shift.
    pub(super) shift: Label,
    /// Cells that both show.
    pub(super) cells: usize,
    /// Cells that show a dot in one and a gap in the other.
    pub(super) conflicts: usize,
    /// Correlation of the deviations, -1..1.
    pub(super) correlation: f64,
}

/// The agreement under one shift.
pub(super) fn agreement(a: &Fingerprint, b: &Fingerprint, shift: Label) -> Agreement {
    let (mut cells, mut conflicts) = (0, 0);
    let (mut both, mut first, mut second) = (0_i64, 0_i64, 0_i64);
    for (label, k) in a.cells() {
        let Some(n) = b.cell([label[0] + shift[0], label[1] + shift[1]]) else { continue };
        cells += 1;
        let pair = (a.presence[k], b.presence[n]);
        conflicts += usize::from(matches!(pair, (Presence::Dot, Presence::Gap) | (Presence::Gap, Presence::Dot)));
        let mut sums = [0_i32; 3];
        for (x, y) in a.deviations(k).iter().zip(b.deviations(n)) {
            let inside = i32::from(*x != OUTSIDE && *y != OUTSIDE);
            let (x, y) = (inside * i32::from(*x), inside * i32::from(*y));
            sums[0] += x * y;
            sums[1] += x * x;
            sums[2] += y * y;
        }
        both += i64::from(sums[0]);
        first += i64::from(sums[1]);
        second += i64::from(sums[2]);
    }
    let correlation = both as f64 / ((first as f64).sqrt() * (second as f64).sqrt()).max(1.0);
    Agreement { shift, cells, conflicts, correlation }
}

/// A slice compared with another one.
#[derive(Debug, Clone)]
pub(super) struct Comparison {
    agreements: Vec<Agreement>,
    /// Standard deviation of the correlation under a wrong shift.
    chance: f64,
}

impl Comparison {
    /// Compares slice `a` with slice `b`.
    pub(super) fn new(a: &Fingerprint, b: &Fingerprint) -> Self {
        let agreements: Vec<Agreement> = all().map(|shift| agreement(a, b, shift)).collect();
        let cells = agreements[agreements.len() / 2].cells.max(1) as f64;
        // Bartlett: deviations that extend over several cells leave fewer independent ones
        let near = || all().filter(|s| s[0].abs() <= NEAR && s[1].abs() <= NEAR);
        let overlap: f64 = near().map(|s| agreement(a, a, s).correlation * agreement(b, b, s).correlation).sum();
        let bound = (overlap.max(1.0) / cells).sqrt();
        let best = agreements.iter().map(|g| g.correlation).fold(f64::MIN, f64::max);
        let others: Vec<f64> =
            agreements.iter().filter(|g| g.correlation < best).map(|g| g.correlation.powi(2)).collect();
        let seen = (others.iter().sum::<f64>() / others.len().max(1) as f64).sqrt();
        Self { chance: bound.min(seen.max(1.0 / (cells * CELL as f64).sqrt())), agreements }
    }

    /// True (mirrored) or false (turned) when the first slice, `a`, shows the target in another orientation than the
    /// second, `b`: another symmetry of the square grid has clearly fewer conflicts than every shift. Only conflicts
    /// count, because the end of a blurred grid is symmetric and correlates in every orientation.
    pub(super) fn orientation(&self, a: &Fingerprint, b: &Fingerprint) -> Option<bool> {
        let least = 4 * self.at([0, 0]).cells / 5;
        let fewest = |list: &[Agreement]| list.iter().filter(|g| g.cells >= least).map(|g| g.conflicts).min();
        let straight = fewest(&self.agreements)?;
        if (straight as f64) < 2.0 * CONFLICTS {
            return None;
        }
        let turned = (1..8).filter_map(|k| {
            let [x, y] = [1, 2].map(|bit| if k & bit == 0 { 1 } else { -1 });
            let turn = |d: Label| if k & 4 == 0 { [x * d[0], y * d[1]] } else { [x * d[1], y * d[0]] };
            let is_mirrored = (x * y < 0) == (k & 4 == 0);
            let turned = a.turned(turn);
            let list: Vec<Agreement> = all().map(|shift| agreement(&turned, b, shift)).collect();
            Some((fewest(&list)?, is_mirrored))
        });
        let (conflicts, is_mirrored) = turned.min()?;
        let lead = straight as f64 - conflicts as f64;
        (lead >= 2.0 * CONFLICTS + 3.0 * (conflicts as f64).sqrt()).then_some(is_mirrored)
    }

    fn at(&self, shift: Label) -> &Agreement {
        &self.agreements[((shift[1] + REACH) * (2 * REACH + 1) + shift[0] + REACH) as usize]
    }

    /// True when too little is seen under this shift to judge it: it would move most of the target out of the image.
    fn is_remote(&self, shift: Label) -> bool {
        let (cells, whole) = (self.at(shift).cells, self.at([0, 0]).cells);
        cells < MIN_CELLS || 4 * cells < whole
    }

    /// True when the conflicts speak for `s` and against `t`.
    fn by_conflicts(&self, s: Label, t: Label) -> bool {
        let [s, t] = [s, t].map(|shift| self.at(shift).conflicts as f64);
        t - s >= CONFLICTS + 2.0 * s.sqrt()
    }

    /// True when the correlation speaks for `s` and against `t`.
    fn by_correlation(&self, s: Label, t: Label) -> bool {
        let [s, t] = [s, t].map(|shift| self.at(shift).correlation);
        let scatter = (2.0 * (1.0 - s * s).max(0.0)).sqrt() * self.chance;
        s >= SIGNIFICANT * self.chance && s - t >= LEAD + SIGNIFICANT * scatter
    }
}

/// The shift of a slice, as far as the comparisons with other slices determine it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Decision {
    /// The best shift: add it to the labels of the slice.
    pub(super) shift: Label,
    /// True when all other shifts are rejected.
    pub(super) certain: bool,
}

impl Decision {
    /// No shift.
    pub(super) const RIGHT: Self = Self { shift: [0, 0], certain: true };

    /// This decision followed by another one about the labels that it corrects.
    pub(super) fn then(self, next: Self) -> Self {
        let shift = [0, 1].map(|a| self.shift[a] + next.shift[a]);
        Self { shift, certain: self.certain && next.certain }
    }
}

/// Decides between the shifts. `correlate`: the correlation counts too.
pub(super) fn decide(comparisons: &[Comparison], correlate: bool) -> Decision {
    let for_it = |s: Label, t: Label| comparisons.iter().any(|c| c.by_conflicts(s, t));
    let beats = |s: Label, t: Label| {
        for_it(s, t)
            || (correlate && !for_it(t, s) && comparisons.iter().any(|c| c.by_correlation(s, t)))
            || comparisons.iter().all(|c| c.is_remote(t))
    };
    let sum = |s: Label, of: &dyn Fn(&Agreement) -> f64| comparisons.iter().map(|c| of(c.at(s))).sum::<f64>();
    let size = |s: &Label| s[0] * s[0] + s[1] * s[1];
    let seen = || all().filter(|s| !comparisons.iter().all(|c| c.is_remote(*s)));
    let fewest = seen().min_by(|a, b| {
        let of = |s: &Label| sum(*s, &|g| g.conflicts as f64);
        let alike = |s: &Label| if correlate { sum(*s, &|g| g.correlation) } else { 0.0 };
        of(a).total_cmp(&of(b)).then(alike(b).total_cmp(&alike(a))).then(size(a).cmp(&size(b)))
    });
    let most_alike = seen()
        .max_by(|a, b| sum(*a, &|g| g.correlation).total_cmp(&sum(*b, &|g| g.correlation)).then(size(b).cmp(&size(a))))
        .filter(|_| correlate);
    let candidates: Vec<Label> = [Some([0, 0]), fewest, most_alike].into_iter().flatten().collect();
    let certain = candidates.iter().find(|s| all().all(|t| t == **s || beats(**s, t)));
    if let Some(shift) = certain {
        return Decision { shift: *shift, certain: true };
    }
    // not certain, but better than no shift
    let better = candidates.iter().skip(1).find(|s| **s != [0, 0] && beats(**s, [0, 0]));
    Decision { shift: better.copied().unwrap_or([0, 0]), certain: false }
}

/// True when the deviations of `a` agree better with those of `b` after a shift by half a step in both directions.
/// Where blur inverts the dots, gaps may be taken for dots.
pub(super) fn is_half_step_off(a: &Fingerprint, b: &Fingerprint) -> bool {
    let correlation = |shift: [f64; 2]| {
        let (mut both, mut first, mut second) = (0.0, 0.0, 0.0);
        for (label, k) in a.cells() {
            for (n, value) in a.deviations(k).iter().enumerate().filter(|(_, value)| **value != OUTSIDE) {
                let inside = [n % SIDE, n / SIDE].map(|i| (i as f64 + 0.5) / SIDE as f64 - 0.5);
                let at = [0, 1].map(|axis| f64::from(label[axis]) + inside[axis] + shift[axis]);
                if let Some(there) = b.deviation_at(at) {
                    both += f64::from(*value) * there;
                    first += f64::from(*value).powi(2);
                    second += there * there;
                }
            }
        }
        both / (f64::sqrt(first) * f64::sqrt(second)).max(1e-9)
    };
    let halves = [[0.5, 0.5], [0.5, -0.5], [-0.5, 0.5], [-0.5, -0.5]];
    halves.into_iter().map(correlation).fold(f64::MIN, f64::max) >= correlation([0.0, 0.0])
}
