//! The defocus model of a stack: how blurred what is sharp in one slice is in another, and which slice is nearer to the
//! camera.
//!
//! The blur radius between slices `a` and `b` is `r(a, b) = min(r1 |z_a - z_b|, 64 px)`, with `z` the position of a
//! slice on the rail in mean steps, and `r1` the blur radius per step.

/// Blur radius, px, from which two slices are separable: far enough apart in focus to decide which one shows a pixel
/// sharp.
const SEPARABLE: f32 = 1.8;

/// Largest blur radius, px; larger ones are clamped, because the surroundings of a tile must be finite.
pub(super) const MAX_RADIUS: f32 = 64.0;

/// How focus changes from slice to slice.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct DefocusModel {
    /// Per slice: its position on the rail in mean steps.
    pub(super) positions: Vec<f32>,
    /// Blur radius of what is one step out of focus, px; 0 when it could not be measured.
    pub(super) radius_per_step: f32,
    /// Whether positions increase away from the camera; none when neither the profile nor the stack determines it.
    pub(super) increasing_depth: Option<bool>,
    /// Whether the stack shows the opposite of the direction that the profile gives. The profile is followed.
    pub(super) contradicts_profile: bool,
}

#[cfg(test)]
impl DefocusModel {
    /// The model of `slices` slices with even steps, of which the first is focused nearest.
    pub(super) fn near_first(slices: usize, radius_per_step: f32) -> Self {
        let positions = positions(slices, None);
        Self { positions, radius_per_step, increasing_depth: Some(true), contradicts_profile: false }
    }
}

impl DefocusModel {
    /// The model of `slices` slices whose blur was not measured.
    pub(super) fn unknown(slices: usize) -> Self {
        let positions = positions(slices, None);
        Self { positions, radius_per_step: 0.0, increasing_depth: None, contradicts_profile: false }
    }

    /// Blur radius, px, in slice `b` of what is sharp in slice `a`.
    pub(super) fn radius(&self, a: usize, b: usize) -> f32 {
        (self.radius_per_step * (self.positions[a] - self.positions[b]).abs()).min(MAX_RADIUS)
    }

    /// Whether the blur could be measured.
    pub(super) fn is_known(&self) -> bool {
        self.radius_per_step > 0.0
    }

    /// Whether slice `a` has a smaller position than slice `b`.
    pub(super) fn is_before(&self, a: usize, b: usize) -> bool {
        self.positions[a] < self.positions[b]
    }

    /// Whether what is sharp in one slice is clearly blurred in the other.
    pub(super) fn separable(&self, a: usize, b: usize) -> bool {
        self.radius(a, b) >= SEPARABLE
    }

    /// Whether the blur of what is sharp in `near` can lie over what is sharp in `far`.
    pub(super) fn spreads_over(&self, near: usize, far: usize) -> bool {
        let ordered = |increasing| (self.positions[near] < self.positions[far]) == increasing;
        self.increasing_depth.is_some_and(ordered) && self.separable(near, far)
    }

    /// Whether slice `a` is focused farther from the camera than slice `b`.
    pub(super) fn is_behind(&self, a: usize, b: usize) -> bool {
        self.increasing_depth.is_some_and(|increasing| (self.positions[a] > self.positions[b]) == increasing)
    }

    /// Whether there is any pair of slices between which blur can spread.
    pub(super) fn has_spread(&self) -> bool {
        let last = self.positions.len() - 1;
        self.increasing_depth.is_some() && self.separable(0, last)
    }
}

/// The position of each slice on the rail, in mean steps from the first; equal steps when the rail is not known.
pub(super) fn positions(count: usize, rail: Option<&[f64]>) -> Vec<f32> {
    let even = || (0..count).map(|slice| slice as f32).collect();
    let Some(rail) = rail.filter(|rail| rail.len() == count && count > 1) else { return even() };
    let step = (rail[count - 1] - rail[0]).abs() / (count - 1) as f64;
    if !step.is_finite() || step <= 0.0 {
        return even();
    }
    rail.iter().map(|position| ((position - rail[0]) / step) as f32).collect()
}
