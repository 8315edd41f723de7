//! The course of saliency over three consecutive slices, and where its peak lies.

/// Where saliency sinks into the noise within two slices, the peak is outside if the fall from the end slice to the
/// next is by less than this factor: the flank of a peak is steep only near the peak.
const STEEP: f32 = 1.5;

/// Whether a pixel is in focus before the end of the stack, so that the stack misses it. `saliency` is that of the end
/// slice and of two slices after it, all equally far apart; `noise` is the saliency of noise alone. A peak farther
/// before the end slice than `outside`, in units of that distance, is missed.
///
/// Saliency falls with defocus `z` about as `s0 / (1 + (z / w)^2)`. Its inverse is a parabola, and the minimum of the
/// parabola through the three values is the position of focus, also when the step is large.
pub(super) fn peaks_before(saliency: [f32; 3], noise: f32, outside: f32) -> bool {
    let [end, next, third] = saliency;
    if !(end > next && next > third && third > 0.0) {
        return false;
    }
    let inverse = |value: f32| 1.0 / (value - noise).max(0.02 * end);
    let [u0, u1, u2] = [inverse(end), inverse(next), inverse(third)];
    let curvature = (u0 - 2.0 * u1 + u2) / 2.0;
    let slope = (4.0 * u1 - 3.0 * u0 - u2) / 2.0;
    if curvature <= 0.0 {
        // the third value has sunk into the noise: a steep fall means that focus is near the end slice
        return u1 < STEEP * u0;
    }
    -slope / (2.0 * curvature) < -outside
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Saliency at slices 0, 1 and 2 of a pixel in focus at `z`, with a peak `w` steps wide.
    fn slices(z: f32, w: f32) -> [f32; 3] {
        [0.0, 1.0, 2.0].map(|n: f32| 3.0 + 60.0 / (1.0 + ((n - z) / w).powi(2)))
    }

    #[test]
    fn focus_at_the_end_slice_is_inside_whatever_the_step() {
        for w in [0.3, 0.6, 1.0, 2.0, 4.0] {
            for z in [-0.4, 0.0, 0.3] {
                assert!(!peaks_before(slices(z, w), 3.0, 0.75), "z {z}, w {w}");
            }
        }
    }

    #[test]
    fn focus_steps_before_the_end_slice_is_outside() {
        for w in [1.0, 2.0, 4.0] {
            for z in [-1.5, -3.0, -5.0] {
                assert!(peaks_before(slices(z, w), 3.0, 0.75), "z {z}, w {w}");
            }
        }
    }

    #[test]
    fn saliency_that_does_not_fall_steadily_is_not_outside() {
        for saliency in [[10.0, 12.0, 9.0], [10.0, 8.0, 9.0], [10.0, 8.0, 0.0]] {
            assert!(!peaks_before(saliency, 1.0, 0.75), "{saliency:?}");
        }
    }
}
