//! How sharp a slice of the target is, compared with the others of the same stack.

use super::working::{Working, quantile};
use crate::imaging::Plane;

/// Long side of the picture that is judged.
const SIDE: usize = 1600;

/// Mean squared slope over the squared white level: grows with sharpness, does not depend on exposure.
/// 0 for a picture without light.
pub fn of(luma: &Plane<f32>) -> f64 {
    let working = Working::new(luma, luma.width.max(luma.height).div_ceil(SIDE).max(1));
    let plane = &working.plane;
    if plane.width < 3 || plane.height < 3 {
        return 0.0;
    }
    let stride = (plane.data.len() / 50_000).max(1) | 1;
    let mut levels: Vec<f64> = plane.data.iter().step_by(stride).map(|&v| f64::from(v)).collect();
    let white = quantile(&mut levels, 0.99);
    if white < 4.0 {
        return 0.0;
    }
    let mut sum = 0.0_f64;
    for y in 1..plane.height - 1 {
        let (above, row, below) = (plane.row(y - 1), plane.row(y), plane.row(y + 1));
        for x in 1..plane.width - 1 {
            let (dx, dy) = (row[x + 1] - row[x - 1], below[x] - above[x]);
            sum += f64::from(dx * dx + dy * dy);
        }
    }
    sum / ((plane.width - 2) * (plane.height - 2)) as f64 / (white * white)
}

/// Up to `count` indices of `of` slices, evenly spread, the middle one among them.
pub fn spread(of: usize, count: usize) -> Vec<usize> {
    if of <= count {
        return (0..of).collect();
    }
    (0..count).map(|k| (2 * k + 1) * of / (2 * count)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edge_is_sharper_than_a_ramp_whatever_the_exposure() {
        let picture = |width: f32, light: f32| {
            Plane::from_fn(100, 60, move |x, _| light * ((x as f32 - 50.0) / width).clamp(0.1, 1.0))
        };
        assert!(of(&picture(2.0, 100.0)) > 2.0 * of(&picture(12.0, 200.0)));
        let ratio = of(&picture(4.0, 100.0)) / of(&picture(4.0, 200.0));
        assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
        assert_eq!(of(&Plane::filled(50, 50, 0.0)), 0.0);
    }

    #[test]
    fn slices_to_judge_are_spread_and_within_the_stack() {
        assert_eq!(spread(4, 9), [0, 1, 2, 3]);
        let nine = spread(61, 9);
        assert_eq!(nine.len(), 9);
        assert!(nine.contains(&30) && nine.iter().all(|k| *k < 61));
    }
}
