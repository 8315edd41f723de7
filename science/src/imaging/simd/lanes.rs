//! Samples viewed as bytes.

use crate::imaging::Sample;

/// The samples as bytes, native endian.
pub fn bytes_of<S: Sample>(samples: &[S]) -> &[u8] {
    // SAFETY: samples are `u8` or `u16` (the trait is sealed), which have no padding, and any byte pattern is a `u8`.
    let (_, bytes, _) = unsafe { samples.align_to::<u8>() };
    bytes
}

/// The same, mutable.
pub fn bytes_of_mut<S: Sample>(samples: &mut [S]) -> &mut [u8] {
    // SAFETY: samples are `u8` or `u16` (the trait is sealed), which have no padding and of which any byte pattern is
    // one.
    let (_, bytes, _) = unsafe { samples.align_to_mut::<u8>() };
    bytes
}
