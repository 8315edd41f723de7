//! The height of each pixel on its own: the maximum of its focus curve.

use rayon::prelude::*;

use super::{
    coarse_statistics::CoarseStatistics,
    curve::{Window, maximum},
    energy::{Buffers, energy},
    estimates::Estimates,
};
use crate::{
    fusion::{align::Aligned, lock::Spare, plan::UNCOVERED, run::Run},
    imaging::{
        Coverage, Plane, Rect, Sample,
        filter::focus::{FocusEnergy, Rows},
    },
    types::Interrupted,
};

/// Largest side of a tile, px. A tile keeps the energies of the slices around the decided one: at most 21 floats per
/// pixel.
const TILE: usize = 128;

/// Least standard deviation of an estimate, steps: texture within the window of the measure shifts the maximum.
const LEAST_SIGMA: f64 = 0.05;

/// Fits the focus curve of every pixel around the slice of `aligned.index`.
pub(super) fn estimate<S: Sample, const C: usize>(
    run: &Run<'_>,
    aligned: &Aligned,
    positions: &[f64],
    statistics: &CoarseStatistics,
) -> Result<Estimates, Interrupted> {
    let (width, height) = (run.plan.width, run.plan.height);
    let side = run.tile.min(TILE);
    let measure = FocusEnergy::for_decision_map();
    let supported: Vec<Coverage> = aligned.coverages.iter().map(|c| c.eroded(measure.reach())).collect();
    let tiles = Tiles { aligned, positions, statistics, measure, supported };
    let mut position = Plane::filled(width, height, 0.0f32);
    let mut confidence = Plane::filled(width, height, 0.0f32);
    let bands =
        position.data.par_chunks_mut(width * side).zip(confidence.data.par_chunks_mut(width * side)).enumerate();
    let spare = Spare::new();
    bands.with_max_len(1).try_for_each(|(band, (position, confidence))| {
        spare.with(Default::default, |tools| {
            let y = band * side;
            for x in (0..width).step_by(side) {
                run.control.check()?;
                let rect = Rect { x, y, width: side.min(width - x), height: side.min(height - y) };
                tiles.tile::<S, C>(rect, tools, |row, column, found| {
                    let at = row * width + x + column;
                    (position[at], confidence[at]) = found;
                })?;
            }
            Ok::<_, Interrupted>(())
        })
    })?;
    Ok(Estimates { position, confidence })
}

struct Tiles<'a> {
    aligned: &'a Aligned,
    positions: &'a [f64],
    statistics: &'a CoarseStatistics,
    measure: FocusEnergy,
    /// Per slice: where it covers the window of the measure.
    supported: Vec<Coverage>,
}

impl Tiles<'_> {
    /// Calls `put(row, column, (position, confidence))` for the pixels of `rect` with a maximum.
    fn tile<S: Sample, const C: usize>(
        &self,
        rect: Rect,
        (rows, buffers, energies): &mut (Rows, Buffers<S>, Vec<f32>),
        mut put: impl FnMut(usize, usize, (f32, f32)),
    ) -> Result<(), Interrupted> {
        let (count, reach) = (self.positions.len(), self.statistics.reach);
        let length = 2 * reach + 1;
        let index = |row: usize| &self.aligned.index.row(rect.y + row)[rect.x..rect.x + rect.width];
        let mut wanted = vec![false; count];
        for row in 0..rect.height {
            for &slice in index(row).iter().filter(|&&slice| slice != UNCOVERED) {
                let slice = usize::from(slice);
                if slice < count && !wanted[slice] {
                    wanted[slice] = true;
                }
            }
        }
        let near = |slice: usize| wanted[slice.saturating_sub(reach)..(slice + reach + 1).min(count)].contains(&true);
        // per pixel: the energies of slices `index - reach` to `index + reach`
        energies.clear();
        energies.resize(rect.width * rect.height * length, -1.0);
        for slice in (0..count).filter(|&slice| near(slice)) {
            if self.supported[slice].misses(rect) {
                continue;
            }
            energy::<S, C>(self.aligned, slice, rect, &self.measure, rows, buffers, |row, values| {
                for column in self.supported[slice].span_in(rect.y + row, rect) {
                    let place = (slice + reach).wrapping_sub(usize::from(index(row)[column]));
                    if place < length {
                        energies[(row * rect.width + column) * length + place] = values[column];
                    }
                }
            })?;
        }
        let noise = f64::from(self.statistics.noise);
        for row in 0..rect.height {
            for (column, &slice) in index(row).iter().enumerate().filter(|(_, slice)| **slice != UNCOVERED) {
                let slice = usize::from(slice);
                let (first, end) = (slice.saturating_sub(reach), (slice + reach + 1).min(count));
                let curve = &energies[(row * rect.width + column) * length..][..length];
                let window = Window {
                    positions: &self.positions[first..end],
                    energies: &curve[first + reach - slice..end + reach - slice],
                    decided: slice - first,
                    search: (reach - 1).min(2),
                    at_ends: [first == 0, end == count],
                };
                if let Some(found) = maximum(&window, noise) {
                    put(
                        row,
                        column,
                        (found.position as f32, 1.0 / (found.sigma * found.sigma + LEAST_SIGMA * LEAST_SIGMA) as f32),
                    );
                }
            }
        }
        Ok(())
    }
}
