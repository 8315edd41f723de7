//! What the first pass notes for labels: the sharpest slice over wide surroundings, and the level of noise.

use std::sync::Mutex;

use crate::{
    fusion::{UNCOVERED, locked, unlocked},
    imaging::Plane,
};

/// Side of a cell, px.
pub(super) const CELL: usize = 4;

/// Standard deviations of the Gaussians over cells: surroundings of 6 px and of 14 px.
const SIGMAS: [f32; 2] = [1.5, 3.5];

/// Cells whose energies are kept per slice, at most, to learn the noise from.
const SAMPLES: usize = 4096;

/// Times the noise under which surroundings have no detail: noise would say which slice is sharpest, another one at each
/// place.
const PLAIN: f32 = 2.0;

/// Running argmax of the focus energy over surroundings, cell by cell, while slices come in any order.
pub(crate) struct Survey {
    columns: usize,
    rows: usize,
    stride: usize,
    levels: Vec<Mutex<Level>>,
    /// Per slice: energies of every `stride`-th cell.
    samples: Mutex<Vec<Vec<f32>>>,
}

struct Level {
    kernel: Vec<f32>,
    best: Vec<f32>,
    slice: Vec<u16>,
}

/// What the survey ends with.
pub(super) struct Surveyed {
    /// The levels, from narrow to wide.
    pub wide: Vec<Wide>,
    /// Whether there is no detail in any slice in all that the levels look at.
    pub plain: Plane<bool>,
    /// Energy of a place without any detail, squared grey levels.
    pub noise: f32,
}

/// Wide surroundings of each cell.
pub(super) struct Wide {
    /// The slice that is sharpest in them.
    pub slice: Plane<u16>,
    /// Their mean energy in that slice, squared grey levels.
    pub energy: Plane<f32>,
}

impl Survey {
    pub(crate) fn new(width: usize, height: usize, slices: usize) -> Self {
        let (columns, rows) = (width.div_ceil(CELL), height.div_ceil(CELL));
        let cells = columns * rows;
        let level = |sigma: f32| {
            let radius = (2.5 * sigma).ceil() as usize;
            let half: Vec<f32> = (0..=radius).map(|d| (-((d * d) as f32) / (2.0 * sigma * sigma)).exp()).collect();
            let sum = half[0] + 2.0 * half[1..].iter().sum::<f32>();
            let kernel = half.iter().map(|weight| weight / sum).collect();
            Mutex::new(Level { kernel, best: vec![f32::NEG_INFINITY; cells], slice: vec![UNCOVERED; cells] })
        };
        Self {
            columns,
            rows,
            stride: cells.div_ceil(SAMPLES).max(1),
            levels: SIGMAS.into_iter().map(level).collect(),
            samples: Mutex::new(vec![Vec::new(); slices]),
        }
    }

    /// Cells of a slice, all empty.
    pub(crate) fn sheet(&self) -> Vec<f32> {
        vec![0.0; self.columns * self.rows]
    }

    /// Cells of `rows` rows of pixels.
    pub(crate) fn cells_of(&self, rows: usize) -> usize {
        rows.div_ceil(CELL) * self.columns
    }

    /// Adds a row of energies, valid in the columns `sure`, to a row of cells; `row` counts from where the cells begin.
    pub(crate) fn add(&self, cells: &mut [f32], row: usize, energy: &[f32], sure: std::ops::Range<usize>) {
        let line = &mut cells[row / CELL * self.columns..][..self.columns];
        let share = 1.0 / (CELL * CELL) as f32;
        let start = sure.start.next_multiple_of(CELL).min(sure.end);
        for x in sure.start..start {
            line[x / CELL] += energy[x] * share;
        }
        let whole = energy[start..sure.end].chunks_exact(CELL);
        for (x, &rest) in whole.remainder().iter().enumerate() {
            line[(sure.end - whole.remainder().len() + x) / CELL] += rest * share;
        }
        for (cell, energies) in line[start / CELL..].iter_mut().zip(whole) {
            *cell += energies.iter().sum::<f32>() * share;
        }
    }

    /// Enters the cells of `slice`, which are complete.
    pub(crate) fn enter(&self, slice: usize, cells: Vec<f32>) {
        locked(&self.samples)[slice] = cells.iter().step_by(self.stride).copied().collect();
        for level in &self.levels {
            let kernel = locked(level).kernel.clone();
            let wide = smoothed(&cells, self.columns, self.rows, &kernel);
            let mut held = locked(level);
            let Level { best, slice: winners, .. } = &mut *held;
            for ((best, winner), &energy) in best.iter_mut().zip(winners).zip(&wide) {
                if energy > *best || (energy == *best && (slice as u16) < *winner) {
                    *best = energy;
                    *winner = slice as u16;
                }
            }
        }
    }

    /// `reference` is the slice of surroundings without any detail.
    pub(super) fn finish(self, reference: usize) -> Surveyed {
        let noise = noise(&unlocked(self.samples));
        let (width, height) = (self.columns, self.rows);
        let mut plain = Plane::filled(width, height, true);
        let mut wide = Vec::new();
        for level in self.levels {
            let Level { best, mut slice, .. } = unlocked(level);
            for ((slice, energy), plain) in slice.iter_mut().zip(&best).zip(&mut plain.data) {
                let detail = *energy >= PLAIN * noise;
                *plain &= !detail;
                if !detail && *slice != UNCOVERED {
                    *slice = reference as u16;
                }
            }
            let energy = Plane { width, height, data: best };
            wide.push(Wide { slice: Plane { width, height, data: slice }, energy });
        }
        Surveyed { wide, plain, noise }
    }
}

/// At most places most slices are out of focus and show noise alone: the median over places of the lower quartile
/// over slices.
fn noise(samples: &[Vec<f32>]) -> f32 {
    let places = samples.iter().map(Vec::len).min().unwrap_or(0);
    let mut quartiles: Vec<f32> = (0..places)
        .filter_map(|place| {
            let mut energies: Vec<f32> =
                samples.iter().map(|slice| slice[place]).filter(|&energy| energy > 0.0).collect();
            energies.sort_by(f32::total_cmp);
            energies.get(energies.len() / 4).copied()
        })
        .collect();
    quartiles.sort_by(f32::total_cmp);
    quartiles.get(quartiles.len() / 2).copied().unwrap_or(0.0)
}

/// Convolved along both axes with the symmetric kernel of which `half` is given, borders repeated.
fn smoothed(cells: &[f32], columns: usize, rows: usize, half: &[f32]) -> Vec<f32> {
    let radius = half.len() - 1;
    let mut across = vec![0.0f32; cells.len()];
    let mut padded = vec![0.0f32; columns + 2 * radius];
    for (row, out) in cells.chunks_exact(columns).zip(across.chunks_exact_mut(columns)) {
        padded[radius..radius + columns].copy_from_slice(row);
        padded[..radius].fill(row[0]);
        padded[radius + columns..].fill(row[columns - 1]);
        add(out, &padded[radius..], &padded[radius..], 0.5 * half[0]);
        for (d, &weight) in half.iter().enumerate().skip(1) {
            add(out, &padded[radius - d..], &padded[radius + d..], weight);
        }
    }
    let mut out = vec![0.0f32; cells.len()];
    let row = |y: usize| &across[y * columns..(y + 1) * columns];
    for (y, out) in out.chunks_exact_mut(columns).enumerate() {
        add(out, row(y), row(y), 0.5 * half[0]);
        for (d, &weight) in half.iter().enumerate().skip(1) {
            add(out, row(y.saturating_sub(d)), row((y + d).min(rows - 1)), weight);
        }
    }
    out
}

fn add(out: &mut [f32], one: &[f32], other: &[f32], weight: f32) {
    for ((out, one), other) in out.iter_mut().zip(one).zip(other) {
        *out += weight * (one + other);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A survey of 24 x 16 px in which slice `s` has `energy(s, x)` in every row.
    fn survey(order: &[usize], energy: impl Fn(usize, usize) -> f32) -> Surveyed {
        let survey = Survey::new(24, 16, order.len());
        for &slice in order {
            let mut sheet = survey.sheet();
            let row: Vec<f32> = (0..24).map(|x| energy(slice, x)).collect();
            (0..16).for_each(|y| survey.add(&mut sheet, y, &row, 0..24));
            survey.enter(slice, sheet);
        }
        survey.finish(0)
    }

    #[test]
    fn the_sharpest_surroundings_win_whatever_the_order() {
        let energy = |slice: usize, x: usize| if (slice == 0) == (x < 12) { 9.0 } else { 1.0 };
        for order in [[0, 1], [1, 0]] {
            let surveyed = survey(&order, energy);
            assert_eq!(surveyed.wide[0].slice.row(1), [0, 0, 0, 1, 1, 1]);
        }
    }

    #[test]
    fn noise_is_what_most_slices_show() {
        let surveyed = survey(&[0, 1, 2, 3], |slice, _| if slice == 2 { 50.0 } else { 2.0 });
        assert!((surveyed.noise - 2.0).abs() < 1e-5);
    }

    #[test]
    fn uncovered_columns_count_for_nothing() {
        let survey = Survey::new(10, 4, 1);
        let mut sheet = survey.sheet();
        (0..4).for_each(|y| survey.add(&mut sheet, y, &[1.0; 10], 3..9));
        assert_eq!(sheet, [0.25, 1.0, 0.25]);
    }
}
