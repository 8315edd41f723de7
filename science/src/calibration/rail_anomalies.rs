//! Anomalies of the rail: missing, doubled, reversed and uneven steps, and sideways jumps of the image.

use super::statistics::median;

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
    /// The image jumped sideways and stayed there: the rig was bumped.
    Bumped {
        /// The first slice after the jump.
        from: usize,
        /// Size of the jump, px.
        by: [f64; 2],
    },
    /// A single slice lies beside the line of the others.
    Displaced {
        /// The slice.
        slice: usize,
        /// Its distance from the line, px.
        by: [f64; 2],
    },
    /// The files are not in the order of the rail positions.
    OutOfOrder {
        /// The measured slices in the order of the rail positions.
        order: Vec<usize>,
    },
}

/// Least deviation from an ordinary step that is reported, in steps.
const UNEVEN: f64 = 0.25;

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
    let usual = median(&mut lengths.iter().map(|l| l.1).collect::<Vec<_>>());
    // a rail whose steps vary all the time has a larger limit
    let wobble = 1.4826 * median(&mut lengths.iter().map(|l| (l.1 / usual - 1.0).abs()).collect::<Vec<_>>());
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

/// Finds a lasting sideways jump: a line with a step explains the shifts much better than a line. `shifts` per slice in
/// px, `None` where nothing was measured; jumps up to `least` px are not reported.
pub(super) fn find_bump(shifts: &[Option<[f64; 2]>], positions: &[f64], least: f64) -> Option<RailAnomaly> {
    let known: Vec<(usize, f64, [f64; 2])> =
        shifts.iter().enumerate().filter_map(|(i, s)| s.map(|s| (i, positions[i], s))).collect();
    if known.len() < 7 {
        return None;
    }
    let all: Vec<(f64, f64, [f64; 2])> = known.iter().map(|k| (k.1, 0.0, k.2)).collect();
    let before = with_step(&all, false)?;
    let mut best: Option<(f64, usize, [f64; 2])> = None;
    for cut in 2..known.len() - 1 {
        let points: Vec<(f64, f64, [f64; 2])> =
            known.iter().enumerate().map(|(k, p)| (p.1, f64::from(u8::from(k >= cut)), p.2)).collect();
        let Some((left, step)) = with_step(&points, true) else { continue };
        if best.is_none_or(|b| left < b.0) {
            best = Some((left, known[cut].0, step));
        }
    }
    let (left, from, by) = best?;
    let scatter = (left / (2.0 * known.len() as f64 - 6.0)).sqrt();
    let size = by[0].hypot(by[1]);
    (left < 0.15 * before.0 && size > least.max(6.0 * scatter)).then_some(RailAnomaly::Bumped { from, by })
}

/// Residual sum of squares of a line (with a free step if `step`) through both coordinates, and the step.
fn with_step(points: &[(f64, f64, [f64; 2])], step: bool) -> Option<(f64, [f64; 2])> {
    use nalgebra::{DMatrix, DVector};
    let unknowns = 2 + usize::from(step);
    let rows = DMatrix::from_fn(points.len(), unknowns, |k, c| [1.0, points[k].0, points[k].1][c]);
    let inverse = (rows.transpose() * &rows).try_inverse()?;
    let (mut left, mut by) = (0.0, [0.0; 2]);
    for (a, by) in by.iter_mut().enumerate() {
        let values = DVector::from_iterator(points.len(), points.iter().map(|p| p.2[a]));
        let solved = &inverse * rows.transpose() * &values;
        left += (&values - &rows * &solved).norm_squared();
        *by = if step { solved[2] } else { 0.0 };
    }
    Some((left, by))
}

#[cfg(test)]
mod tests {
    use super::super::testkit::Noise;
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

    #[test]
    fn a_bump_is_distinguished_from_drift() {
        let mut noise = Noise(3);
        let positions: Vec<f64> = (0..13).map(f64::from).collect();
        let mut shifts: Vec<Option<[f64; 2]>> = positions
            .iter()
            .map(|z| Some([0.6 * z + 0.05 * noise.normal(), -0.3 * z + 0.05 * noise.normal()]))
            .collect();
        assert_eq!(find_bump(&shifts, &positions, 0.5), None);
        for shift in shifts.iter_mut().skip(8).flatten() {
            shift[0] += 3.0;
            shift[1] -= 1.0;
        }
        shifts[3] = None;
        let Some(RailAnomaly::Bumped { from, by }) = find_bump(&shifts, &positions, 0.5) else { panic!("not found") };
        assert_eq!(from, 8);
        assert!((by[0] - 3.0).abs() < 0.3 && (by[1] + 1.0).abs() < 0.3, "{by:?}");
    }
}
