//! The source of the slices of a stack: an archive, a renderer, a test.

use super::Raster;
use crate::types::Error;

/// The ordered slices of one light of a stack. Slices are loaded one by one, possibly by several threads in parallel
/// and possibly more than once. Nothing is cached between calls.
pub trait Slices: Sync {
    /// Number of slices.
    fn count(&self) -> usize;

    /// Name of slice `index` for the user: its file name in the archive.
    fn name(&self, index: usize) -> &str;

    /// Decodes slice `index` to 1 or 3 channels (alpha is dropped). All slices of a stack have the same size.
    ///
    /// # Errors
    /// An error that names the file when it cannot be read or decoded.
    fn load(&self, index: usize) -> Result<Raster, Error>;

    /// The same as [`Slices::load`]. The 8-bit samples of the raster may be in the memory of `buffer`, whose contents
    /// are lost: fresh memory for a large picture costs a sixth of decoding it.
    ///
    /// # Errors
    /// As [`Slices::load`].
    fn load_into(&self, index: usize, buffer: Vec<u8>) -> Result<Raster, Error> {
        drop(buffer);
        self.load(index)
    }
}

/// Slices in memory.
impl Slices for [Raster] {
    fn count(&self) -> usize {
        self.len()
    }

    fn name(&self, _index: usize) -> &str {
        "(in memory)"
    }

    fn load(&self, index: usize) -> Result<Raster, Error> {
        Ok(self[index].clone())
    }
}

/// Borrowed slices: a `&&[Raster]` coerces to `&dyn Slices`, which an unsized `[Raster]` does not.
impl<T: Slices + ?Sized> Slices for &T {
    fn count(&self) -> usize {
        (**self).count()
    }

    fn name(&self, index: usize) -> &str {
        (**self).name(index)
    }

    fn load(&self, index: usize) -> Result<Raster, Error> {
        (**self).load(index)
    }

    fn load_into(&self, index: usize, buffer: Vec<u8>) -> Result<Raster, Error> {
        (**self).load_into(index, buffer)
    }
}
