//! Deterministic sums of many floats: the same result on every machine.
//!
//! Floating-point addition is not associative, so the order is fixed: eight partial sums, with element `i` in sum
//! `i mod 8`, which the compiler turns into vector additions; the remainder is added at the end.

/// The sum of `values`.
pub(super) fn sum(values: &[f32]) -> f64 {
    let mut lanes = [0.0f32; 8];
    let chunks = values.chunks_exact(8);
    let rest: f32 = chunks.remainder().iter().sum();
    for chunk in chunks {
        lanes.iter_mut().zip(chunk).for_each(|(lane, value)| *lane += value);
    }
    total(lanes) + f64::from(rest)
}

/// The sum of `values[i] * weights[i]`; `weights` must be at least as long as `values`.
pub(super) fn dot(values: &[f32], weights: &[f32]) -> f64 {
    let mut lanes = [0.0f32; 8];
    let weights = &weights[..values.len()];
    let (chunks, others) = (values.chunks_exact(8), weights.chunks_exact(8));
    let rest: f32 = chunks.remainder().iter().zip(others.remainder()).map(|(v, w)| v * w).sum();
    for (chunk, other) in chunks.zip(others) {
        for ((lane, value), weight) in lanes.iter_mut().zip(chunk).zip(other) {
            *lane += value * weight;
        }
    }
    total(lanes) + f64::from(rest)
}

fn total(lanes: [f32; 8]) -> f64 {
    lanes.iter().map(|&lane| f64::from(lane)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_counts_once_for_any_length() {
        for length in 0..40 {
            let values: Vec<f32> = (0..length).map(|i| i as f32).collect();
            let expected = (length * length.max(1) - length) as f64 / 2.0;
            assert_eq!(sum(&values), expected);
            assert_eq!(dot(&values, &vec![2.0; length]), 2.0 * expected);
        }
    }
}
