//! Fractions of a blur disc that lie on a dot, a half plane or a rectangle, and the contrast that blur leaves of a wave.

use std::f64::consts::PI;

/// Second moment of a pixel, as that of a disc: its radius squared.
pub(super) const PIXEL_MOMENT: f64 = 1.0 / 3.0;

/// Area shared by two circles of radii `a` and `b` whose centres are `distance` apart.
pub(super) fn overlap(a: f64, b: f64, distance: f64) -> f64 {
    if distance >= a + b {
        return 0.0;
    }
    if distance <= (a - b).abs() {
        return PI * a.min(b).powi(2);
    }
    let angle = |own: f64, other: f64| {
        ((distance * distance + own * own - other * other) / (2.0 * distance * own)).clamp(-1.0, 1.0).acos()
    };
    let (alpha, beta) = (angle(a, b), angle(b, a));
    let segment = |radius: f64, half: f64| radius * radius * (half - half.sin() * half.cos());
    segment(a, alpha) + segment(b, beta)
}

/// Distance of the centre of gravity of the area shared by two circles from the centre of the one of radius `b`,
/// towards the other, whose radius is `a` and whose centre is `distance` away; 0 when they share nothing.
pub(super) fn overlap_middle(a: f64, b: f64, distance: f64) -> f64 {
    if distance >= a + b {
        return 0.0;
    }
    if distance <= (a - b).abs() {
        return if a < b { distance } else { 0.0 };
    }
    // the chord's distance from the centre of b; on each side of it lies a segment of the other circle
    let chord = (distance * distance + b * b - a * a) / (2.0 * distance);
    let half = (b * b - chord * chord).max(0.0).sqrt();
    let cap =
        |radius: f64, to_chord: f64| radius * radius * (to_chord / radius).clamp(-1.0, 1.0).acos() - to_chord * half;
    // each segment has the first moment 2/3 half^3 about the centre of its circle, away from the other's: they cancel
    let of_a = cap(a, distance - chord);
    distance * of_a / (cap(b, chord) + of_a)
}

/// Share of a disc of radius `blur` that lies on the positive side of a straight border `inside` away from
/// its centre.
pub(super) fn half_plane(inside: f64, blur: f64) -> f64 {
    let t = (inside / blur).clamp(-1.0, 1.0);
    0.5 + (t.asin() + t * (1.0 - t * t).sqrt()) / PI
}

/// Share of a disc of radius `blur` that lies on a rectangle with the half sides `half`; `at` is the disc's centre from its
/// middle; exact beside the sides, close at the corners.
pub(super) fn rectangle(half: [f64; 2], at: [f64; 2], blur: f64) -> f64 {
    let strip = |half: f64, at: f64| (half_plane(half - at, blur) + half_plane(half + at, blur) - 1.0).max(0.0);
    strip(half[0], at[0]) * strip(half[1], at[1])
}

/// What blur by a disc of radius `blur` leaves of a wave of length `period`: 2 J1(x) / x at
/// x = 2 pi blur / period; nothing where that is below 0.01 for good.
pub(super) fn wave_left(blur: f64, period: f64) -> f64 {
    const POINTS: u32 = 64;
    let x = 2.0 * PI * blur / period;
    if x > 45.0 {
        return 0.0;
    }
    // the disc's chords as weights, by Gauss-Chebyshev quadrature of the second kind
    let node = |k: u32| f64::from(k) * PI / f64::from(POINTS + 1);
    let sum: f64 = (1..=POINTS).map(|k| node(k).sin().powi(2) * (x * node(k).cos()).cos()).sum();
    2.0 * sum / f64::from(POINTS + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blurred_dot_keeps_its_amount_of_darkness() {
        let area = |b: f64| {
            let step = 0.01;
            let grid = -300..300;
            let at = |k: i32| f64::from(k) * step;
            let shares = grid.clone().flat_map(|i| grid.clone().map(move |j| overlap(0.5, b, at(i).hypot(at(j)))));
            shares.sum::<f64>() * step * step / (PI * b * b)
        };
        for blur in [0.2, 0.5, 1.3] {
            assert!((area(blur) - PI * 0.25).abs() < 1e-3, "blur {blur}");
        }
    }

    #[test]
    fn a_straight_border_is_the_border_of_a_very_large_dot() {
        for inside in [-1.2, -0.4, 0.0, 0.3, 0.9, 2.0] {
            let large = overlap(1e4, 0.8, 1e4 - inside) / (PI * 0.64);
            assert!((half_plane(inside, 0.8) - large).abs() < 1e-3, "{inside}");
        }
        assert!((rectangle([1.0, 1.0], [1.0, 0.0], 0.1) - 0.5).abs() < 1e-9);
    }

    #[test]
    fn a_wave_passes_zero_where_the_first_zero_of_the_bessel_function_lies() {
        assert!((wave_left(0.0, 1.0) - 1.0).abs() < 1e-9);
        let zero = 3.831_705_970_207_512 / (2.0 * PI);
        assert!(wave_left(zero, 1.0).abs() < 1e-9);
        assert!(wave_left(zero * 1.2, 1.0) < -0.05);
    }
}
