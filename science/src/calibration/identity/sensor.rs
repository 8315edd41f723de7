//! Tells whether the deviations of the cells move with the target or stay with the sensor.
//!
//! Dust on the sensor, reflections and uneven light stay at their pixels. They correlate between slices as dirt on the
//! target does, and would always vote for "nothing moved". The scale changes over the stack, so a cell of the target
//! moves over the sensor, the farther out the more. Two slices are therefore compared twice over the same cells: at the
//! same place of the target, and at the same place of the sensor.

use super::cells::{CELL, SIDE};
use super::fingerprint::{Fingerprint, OUTSIDE};

/// Least distance, grid steps, between the two places for a cell to count.
const APART: f64 = 0.12;
/// Fewest cells that must count.
const MIN_CELLS: f64 = 8.0;
/// Least lead of the correlation on the target, in standard deviations.
const CERTAIN: f64 = 3.0;
/// Least correlation on the target.
const LEAST: f64 = 0.03;
/// One of so many samples is compared.
const STRIDE: usize = 3;

/// Sums of one correlation.
#[derive(Default, Clone, Copy)]
struct Sums {
    both: f64,
    first: f64,
    second: f64,
}

impl Sums {
    fn add(&mut self, a: f64, b: f64) {
        self.both += a * b;
        self.first += a * a;
        self.second += b * b;
    }

    fn correlation(&self) -> f64 {
        self.both / (self.first.sqrt() * self.second.sqrt()).max(1e-12)
    }
}

/// Correlations of one pair of slices on the target and on the sensor, and the cells that count.
fn of_pair(a: &Fingerprint, b: &Fingerprint) -> Option<([f64; 2], f64)> {
    let to_b = b.to_slice.inverse()?;
    let (mut target, mut sensor, mut samples) = (Sums::default(), Sums::default(), 0.0);
    for (label, k) in a.cells() {
        let centre = label.map(f64::from);
        let there = to_b.apply(a.to_slice.apply(centre));
        let away = (there[0] - centre[0]).hypot(there[1] - centre[1]);
        if !(APART..2.5).contains(&away) {
            continue;
        }
        for n in (k % STRIDE..CELL).step_by(STRIDE) {
            if a.deviations(k)[n] == OUTSIDE {
                continue;
            }
            let inside = [n % SIDE, n / SIDE].map(|i| (i as f64 + 0.5) / SIDE as f64 - 0.5);
            let on_target = [centre[0] + inside[0], centre[1] + inside[1]];
            let on_sensor = to_b.apply(a.to_slice.apply(on_target));
            if let (Some(t), Some(s)) = (b.deviation_at(on_target), b.deviation_at(on_sensor)) {
                let here = f64::from(a.deviations(k)[n]);
                target.add(here, t);
                sensor.add(here, s);
                samples += 1.0;
            }
        }
    }
    let cells = samples * STRIDE as f64 / CELL as f64;
    (cells >= MIN_CELLS).then(|| ([target.correlation(), sensor.correlation()], cells))
}

/// True when the deviations of the slices move with the target.
pub(super) fn moves_with_target(fingerprints: &[&Fingerprint]) -> bool {
    let count = fingerprints.len();
    let (mut lead, mut total, mut sigma, mut pairs) = (0.0, 0.0, 0.0, 0.0);
    // each slice with the one half a stack further, and the ends: far apart, yet not all blurred
    let half = count.div_ceil(2).max(1);
    for i in 0..count {
        let j = i + half;
        let Some((a, b)) = fingerprints.get(i).zip(fingerprints.get(j)) else { continue };
        let Some(([target, sensor], cells)) = of_pair(a, b) else { continue };
        let weight = cells.sqrt();
        lead += weight * (target - sensor);
        total += weight * target;
        pairs += weight;
        // neighbouring slices share their noise, so the standard deviations of the pairs add up, not their variances;
        // that of a correlation is 1 over the root of the number of samples
        sigma += weight / (cells * CELL as f64).sqrt();
    }
    pairs > 0.0 && total / pairs > LEAST && lead > CERTAIN * sigma
}
