//! From a hostile zip to ordered slices, and from a hostile numpy file to matrices ([`npy`], [`npz`]).
//!
//! A zip is never extracted: names are labels, not paths; nothing is written to disk; one member is in memory at a
//! time, and never more of it than its declared size and [`ArchiveLimits`] allow. Everything that the directory and
//! the headers of the pictures tell is checked by [`open`]; what only decoding shows is told by [`ArchivedSlices`].
//!
//! # What is understood
//! - Front-light slices in a folder `front`, back-light slices in `back` (see [`Light`] for other spellings), or
//!   front-light slices in the root. Folders around everything are looked through.
//! - Order: natural order of the names (`img_2` before `img_10`, `_step_-00400_` before `_step_00000_`, case does not
//!   matter), or the order of `manifest.json`: `{"front": ["a.jpg", "b.jpg"], "back": ["c.jpg", "d.jpg"]}`, with names
//!   relative to the root or to the folder of that light, every picture of the zip named once.
//! - A camera counter that rolled over within the stack (`9998, 9999, 0001`) is put right, with a warning.
//! - Stored, deflated and deflate64 members, zip64, data descriptors, backslashes, names in UTF-8 or code page 437.

mod container;
mod headers;
mod layout;
mod light;
mod manifest;
mod member_names;
mod members;
mod natural_order;
mod not_a_zip;
pub mod npy;
pub mod npz;
mod numbering_gaps;
mod png_trailer;
mod seek_window;
mod slice_counts;
mod slices;

use std::path::Path;

use crate::{
    imaging::codec,
    types::{Error, ErrorKind, Warning, stack_layout::StackLayout},
};

pub use container::pack;
pub use light::Light;
pub use natural_order::natural_order;
pub use numbering_gaps::skipped;
pub use slices::ArchivedSlices;

use container::Container;

/// How much an archive may hold and cost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ArchiveLimits {
    /// Most members of any kind.
    pub max_members: usize,
    /// Most bytes of one member, unpacked.
    pub max_member_bytes: u64,
    /// Most bytes of all pictures together, unpacked.
    pub max_total_bytes: u64,
    /// Most bytes that are read to understand the directory.
    pub max_directory_bytes: u64,
    /// How large a picture may be.
    pub image: codec::Limits,
}

impl Default for ArchiveLimits {
    fn default() -> Self {
        Self {
            max_members: 2_500,
            max_member_bytes: 1 << 30,
            max_total_bytes: 64 << 30,
            max_directory_bytes: 64 << 20,
            image: codec::Limits::default(),
        }
    }
}

/// A zip whose directory and picture headers were found sound, with its slices in order.
pub struct StackArchive {
    layout: StackLayout,
    warnings: Vec<Warning>,
    front: ArchivedSlices,
    back: ArchivedSlices,
}

impl StackArchive {
    /// The same slices in the opposite order.
    #[must_use]
    pub fn reversed(self) -> Self {
        let (front, back) = (self.front.reversed(), self.back.reversed());
        Self { layout: self.layout.reversed(), front, back, ..self }
    }

    /// Names in order, and the size of all slices.
    pub fn layout(&self) -> &StackLayout {
        &self.layout
    }

    /// What the user should know although it is no reason to refuse.
    pub fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    /// The front-light slices: at least two.
    pub fn front(&self) -> &ArchivedSlices {
        &self.front
    }

    /// The back-light slices: none, or as many as front-light slices.
    pub fn back(&self) -> &ArchivedSlices {
        &self.back
    }

    /// The file of front-light slice `index`, for its metadata.
    ///
    /// # Errors
    /// A fault that names the file when it is damaged in the zip, and [`ErrorKind::Internal`] when there is no such slice.
    pub fn front_bytes(&self, index: usize) -> Result<Vec<u8>, Error> {
        self.front.bytes(index)
    }
}

/// Opens the zip at `path` and checks everything that its directory and the headers of its pictures tell.
///
/// # Errors
/// - [`ErrorKind::InvalidArchive`]: no zip, torn, wrong CRC; `..`, absolute, duplicate or unclear names; pictures in
///   folders that are neither front nor back; a manifest that does not fit
/// - [`ErrorKind::UnsupportedArchive`]: encrypted members, other compressions, split archives
/// - [`ErrorKind::ArchiveTooLarge`]: over a limit
/// - [`ErrorKind::InvalidImage`]: a slice that is no picture, or declares an absurd size, or lies turned
/// - [`ErrorKind::SizeMismatch`], [`ErrorKind::SliceCountMismatch`]: slices that do not belong together
pub fn open(path: &Path, limits: &ArchiveLimits) -> Result<StackArchive, Error> {
    checked(Container::open(path, limits)?, limits, u64::MAX)
}

/// The same at a cost that a client can wait for: of compressed members at most [`NEAR_BYTES`] are unpacked. A header that
/// lies farther on (a TIFF with its directory at the end) is left to [`open`] in the job; if that is so for all slices, the
/// first is unpacked.
///
/// # Errors
/// As [`open`].
pub fn open_near(path: &Path, limits: &ArchiveLimits) -> Result<StackArchive, Error> {
    checked(Container::open(path, limits)?, limits, NEAR_BYTES)
}

/// How far [`open_near`] looks into a compressed member.
const NEAR_BYTES: u64 = 1 << 20;

/// The same for a small zip that is in memory.
///
/// # Errors
/// As [`open`].
pub fn open_in_memory(zip: Vec<u8>, limits: &ArchiveLimits) -> Result<StackArchive, Error> {
    checked(Container::in_memory(zip, limits)?, limits, u64::MAX)
}

fn checked(container: Container, limits: &ArchiveLimits, most: u64) -> Result<StackArchive, Error> {
    let mut warnings = Vec::new();
    let sorted = layout::sort(&container, limits, &mut warnings)?;
    let front = ArchivedSlices::new(container.clone(), sorted.front, *limits);
    let back = ArchivedSlices::new(container, sorted.back, *limits);
    let common = headers::check(&front, &back, most, &mut warnings)?;
    let largest = slice_counts::refuse_large([&front, &back], u64::from(common.width) * u64::from(common.height))?;
    let layout = StackLayout {
        front: front.names(),
        back: back.names(),
        width: common.width,
        height: common.height,
        bit_depth: common.bit_depth,
        channels: common.channels,
        orientation: common.orientation,
        largest_file_bytes: largest,
    };
    slice_counts::refuse(&layout)?;
    Ok(StackArchive {
        layout,
        warnings,
        front: front.sized(common.width, common.height),
        back: back.sized(common.width, common.height),
    })
}

/// An `invalid_archive` fault about one file.
fn invalid(name: &str, detail: impl Into<String>) -> Error {
    Error::new(ErrorKind::InvalidArchive, detail).in_file(name, None)
}

/// Names for a sentence: the first few, and how many more.
fn listed<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    const SHOWN: usize = 5;
    let names: Vec<&str> = names.into_iter().collect();
    let shown = names.iter().take(SHOWN).copied().collect::<Vec<_>>().join(", ");
    match names.len() {
        n if n > SHOWN => format!("{shown} and {} more", n - SHOWN),
        _ => shown,
    }
}

#[cfg(test)]
mod tests;
