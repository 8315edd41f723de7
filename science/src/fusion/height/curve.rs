//! The focus curve of a pixel: where its maximum lies between the slices, and how certain that is.
//!
//! In: the focus energies of neighbouring slices. Out: position and standard deviation of the maximum. Blur by a disc
//! of radius `r` multiplies the energy of detail by a factor whose logarithm is quadratic in `r` near 0, and `r` is
//! proportional to the distance from the plane in focus (Nayar & Nakagawa, IEEE TPAMI 1994, fit the same Gaussian to
//! three values). With position `x`, energy `E`, and energy `N` of noise, a parabola is fitted to
//! `ln(E(x) - N)` by weighted least squares over all slices whose energy is not much below the largest.

/// Largest drop of the logarithm of the energy from the maximum that enters the fit. Farther out the curve is flatter
/// than a parabola.
const MAX_DROP: f64 = 2.2;
/// Independent values in the window of the focus energy.
const INDEPENDENT: f64 = 9.0;
/// Standard deviation of the model: of a logarithm at the maximum, and its growth with the drop from there.
const MODEL: (f64, f64) = (0.03, 0.12);
/// Least curvature of the logarithm of the energy per squared step; anything flatter has no maximum.
const MIN_CURVATURE: f64 = 1e-3;
/// How far beyond the first or the last slice a maximum may lie, steps.
const BEYOND_ENDS: f64 = 0.5;

/// Position of a maximum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Maximum {
    /// Position, in the unit of the positions of the slices.
    pub position: f64,
    /// Standard deviation of the same.
    pub sigma: f64,
}

/// The slices around the one that the index gives the pixel.
pub(super) struct Window<'a> {
    /// Position of each slice in steps, increasing.
    pub positions: &'a [f64],
    /// Focus energy of each; negative where the slice does not cover the pixel.
    pub energies: &'a [f32],
    /// Place in the window of the slice that the index gives the pixel.
    pub decided: usize,
    /// Largest distance from that slice, in slices, at which the maximum is looked for.
    pub search: usize,
    /// Whether the window begins with the first slice of the stack, and ends with the last.
    pub at_ends: [bool; 2],
}

/// The maximum of the focus curve; `noise` is the focus energy of noise. `None` if the curve has no maximum near that
/// slice, or none that stands out of the noise.
pub(super) fn maximum(window: &Window<'_>, noise: f64) -> Option<Maximum> {
    let (positions, energies) = (window.positions, window.energies);
    let last = energies.len().checked_sub(1)?;
    let nearby = window.decided.saturating_sub(window.search)..=(window.decided + window.search).min(last);
    let peak = nearby.fold(window.decided, |best, i| if energies[i] > energies[best] { i } else { best });
    let higher = |neighbour: Option<usize>| neighbour.is_some_and(|i| energies[i] > energies[peak]);
    if energies[peak] <= 0.0 || higher(peak.checked_sub(1)) || higher((peak < last).then_some(peak + 1)) {
        return None;
    }
    let least = 0.02 * noise.max(1e-6);
    let signal = |i: usize| (f64::from(energies[i]) - noise).max(least);
    let top = signal(peak);
    let drop = |i: usize| (top / signal(i)).ln().max(0.0);
    let usable = |i: usize| energies[i] >= 0.0 && drop(i) <= MAX_DROP;
    // both neighbours count whatever their drop, so that steep curves have three values
    let mut first = peak.saturating_sub(usize::from(peak > 0 && energies[peak - 1] >= 0.0));
    while first > 0 && usable(first - 1) && usable(first) {
        first -= 1;
    }
    let mut end = peak + usize::from(peak < last && energies[peak + 1] >= 0.0);
    while end < last && usable(end + 1) && usable(end) {
        end += 1;
    }
    // at an end of the stack, three values whatever their drop
    if end < first + 2 && end < last && energies[end + 1] >= 0.0 {
        end += 1;
    }
    if end < first + 2 && first > 0 && energies[first - 1] >= 0.0 {
        first -= 1;
    }
    if end < first + 2 {
        return None;
    }
    let mut sums = [0.0f64; 5];
    let mut values = [0.0f64; 3];
    for i in first..=end {
        let (x, y, s) = (positions[i] - positions[peak], -drop(i), signal(i));
        let of_noise = (2.0 * noise * noise + 4.0 * noise * s) / (INDEPENDENT * s * s);
        let weight = 1.0 / (of_noise + (MODEL.0 + MODEL.1 * drop(i)).powi(2));
        let mut power = weight;
        for k in 0..5 {
            sums[k] += power;
            if k < 3 {
                values[k] += power * y;
            }
            power *= x;
        }
    }
    let fit = Parabola::solve(sums, values)?;
    let position = fit.vertex()?;
    // between its neighbours, or a little beyond the ends of the stack
    let limit = |neighbour: Option<usize>, at_end: bool| match neighbour {
        Some(i) => (positions[i] - positions[peak]).abs(),
        None if at_end => BEYOND_ENDS,
        None => 0.0,
    };
    let below = limit(peak.checked_sub(1), window.at_ends[0]);
    let above = limit((peak < last).then_some(peak + 1), window.at_ends[1]);
    if !(-below..=above).contains(&position) {
        return None;
    }
    let one_sided = peak == first || peak == end;
    let sigma = fit.sigma(position).hypot(if one_sided { 0.25 } else { 0.0 });
    Some(Maximum { position: positions[peak] + position, sigma })
}

/// `a + b x + c x^2`, fitted by weighted least squares.
struct Parabola {
    b: f64,
    c: f64,
    /// Variances of `b` and `c`, and their covariance.
    covariance: [f64; 3],
}

impl Parabola {
    /// `sums[k]`: sum of `w x^k`; `values[k]`: sum of `w x^k y`.
    fn solve([s0, s1, s2, s3, s4]: [f64; 5], [v0, v1, v2]: [f64; 3]) -> Option<Self> {
        // without the constant term: a 2 x 2 system in centred moments
        let (m1, m2) = (s1 / s0, s2 / s0);
        let (xx, xq, qq) = (s2 - s1 * m1, s3 - s2 * m1, s4 - s2 * m2);
        let (xy, qy) = (v1 - v0 * m1, v2 - v0 * m2);
        let determinant = xx * qq - xq * xq;
        if determinant.is_nan() || determinant <= 1e-9 * xx * qq {
            return None;
        }
        Some(Self {
            b: (xy * qq - qy * xq) / determinant,
            c: (qy * xx - xy * xq) / determinant,
            covariance: [qq / determinant, xx / determinant, -xq / determinant],
        })
    }

    fn vertex(&self) -> Option<f64> {
        (self.c < -MIN_CURVATURE).then(|| -self.b / (2.0 * self.c))
    }

    /// Standard deviation of the vertex `-b / (2 c)`, to first order.
    fn sigma(&self, vertex: f64) -> f64 {
        let (by_b, by_c) = (-1.0 / (2.0 * self.c), -vertex / self.c);
        let [bb, cc, bc] = self.covariance;
        (by_b * by_b * bb + by_c * by_c * cc + 2.0 * by_b * by_c * bc).max(0.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The maximum of `curve` sampled at `positions`; the decided slice is `decided`.
    fn of(positions: &[f64], decided: usize, at_ends: [bool; 2], curve: impl Fn(f64) -> f64) -> Option<Maximum> {
        let energies: Vec<f32> = positions.iter().map(|&x| curve(x) as f32).collect();
        maximum(&Window { positions, energies: &energies, decided, search: 1, at_ends }, 1.0)
    }

    fn gaussian(top: f64, at: f64, width: f64) -> impl Fn(f64) -> f64 {
        move |x| 1.0 + top * (-(x - at) * (x - at) / (2.0 * width * width)).exp()
    }

    #[test]
    fn the_maximum_of_a_gaussian_is_found_on_even_and_uneven_positions() {
        for positions in [[0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 0.6, 2.0, 2.7, 4.0]] {
            for at in [1.7, 2.0, 2.3] {
                let found = of(&positions, 2, [false; 2], gaussian(500.0, at, 1.1)).unwrap();
                assert!((found.position - at).abs() < 1e-3, "{found:?} instead of {at}");
            }
        }
    }

    #[test]
    fn sigma_grows_with_noise_and_with_the_width_of_the_curve() {
        let positions = [0.0, 1.0, 2.0, 3.0, 4.0];
        let sigma = |top, width| of(&positions, 2, [false; 2], gaussian(top, 2.1, width)).unwrap().sigma;
        assert!(sigma(20.0, 1.0) > 2.0 * sigma(2000.0, 1.0));
        assert!(sigma(2000.0, 3.0) > 2.0 * sigma(2000.0, 1.0));
    }

    #[test]
    fn a_plateau_uses_more_slices_than_three() {
        // three values at the top differ by noise alone
        let bumps = [0.0, 0.02, -0.02, 0.02, 0.0, -0.01, 0.0];
        let curve = |x: f64| gaussian(900.0, 3.2, 2.0)(x) * (1.0 + bumps[x as usize]);
        let positions = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let found = of(&positions, 3, [false; 2], curve).unwrap();
        assert!((found.position - 3.2).abs() < 0.1, "{found:?}");
    }

    #[test]
    fn beyond_the_first_slice_there_is_no_height_and_near_it_little_certainty() {
        let positions = [0.0, 1.0, 2.0, 3.0];
        let at = |place: f64| of(&positions, 0, [true, false], gaussian(500.0, place, 1.0));
        assert!(at(-1.5).is_none());
        let (near, inside) = (at(-0.2).unwrap(), at(0.4).unwrap());
        assert!((near.position + 0.2).abs() < 0.05 && near.sigma > 0.25, "{near:?}");
        assert!(inside.sigma > 0.25);
    }

    #[test]
    fn curves_without_a_maximum_near_the_decided_slice_give_none() {
        let positions = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0];
        assert!(of(&positions, 1, [false; 2], gaussian(500.0, 4.0, 1.0)).is_none(), "still rising");
        assert!(of(&positions, 2, [false; 2], |_| 5.0).is_none(), "flat");
        assert!(
            maximum(&Window { positions: &[], energies: &[], decided: 0, search: 1, at_ends: [true; 2] }, 1.0)
                .is_none()
        );
    }
}
