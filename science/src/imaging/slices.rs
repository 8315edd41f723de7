//! Where slices come from: an archive, a renderer, a test.

use super::Raster;
use crate::types::Error;

/// A slice that could not be had, as a fault that names its file.
pub type SliceError = Error;

/// The ordered slices of one light of a stack. Slices are loaded one by one, possibly from several threads
/// at once, possibly more than once; nothing is kept between calls.
pub trait Slices: Sync {
    /// Number of slices.
    fn count(&self) -> usize;

    /// Name of slice `index` as the user knows it (its file name in the archive).
    fn name(&self, index: usize) -> &str;

    /// Decodes slice `index`: 1 or 3 channels (alpha is dropped), all slices of one stack of one size.
    ///
    /// # Errors
    /// A fault that names the file when it cannot be read or is no image.
    fn load(&self, index: usize) -> Result<Raster, SliceError>;
}

/// Slices that are in memory already.
impl Slices for [Raster] {
    fn count(&self) -> usize {
        self.len()
    }

    fn name(&self, _index: usize) -> &str {
        "(in memory)"
    }

    fn load(&self, index: usize) -> Result<Raster, SliceError> {
        Ok(self[index].clone())
    }
}

/// Borrowed slices: `&&pictures[..]` is a `&dyn Slices`, which an unsized `[Raster]` alone cannot be.
impl<T: Slices + ?Sized> Slices for &T {
    fn count(&self) -> usize {
        (**self).count()
    }

    fn name(&self, index: usize) -> &str {
        (**self).name(index)
    }

    fn load(&self, index: usize) -> Result<Raster, SliceError> {
        (**self).load(index)
    }
}
