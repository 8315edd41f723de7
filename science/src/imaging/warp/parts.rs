//! What all kernels of the warp share: the resolution of positions, the slice that is sampled, the weights.

use crate::imaging::Sample;

/// Fractional bits of a source position: positions are in 1/1024 px.
pub(super) const PHASE_BITS: u32 = 10;
/// Positions between two pixels.
pub(super) const PHASES: usize = 1 << PHASE_BITS;
/// Pixels whose positions are projected at a time.
pub(super) const BLOCK: usize = 64;

/// The slice that is sampled.
pub(super) struct Source<'a, S, const C: usize> {
    pub samples: &'a [S],
    pub width: usize,
    pub height: usize,
}

impl<S: Sample, const C: usize> Source<'_, S, C> {
    /// The top left of the 4 x 4 pixels around (u, v), and whether all of them are inside the slice.
    #[inline(always)]
    pub(super) fn corner(&self, u: i32, v: i32) -> ([isize; 2], bool) {
        let (x, y) = ((u >> PHASE_BITS) as isize - 1, (v >> PHASE_BITS) as isize - 1);
        let inside = x >= 0 && y >= 0 && x as usize + 4 <= self.width && y as usize + 4 <= self.height;
        ([x, y], inside)
    }

    /// The pixel at (x, y); outside of the slice the nearest border pixel.
    #[inline(always)]
    pub(super) fn pixel(&self, x: isize, y: isize) -> &[S] {
        let row = y.clamp(0, self.height as isize - 1) as usize * self.width;
        let start = (row + x.clamp(0, self.width as isize - 1) as usize) * C;
        &self.samples[start..start + C]
    }
}

/// Keys' four weights for each phase between two pixels.
pub(super) fn kernel() -> impl Iterator<Item = [f64; 4]> {
    (0..PHASES).map(|phase| {
        let t = phase as f64 / PHASES as f64;
        let near = |d: f64| (1.5 * d - 2.5) * d * d + 1.0;
        let far = |d: f64| ((-0.5 * d + 2.5) * d - 4.0) * d + 2.0;
        [far(1.0 + t), near(t), near(1.0 - t), far(2.0 - t)]
    })
}
