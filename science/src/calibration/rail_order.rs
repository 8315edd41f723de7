//! The order of the slices on the rail, by their scales, and slices that lie beside the line of the others.

use nalgebra::{Matrix2, Vector2};

use super::rail_anomalies::RailAnomaly;
use super::statistics::median;

/// Fewest measured slices that have an order.
const MIN_SLICES: usize = 4;
/// Standard deviations by which two scales must differ to have an order.
const SIGMAS: f64 = 6.0;
/// Share of the median step by which they must differ.
const SHARE: f64 = 0.25;

/// The order on the rail of the measured slices, when it is not the order of the files (nor its reverse). `scales`: the
/// scale parameter of each slice with its standard deviation. `None` when the files are in order, or when the scale
/// hardly changes.
pub(super) fn true_order(scales: &[Option<(f64, f64)>]) -> Option<Vec<usize>> {
    let known: Vec<(usize, f64, f64)> =
        scales.iter().enumerate().filter_map(|(i, s)| s.map(|(scale, sigma)| (i, scale, sigma))).collect();
    if known.len() < MIN_SLICES {
        return None;
    }
    let steps: Vec<(f64, f64)> = known.windows(2).map(|w| (w[1].1 - w[0].1, w[0].2.hypot(w[1].2))).collect();
    let usual = median(&mut steps.iter().map(|s| s.0.abs()).collect::<Vec<_>>());
    let clear = |s: &&(f64, f64)| s.0.abs() > SHARE * usual && s.0.abs() > SIGMAS * s.1;
    let rising = steps.iter().filter(clear).filter(|s| s.0 > 0.0).count();
    let falling = steps.iter().filter(clear).filter(|s| s.0 < 0.0).count();
    if rising.min(falling) == 0 {
        return None;
    }
    let mut order: Vec<usize> = (0..known.len()).collect();
    order.sort_by(|a, b| known[*a].1.total_cmp(&known[*b].1));
    let order: Vec<usize> = order.into_iter().map(|k| known[k].0).collect();
    // in the direction of most steps
    Some(if falling > rising { order.into_iter().rev().collect() } else { order })
}

/// The rank of each slice in `order`; a slice that is not in it comes after its predecessor.
pub(super) fn ranks(order: &[usize], count: usize) -> Vec<f64> {
    let mut out = vec![f64::NAN; count];
    order.iter().enumerate().for_each(|(rank, &i)| out[i] = rank as f64);
    let mut last = 0.0;
    for rank in &mut out {
        if rank.is_nan() {
            *rank = last + 0.5;
        }
        last = *rank;
    }
    out
}

/// Fewest slices of a line.
const MIN_LINE: usize = 5;
/// Least distance from the line of the others, px.
const LEAST: f64 = 1.0;
/// Standard deviations of the others that a displaced slice must be away from their line.
const AWAY: f64 = 8.0;

/// Finds single slices that are displaced sideways against the line of the others. `shifts` per slice in px, `None`
/// where nothing was measured. `jump`: the first slice after a lasting jump of `by` px.
pub(super) fn find_displaced(
    shifts: &[Option<[f64; 2]>],
    positions: &[f64],
    jump: Option<(usize, [f64; 2])>,
) -> Vec<RailAnomaly> {
    let before = |i: usize, s: [f64; 2]| match jump {
        Some((from, by)) if i >= from => [s[0] - by[0], s[1] - by[1]],
        _ => s,
    };
    let mut line: Vec<(usize, f64, [f64; 2])> =
        shifts.iter().enumerate().filter_map(|(i, s)| s.map(|s| (i, positions[i], before(i, s)))).collect();
    let most = line.len() / 4;
    let mut out = Vec::new();
    while out.len() < most && line.len() > MIN_LINE {
        let off = |k: usize| {
            let others: Vec<(f64, [f64; 2])> =
                line.iter().enumerate().filter(|(n, _)| *n != k).map(|(_, p)| (p.1, p.2)).collect();
            let (at, sigma) = predict(&others, line[k].1)?;
            let by = [line[k].2[0] - at[0], line[k].2[1] - at[1]];
            let size = by[0].hypot(by[1]);
            (size > LEAST.max(AWAY * sigma)).then_some((size / sigma.max(1e-6), k, by))
        };
        let farthest = (0..line.len()).filter_map(off).max_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, k, by)) = farthest else { break };
        out.push(RailAnomaly::Displaced { slice: line[k].0, by });
        line.remove(k);
    }
    out.sort_by_key(|a| if let RailAnomaly::Displaced { slice, .. } = a { *slice } else { usize::MAX });
    out
}

/// Shift at a position by the line through `points`, and the standard deviation of a slice there (per coordinate).
fn predict(points: &[(f64, [f64; 2])], at: f64) -> Option<([f64; 2], f64)> {
    let count = points.len() as f64;
    let middle = points.iter().map(|p| p.0).sum::<f64>() / count;
    let row = |z: f64| Vector2::new(1.0, z - middle);
    let normal: Matrix2<f64> = points.iter().map(|p| row(p.0) * row(p.0).transpose()).sum();
    let inverse = normal.try_inverse()?;
    let numbers = [0, 1].map(|a| inverse * points.iter().map(|p| row(p.0) * p.1[a]).sum::<Vector2<f64>>());
    let left: f64 =
        points.iter().map(|p| (0..2).map(|a| (p.1[a] - numbers[a].dot(&row(p.0))).powi(2)).sum::<f64>()).sum();
    let freedom = 2.0 * count - 4.0;
    let leverage = (row(at).transpose() * inverse * row(at))[(0, 0)];
    // few slices determine their scatter poorly
    let sigma = (left / freedom * (1.0 + leverage)).sqrt() * (1.0 + 2.5 / freedom);
    Some((numbers.map(|n| n.dot(&row(at))), sigma))
}

#[cfg(test)]
mod tests {
    use super::super::testkit::Noise;
    use super::*;

    #[test]
    fn the_order_follows_from_the_scales() {
        let scales = |order: &[usize]| -> Vec<Option<(f64, f64)>> {
            order.iter().map(|&k| Some((0.01 * k as f64, 1e-5))).collect()
        };
        assert_eq!(true_order(&scales(&[0, 1, 2, 3, 4])), None);
        assert_eq!(true_order(&scales(&[4, 3, 2, 1, 0])), None);
        assert_eq!(true_order(&scales(&[2, 3, 4, 0, 1])), Some(vec![3, 4, 0, 1, 2]), "the counter rolled over");
        assert_eq!(true_order(&scales(&[2, 1, 3, 0, 4])), Some(vec![3, 1, 0, 2, 4]), "from the middle outward");
        let mut doubled = scales(&[0, 1, 1, 2, 3]);
        assert_eq!(true_order(&doubled), None);
        doubled[3] = None;
        assert_eq!(true_order(&doubled), None);
        assert_eq!(ranks(&[3, 1, 0, 4], 5), [2.0, 1.0, 1.5, 0.0, 3.0]);
    }

    #[test]
    fn a_slice_beside_the_line_is_found_and_scatter_is_not() {
        let mut noise = Noise(4);
        let positions: Vec<f64> = (0..9).map(f64::from).collect();
        let mut shifts: Vec<Option<[f64; 2]>> =
            positions.iter().map(|z| Some([0.7 * z + 0.3 * noise.normal(), 0.3 * noise.normal()])).collect();
        assert!(find_displaced(&shifts, &positions, None).is_empty());
        for displaced in [8, 3] {
            let before = shifts.clone();
            shifts[displaced] = shifts[displaced].map(|s| [s[0] + 9.0, s[1] - 3.0]);
            let found = find_displaced(&shifts, &positions, None);
            let [RailAnomaly::Displaced { slice, by }] = found[..] else { panic!("{found:?}") };
            assert!(slice == displaced && (by[0] - 9.0).abs() < 2.5, "{found:?}");
            shifts = before;
        }
    }
}
