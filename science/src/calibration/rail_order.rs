//! The order of the slices on the rail, by their scales.

use super::statistics::median_of;

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
    let usual = median_of(steps.iter().map(|s| s.0.abs()));
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

/// The rank of each slice in `order`. Slices that are not in it come after the slice before them, evenly spread up to
/// the next rank; those before the first slice of `order` come before all others.
pub(super) fn ranks(order: &[usize], count: usize) -> Vec<f64> {
    let mut known = vec![None; count];
    order.iter().enumerate().for_each(|(rank, &i)| known[i] = Some(rank as f64));
    let mut out = Vec::with_capacity(count);
    let mut last = -1.0;
    for run in known.chunk_by(|a, b| a.is_some() == b.is_some()) {
        let parts = run.len() as f64 + 1.0;
        for (k, rank) in run.iter().enumerate() {
            out.push(rank.unwrap_or(last + (k as f64 + 1.0) / parts));
        }
        last = run[run.len() - 1].unwrap_or(last);
    }
    out
}

#[cfg(test)]
mod tests {
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
    fn unmeasured_slices_get_ranks_of_their_own() {
        let ranks = ranks(&[1, 0, 4, 5], 8);
        let mut sorted = ranks.clone();
        sorted.sort_by(f64::total_cmp);
        assert!(sorted.windows(2).all(|w| w[1] - w[0] > 0.2), "{ranks:?}");
        assert_eq!([ranks[0], ranks[1], ranks[4], ranks[5]], [1.0, 0.0, 2.0, 3.0]);
    }
}
