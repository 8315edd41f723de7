//! Coarse statistics of a stack, on which the heights of all pixels depend: noise, and the width of focus curves.

use rayon::prelude::*;

use super::energy::energy;
use crate::{
    fusion::{align::Aligned, run::Run},
    imaging::{
        Rect, Sample,
        filter::focus::{FocusEnergy, Rows},
    },
    types::Interrupted,
};

/// Sampled squares per side of the canvas, and their side, px.
const SQUARES: usize = 12;
const SIDE: usize = 16;
/// Drop of the logarithm of the energy at which a focus curve ends.
const DROP: f32 = 1.8;
/// Bounds of the half-width of the window of slices.
const MIN_REACH: usize = 2;
const MAX_REACH: usize = 10;
/// Energy, in multiples of that of noise, from which a square has texture.
const TEXTURED: f32 = 8.0;

/// The measurements of a stack.
#[derive(Debug, Clone, Copy)]
pub(super) struct CoarseStatistics {
    /// Focus energy of noise, squared grey levels.
    pub noise: f32,
    /// Slices on either side of the sharpest one that a focus curve needs.
    pub reach: usize,
}

/// Samples squares in a grid over the canvas, in all slices.
///
/// - Noise: the median over squares of the lower quartile over slices of the mean energy. In most squares most slices
///   are out of focus and show noise only.
/// - Reach: the median over textured squares of the distance at which the energy has dropped by [`DROP`].
pub(super) fn measure<S: Sample, const C: usize>(
    run: &Run<'_>,
    aligned: &Aligned,
) -> Result<CoarseStatistics, Interrupted> {
    let (width, height) = (run.plan.width, run.plan.height);
    let focus = FocusEnergy::for_decision_map();
    let start = |i: usize, length: usize| ((2 * i + 1) * length / (2 * SQUARES)).saturating_sub(SIDE / 2);
    let squares: Vec<Rect> = (0..SQUARES * SQUARES)
        .map(|i| {
            let (x, y) = (start(i % SQUARES, width), start(i / SQUARES, height));
            Rect { x, y, width: SIDE.min(width - x), height: SIDE.min(height - y) }
        })
        .collect();
    let curve = |(rows, buffers): &mut (Rows, _), rect: Rect| -> Result<Vec<f32>, Interrupted> {
        let of = |slice: usize| -> Result<f32, Interrupted> {
            if !aligned.coverages[slice].contains(rect.grown(focus.reach(), width, height)) {
                return Ok(-1.0);
            }
            run.control.check()?;
            let mut sum = 0.0;
            energy::<S, C>(aligned, slice, rect, &focus, rows, buffers, |_, values| sum += values.iter().sum::<f32>())?;
            Ok(sum / (rect.width * rect.height) as f32)
        };
        (0..aligned.coverages.len()).map(of).collect()
    };
    let curves: Vec<Vec<f32>> =
        squares.into_par_iter().map_init(Default::default, curve).collect::<Result<_, Interrupted>>()?;
    let noise = noise(&curves);
    Ok(CoarseStatistics { noise, reach: reach(&curves, noise) })
}

fn noise(curves: &[Vec<f32>]) -> f32 {
    let quartile = |curve: &Vec<f32>| {
        let mut energies: Vec<f32> = curve.iter().copied().filter(|&energy| energy >= 0.0).collect();
        energies.sort_by(f32::total_cmp);
        energies.get(energies.len() / 4).copied()
    };
    median(curves.iter().filter_map(quartile).collect()).unwrap_or(0.0)
}

fn reach(curves: &[Vec<f32>], noise: f32) -> usize {
    let width = |curve: &Vec<f32>| {
        let (peak, top) = curve.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
        if top <= TEXTURED * noise || top <= 0.0 {
            return None;
        }
        let limit = noise + (top - noise) * (-DROP).exp();
        let below = |energy: f32| (0.0..limit).contains(&energy);
        let before = curve[..peak].iter().rev().position(|&energy| below(energy));
        let after = curve[peak + 1..].iter().position(|&energy| below(energy));
        before.into_iter().chain(after).min().map(|steps| steps as f32 + 1.0)
    };
    let median = median(curves.iter().filter_map(width).collect());
    median.map_or(MIN_REACH, |steps| (steps as usize + 1).clamp(MIN_REACH, MAX_REACH))
}

fn median(mut values: Vec<f32>) -> Option<f32> {
    values.sort_by(f32::total_cmp);
    values.get(values.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_is_as_wide_as_the_focus_curves() {
        let curves = |width: f32| -> Vec<Vec<f32>> {
            let curve = |at: usize| (0..40).map(move |i| 1.0 + 100.0 * (-(i as f32 - at as f32).powi(2) / width).exp());
            (10..30).map(|at| curve(at).collect()).collect()
        };
        let reach_of = |width: f32| reach(&curves(width), noise(&curves(width)));
        assert_eq!(reach_of(0.5), MIN_REACH);
        assert_eq!(reach_of(8.0), 5);
        assert_eq!(reach_of(1e6), MIN_REACH, "curves without an end do not tell");
        assert!((noise(&curves(4.0)) - 1.0).abs() < 0.01);
    }
}
