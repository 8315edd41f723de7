//! Memory and disk space that [`fuse`](super::fuse) needs, for callers that share a machine between jobs.

use super::{align, height, in_flight::slices_in_flight, plan::Plan};
use crate::imaging::Depth;

/// One mebibyte.
const MIB: u64 = 1 << 20;

impl Plan {
    /// Upper bound of the memory that [`fuse`](super::fuse) holds, in bytes. It does not grow with the number of slices
    /// above 4.
    ///
    /// With `threads` threads, three channels of `depth`, `P` canvas pixels, `s` bytes per sample and
    /// `L = `[`slices_in_flight`] slices in flight:
    ///
    /// ```text
    /// bytes  = P max(first, second) + (48 threads + 32 + M) MiB
    /// first  = 4 + (7 s + 1) L       largest focus measure and its slice; per slice: samples, before and after
    ///                                alpha is dropped, and the cells of the focus energy
    /// second = 3 + 3 s + max(X, Z)   index, validity, fused image; X is the need of the method, Z of the height map
    /// X      = 10 + 3 s  for Method::HaloCorrected (decision map, pyramid image), else 0
    /// Z      = 13 with a height map (estimate and confidence per pixel and per cell, the map), else 0
    /// M      = 32 with metrics (sampled points and blocks), else 0
    /// ```
    pub fn memory_bytes(&self, threads: usize, depth: Depth, metrics: bool) -> u64 {
        let pixels = (self.width * self.height) as u64;
        let pixel = 3 * depth.bytes() as u64;
        let in_flight = 7 * depth.bytes() as u64 + 1;
        let first_pass = 4 + in_flight * slices_in_flight(threads, self.slices.len()) as u64;
        let height = if self.height_map.is_some() { height::BYTES_PER_PIXEL } else { 0 };
        let second_pass = 3 + pixel + self.method.extra_bytes_per_pixel(pixel).max(height);
        let sampled = if metrics { 32 } else { 0 };
        pixels * first_pass.max(second_pass) + (threads as u64 * 48 + 32 + sampled) * MIB
    }

    /// Size of the scratch file that [`fuse`](super::fuse) writes for slices of `channels` samples of `depth`, in
    /// bytes: the samples of all slices, padded to whole blocks; and, for methods that measure the coarse focus, a byte
    /// per cell and slice.
    pub fn scratch_bytes(&self, channels: usize, depth: Depth) -> u64 {
        let side = |length: usize| length.next_multiple_of(align::SCRATCH_BLOCK) as u64;
        let slices = self.slices.len() as u64;
        let pixels = side(self.width).saturating_mul(side(self.height));
        let samples = pixels.saturating_mul((channels * depth.bytes()) as u64);
        let cells = |length: usize| side(length.div_ceil(align::coarse_focus::CELL));
        let cells = match self.method.has_coarse_focus() {
            true => cells(self.width).saturating_mul(cells(self.height)),
            false => 0,
        };
        samples.saturating_add(cells).saturating_mul(slices)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_bounded_by_a_constant_for_any_number_of_slices_and_threads() {
        let need = |slices, threads| Plan::aligned(6000, 4000, slices).memory_bytes(threads, Depth::Eight, true);
        assert_eq!(need(4, 8), need(200, 8));
        // each thread has buffers of its own, and nothing else
        assert_eq!(need(20, 64) - need(20, 8), 56 * 48 * MIB);
    }
}
