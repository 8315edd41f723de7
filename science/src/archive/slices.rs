//! Slices that are loaded from the zip on demand.

use super::{container::Container, limits::ArchiveLimits, members::Member};
use crate::{
    imaging::{Raster, Slices, codec::Header},
    types::{Error, ErrorKind},
};

/// The slices of one light. Each [`Slices::load`] opens its own reader, so several threads can load in parallel.
/// Nothing is cached.
pub struct ArchivedSlices {
    container: Container,
    members: Vec<Member>,
    limits: ArchiveLimits,
    /// Width and height of every slice, px.
    size: Option<(usize, usize)>,
}

impl ArchivedSlices {
    pub(super) fn new(container: Container, members: Vec<Member>, limits: ArchiveLimits) -> Self {
        Self { container, members, limits, size: None }
    }

    /// The same, with the size that all headers declare.
    pub(super) fn sized(self, width: u32, height: u32) -> Self {
        Self { size: Some((width as usize, height as usize)), ..self }
    }

    /// The names in order.
    pub(super) fn names(&self) -> Vec<String> {
        self.members.iter().map(|member| member.name.clone()).collect()
    }

    /// The header of slice `index`; `None` when it is beyond the first `most` bytes of a compressed member.
    pub(super) fn header(&self, index: usize, most: u64) -> Result<Option<Header>, Error> {
        self.container.probe(self.member(index)?, &self.limits, most).map_err(|error| at_slice(error, index))
    }

    /// The name and uncompressed size of the largest file; of several the first.
    pub(super) fn largest(&self) -> Option<(&str, u64)> {
        let sizes = self.members.iter().map(|member| (member.name.as_str(), member.size));
        sizes.fold(None, |best, next| if best.is_none_or(|(_, size)| next.1 > size) { Some(next) } else { best })
    }

    /// The same slices in another order, given by their indices.
    pub(super) fn reordered(mut self, order: &[usize]) -> Self {
        self.members = order.iter().filter_map(|&at| self.members.get(at).cloned()).collect();
        self
    }

    /// The same slices from the last to the first.
    pub(super) fn reversed(mut self) -> Self {
        self.members.reverse();
        self
    }

    /// The bytes of the file of slice `index`. The CRC is checked.
    ///
    /// # Errors
    /// [`ErrorKind::InvalidArchive`] with the file name when the member is damaged; [`ErrorKind::ResourcesExhausted`]
    /// when the disk cannot be read; [`ErrorKind::Internal`] when there is no such slice.
    pub fn bytes(&self, index: usize) -> Result<Vec<u8>, Error> {
        self.container.read(self.member(index)?, &self.limits).map_err(|error| at_slice(error, index))
    }

    fn member(&self, index: usize) -> Result<&Member, Error> {
        let missing = || Error::new(ErrorKind::Internal, format!("there is no slice {index} in this stack"));
        self.members.get(index).ok_or_else(missing)
    }
}

impl Slices for ArchivedSlices {
    fn count(&self) -> usize {
        self.members.len()
    }

    fn name(&self, index: usize) -> &str {
        self.members.get(index).map_or("", |member| &member.name)
    }

    fn load(&self, index: usize) -> Result<Raster, Error> {
        self.load_into(index, Vec::new())
    }

    fn load_into(&self, index: usize, buffer: Vec<u8>) -> Result<Raster, Error> {
        let decoded = self.container.decode(self.member(index)?, &self.limits, buffer);
        let raster = decoded.map_err(|error| at_slice(error, index))?;
        let name = self.name(index);
        let size = (raster.width, raster.height);
        if self.size.is_some_and(|expected| expected != size) {
            let detail =
                format!("{name} is {} x {} px, but its header declares another size; save it again", size.0, size.1);
            return Err(Error::new(ErrorKind::SizeMismatch, detail).in_file(name, slice(index)));
        }
        Ok(raster)
    }
}

fn slice(index: usize) -> Option<u32> {
    u32::try_from(index).ok()
}

/// The error with the slice index filled in.
fn at_slice(mut error: Error, index: usize) -> Error {
    for location in &mut error.locations {
        location.slice = slice(index);
    }
    error
}
