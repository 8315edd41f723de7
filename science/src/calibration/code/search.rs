//! Correlation of the readings with the code, over all shifts and symmetries, by the fast Fourier transform.

use std::sync::{Arc, LazyLock};

use rayon::prelude::*;
use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlanner};

use super::place::{CodePlace, Symmetry, agreement};
use crate::calibration::lattice::Label;
use crate::target::{CODE_PERIOD, dot_size};

/// Columns and rows of the code.
const SIDE: usize = CODE_PERIOD as usize;

/// The transforms, and the conjugate spectrum of the code.
struct Correlator {
    forward: Arc<dyn Fft<f32>>,
    backward: Arc<dyn Fft<f32>>,
    code: Vec<Complex32>,
}

static CORRELATOR: LazyLock<Correlator> = LazyLock::new(|| {
    let mut planner = FftPlanner::new();
    let (forward, backward) = (planner.plan_fft_forward(SIDE), planner.plan_fft_inverse(SIDE));
    let sign = |k: usize| dot_size((k % SIDE) as i64, (k / SIDE) as i64).sign() as f32;
    let mut code: Vec<Complex32> = (0..SIDE * SIDE).map(|k| Complex32::new(sign(k), 0.0)).collect();
    transform(&mut code, forward.as_ref());
    code.iter_mut().for_each(|v| *v = v.conj());
    Correlator { forward, backward, code }
});

/// Two-dimensional transform; the result is transposed.
fn transform(data: &mut [Complex32], along: &dyn Fft<f32>) {
    along.process(data);
    for y in 0..SIDE {
        for x in 0..y {
            data.swap(y * SIDE + x, x * SIDE + y);
        }
    }
    along.process(data);
}

/// The place in the code with the largest agreement, and the agreement.
pub(super) fn best(readings: &[(Label, f64)]) -> Option<(CodePlace, f64)> {
    let symmetries = Symmetry::all();
    // two symmetries per transform, as its real and its imaginary part
    let pairs: Vec<(Symmetry, Symmetry)> = (0..4).map(|k| (symmetries[k], symmetries[k + 4])).collect();
    let found: Vec<CodePlace> = pairs.par_iter().flat_map_iter(|pair| of_pair(readings, *pair)).collect();
    found
        .into_iter()
        .map(|place| (place, agreement(readings, &place)))
        .reduce(|best, next| if next.1 > best.1 { next } else { best })
}

/// For each of two symmetries the best place.
fn of_pair(readings: &[(Label, f64)], (first, second): (Symmetry, Symmetry)) -> [CodePlace; 2] {
    let correlator = &*CORRELATOR;
    let mut data = vec![Complex32::default(); SIDE * SIDE];
    let index = |[x, y]: Label| y.rem_euclid(SIDE as i32) as usize * SIDE + x.rem_euclid(SIDE as i32) as usize;
    for (label, reading) in readings {
        data[index(first.apply(*label))].re += *reading as f32;
        data[index(second.apply(*label))].im += *reading as f32;
    }
    transform(&mut data, correlator.forward.as_ref());
    data.iter_mut().zip(&correlator.code).for_each(|(value, code)| *value *= *code);
    // transposed twice: rows are rows again
    transform(&mut data, correlator.backward.as_ref());
    let top = |part: &dyn Fn(&Complex32) -> f32| {
        let largest =
            |(best, value): (usize, f32), (k, v): (usize, f32)| if v > value { (k, v) } else { (best, value) };
        data.iter().map(part).enumerate().fold((0, f32::MIN), largest).0
    };
    let place = |symmetry: Symmetry, k: usize| {
        // value k is the correlation with the code moved by (k % SIDE, k / SIDE): the labels move the other way
        let back = |v: usize| (SIDE - v) as i32 % SIDE as i32;
        CodePlace { symmetry, shift: [back(k % SIDE), back(k / SIDE)] }
    };
    [place(first, top(&|v| v.re)), place(second, top(&|v| v.im))]
}
