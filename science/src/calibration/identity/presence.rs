//! Presence: which cells show a dot and which show none, by their likeness to the mean cell.

use std::collections::BTreeSet;

use super::cells::{CELL, Samples};
use crate::calibration::statistics::mad_sigma;

/// Strength of the pattern in a cell, relative to the mean cell, below which it shows no dot, and above which it does.
const PRESENCE: [f64; 2] = [0.25, 0.6];
/// Scatter of the strengths of known dots beyond which dots cannot be told from gaps (strong blur, noise).
const MAX_SCATTER: f64 = 0.1;
/// Share of the variance of a cell that the mean cell explains, below which it is not taken for a dot.
const MIN_EXPLAINED: f64 = 0.4;
/// What a cell shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Presence {
    /// Not in the image, or at full scale.
    Invalid,
    /// No decision.
    Unclear,
    /// A dot.
    Dot,
    /// No dot.
    Gap,
}

/// How much a cell looks like the mean cell.
struct Likeness {
    /// Regression coefficient of its samples on those of the mean cell, with a free offset: 1 for a dot, 0 for none.
    strength: f64,
    /// Share of the variance of its samples that the mean cell explains.
    explained: f64,
}

/// Compares a cell with the mean cell; `None` when the samples in the image do not determine it.
fn likeness(cell: &Samples, pattern: &[f64; CELL]) -> Option<Likeness> {
    let inside = || cell.iter().zip(pattern).filter_map(|(v, p)| v.map(|v| (f64::from(v), *p)));
    let n = inside().count() as f64;
    let (v, p) = inside().fold((0.0, 0.0), |s, (v, p)| (s.0 + v / n, s.1 + p / n));
    let (both, own, energy) =
        inside().map(|x| (x.0 - v, x.1 - p)).fold((0.0, 0.0, 0.0), |s, (v, p)| (s.0 + v * p, s.1 + v * v, s.2 + p * p));
    let mean = pattern.iter().sum::<f64>() / CELL as f64;
    let whole = pattern.iter().map(|p| (p - mean).powi(2)).sum::<f64>();
    (energy > 0.4 * whole && whole > 1e-12)
        .then(|| Likeness { strength: both / energy, explained: both * both / (energy * own).max(1e-24) })
}

/// What each cell shows, by its likeness to a dot. `known`: cells that tracking takes for dots.
pub(super) fn presence(cells: &[Option<Samples>], pattern: &[f64; CELL], known: &[usize]) -> Vec<Presence> {
    let of = |k: usize| cells[k].as_ref().and_then(|c| likeness(c, pattern));
    if mad_sigma(known.iter().filter_map(|&k| of(k)).map(|l| l.strength - 1.0)) >= MAX_SCATTER {
        let shown = |cell: &Option<Samples>| cell.as_ref().map_or(Presence::Invalid, |_| Presence::Unclear);
        return cells.iter().map(shown).collect();
    }
    let is_known: BTreeSet<usize> = known.iter().copied().collect();
    let shown = |k: usize| match of(k) {
        _ if cells[k].is_none() => Presence::Invalid,
        Some(l) if l.strength < PRESENCE[0] => Presence::Gap,
        // the border of the target half in a cell may be as strong as a dot, but it has another shape
        Some(l) if l.explained < MIN_EXPLAINED => {
            // a dot that the border of the image cuts may have any shape
            let is_whole = cells[k].as_ref().is_some_and(|c| c.iter().all(Option::is_some));
            if is_known.contains(&k) || !is_whole { Presence::Unclear } else { Presence::Gap }
        }
        Some(l) if l.strength > PRESENCE[1] => Presence::Dot,
        _ => Presence::Unclear,
    };
    (0..cells.len()).map(shown).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::identity::cells::SIDE;

    #[test]
    fn the_border_of_the_target_in_a_cell_beyond_the_grid_is_no_dot() {
        let along = |k: usize| (k as f64 + 0.5) / SIDE as f64 - 0.5;
        let wave = |k: usize| (std::f64::consts::TAU * along(k)).cos();
        // dots blurred by a third of the pitch, and a dark table that begins 0.8 steps from the outermost of them
        let pattern: [f64; CELL] = std::array::from_fn(|n| 0.13 * (wave(n % SIDE) + wave(n / SIDE)));
        let dot: Samples = std::array::from_fn(|n| Some(pattern[n] as f32));
        let table: Samples = std::array::from_fn(|n| Some(if along(n % SIDE) > -0.2 { 0.59 } else { 0.0 }));
        let strength = likeness(&table, &pattern).expect("in the image").strength;
        assert!(strength > PRESENCE[1], "as strong as a dot: {strength}");
        let mut cut = table;
        cut[3] = None;
        let cells = [Some(dot), Some(dot), Some(table), Some(table), Some(cut), None];
        // a known dot of another shape is unclear, and so is a cell that the border of the image cuts
        let expected = [Presence::Dot, Presence::Dot, Presence::Unclear, Presence::Gap, Presence::Unclear];
        let shown = presence(&cells, &pattern, &[0, 1, 2]);
        assert_eq!((&shown[..5], shown[5]), (&expected[..], Presence::Invalid));
    }
}
