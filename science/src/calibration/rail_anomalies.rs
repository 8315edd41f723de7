//! Anomalies of the rail: missing, doubled, reversed and uneven steps, and sideways jumps of the image.

use super::statistics::{mad_sigma, median_of};

/// A motion of the image that is not along the rail.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Jump {
    /// Sideways, px.
    pub(super) shift: [f64; 2],
    /// Turn about the middle of the image, degrees.
    pub(super) turn: f64,
}

/// An anomaly between or at slices (0-based).
#[derive(Debug, Clone, PartialEq)]
pub(super) enum RailAnomaly {
    /// The step is about two ordinary steps: a slice is missing.
    Missing {
        /// The slice before the step.
        after: usize,
    },
    /// Two slices were taken at one position.
    Doubled {
        /// The first of the two.
        first: usize,
    },
    /// The step goes backwards.
    Backwards {
        /// The slice before the step.
        after: usize,
    },
    /// The step has another length.
    Uneven {
        /// The slice before the step.
        after: usize,
        /// Its length in ordinary steps.
        steps: f64,
    },
    /// The image jumped sideways or turned, and stayed there: the rig was bumped, or the target moved.
    Bumped {
        /// The last measured slice before the jump.
        after: usize,
        /// The first slice after the jump.
        from: usize,
        /// How far it jumped.
        by: Jump,
    },
    /// A single slice lies beside the line of the others.
    Displaced {
        /// The slice.
        slice: usize,
        /// Its distance from the line.
        by: Jump,
    },
    /// The dots of a single slice contradict the transform model of the others: it is tilted, turned or stretched
    /// alone.
    Different {
        /// The slice.
        slice: usize,
    },
    /// The files are not in the order of the rail positions.
    OutOfOrder {
        /// The measured slices in the order of the rail positions.
        order: Vec<usize>,
    },
}

/// Least deviation from an ordinary step that is reported, in steps.
const UNEVEN: f64 = 0.25;

/// A step counts as one from this many standard deviations, and from this share of the largest step.
const CLEAR: f64 = 6.0;
const LEAST_STEP: f64 = 0.1;

/// Classifies the steps between neighbouring measured slices. `by_scale` are positions derived from the scales, with
/// their standard deviations; `expected` are the specified or assumed positions.
pub(super) fn step_anomalies(by_scale: &[Option<(f64, f64)>], expected: &[f64]) -> Vec<RailAnomaly> {
    let mut lengths = Vec::new();
    for k in 0..by_scale.len().saturating_sub(1) {
        if let (Some(a), Some(b)) = (by_scale[k], by_scale[k + 1]) {
            let step = expected[k + 1] - expected[k];
            lengths.push((k, (b.0 - a.0) / step, a.1.hypot(b.1) / step.abs()));
        }
    }
    if lengths.len() < 3 {
        return Vec::new();
    }
    // where the rail was stuck for most of the stack, the median of all steps is none
    let largest = lengths.iter().map(|l| l.1.abs()).fold(0.0, f64::max);
    let moved = || lengths.iter().filter(|l| l.1.abs() > (CLEAR * l.2).max(LEAST_STEP * largest)).map(|l| l.1);
    let usual = median_of(moved());
    // a rail whose steps vary all the time has a larger limit
    let wobble = mad_sigma(moved().map(|l| l / usual - 1.0));
    let mut anomalies = Vec::new();
    for (after, length, sigma) in lengths {
        let steps = length / usual;
        let limit = 5.0 * (sigma / usual.abs()).hypot(wobble);
        if !steps.is_finite() || (steps - 1.0).abs() < UNEVEN.max(limit) {
            continue;
        }
        anomalies.push(match steps {
            s if s < -UNEVEN => RailAnomaly::Backwards { after },
            s if s < UNEVEN => RailAnomaly::Doubled { first: after },
            s if (1.7..2.3).contains(&s) => RailAnomaly::Missing { after },
            steps => RailAnomaly::Uneven { after, steps },
        });
    }
    anomalies
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judged(positions: &[f64]) -> Vec<RailAnomaly> {
        let expected: Vec<f64> = (0..positions.len()).map(|i| i as f64).collect();
        step_anomalies(&positions.iter().map(|z| Some((*z, 0.01))).collect::<Vec<_>>(), &expected)
    }

    #[test]
    fn missing_doubled_reversed_and_uneven_steps_are_classified() {
        assert!(judged(&[0.0, 1.01, 2.0, 2.98, 4.0, 5.0]).is_empty());
        assert_eq!(judged(&[0.0, 1.0, 3.0, 4.0, 5.0, 6.0]), [RailAnomaly::Missing { after: 1 }]);
        assert_eq!(judged(&[0.0, 1.0, 2.0, 2.02, 3.0, 4.0]), [RailAnomaly::Doubled { first: 2 }]);
        assert_eq!(judged(&[0.0, 1.0, 2.0, 1.0, 2.0, 3.0, 4.0]), [RailAnomaly::Backwards { after: 2 }]);
        assert!(
            matches!(judged(&[0.0, 1.0, 2.0, 3.5, 4.5, 5.5])[..], [RailAnomaly::Uneven { after: 2, steps }] if (steps - 1.5).abs() < 0.1)
        );
    }
}
