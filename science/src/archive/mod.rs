//! Untrusted zip files become ordered slices, and untrusted numpy files become matrices ([`npy`], [`npz`]).
//!
//! A zip is never extracted. Names are labels, not paths. Nothing is written to disk. Each load holds one member in
//! memory, and never more of it than its declared size and [`ArchiveLimits`] allow. [`open`] checks everything that the
//! directory and the picture headers show. Errors that only decoding shows are returned by [`ArchivedSlices`].
//!
//! # Accepted archives
//! | aspect | accepted |
//! |---|---|
//! | folders | front light in `front` or in the root, back light in `back` (other spellings: [`Light`]); enclosing folders; further lights in other folders beside `front` ([`further_lights`]); in a calibration the moved target in `moved` |
//! | order | that of the names, the times of capture and the pictures ([`slice_order`]), or that of `manifest.json` |
//! | compression | stored, deflate, deflate64 |
//! | format | zip, zip64, zips over 4 GB of the macOS Finder, data descriptors, backslashes in names, names in UTF-8 or code page 437 |
//!
//! Natural order compares numbers by value and ignores case: `img_2` before `img_10`, `z-0.5` before `z0.25`. The names
//! of a stack together tell which minus is a sign and which point has decimals ([`notation`]). A camera counter that
//! starts again within the stack (`9998, 9999, 0001`) is followed, with a warning ([`counter`]). Names are compared in
//! one normal form of Unicode ([`folded`](crate::types::text::folded)). Folders that systems and file servers put
//! beside pictures are skipped ([`member_names`]).
//!
//! A manifest is `{"front": ["a.jpg", "b.jpg"], "back": ["c.jpg", "d.jpg"], "lights": {"uv": ["e.jpg", "f.jpg"]}}`.
//! Names are relative to the root or to the folder of that light, and every picture of the zip is named once.

mod container;
mod copies;
mod counter;
pub mod folder;
mod further_lights;
mod headers;
mod layout;
mod light;
mod limits;
mod manifest;
mod member_names;
mod members;
mod messages;
mod moved_target;
mod named_stack;
mod natural_order;
mod not_a_zip;
mod notation;
pub mod npy;
pub mod npz;
mod numbering_gaps;
mod other_folders;
mod png_trailer;
pub mod scan;
mod seek_window;
mod slice_counts;
mod slice_order;
mod slices;

use std::{path::Path, sync::Arc};

#[cfg(doc)]
use crate::types::ErrorKind;
use crate::types::{
    Error, ReadAt, Warning,
    stack_layout::{FurtherLight, StackLayout},
};

pub use container::pack;
pub use copies::{copied, copies};
pub use light::Light;
pub use limits::ArchiveLimits;
pub use named_stack::NamedStack;
pub use numbering_gaps::skipped;
pub use scan::{
    Ignored, ScanArchive, ScanRules, ScanView, holds_scan, open_first_near, open_scan, open_scan_shared, open_stacks,
};
pub use slices::ArchivedSlices;

use container::Container;
use members::{Member, SortedSlices};
use messages::invalid;

/// A zip whose directory and picture headers are valid, with its slices in order.
pub struct StackArchive {
    layout: StackLayout,
    warnings: Vec<Warning>,
    /// The front-light slices in the order of a witness that was overruled.
    overruled: Option<Vec<usize>>,
    front: ArchivedSlices,
    back: ArchivedSlices,
    lights: Vec<(String, ArchivedSlices)>,
    moved: ArchivedSlices,
}

impl StackArchive {
    /// The same slices in the opposite order.
    #[must_use]
    pub fn reversed(self) -> Self {
        let (front, back) = (self.front.reversed(), self.back.reversed());
        let last = self.layout.front.len().saturating_sub(1);
        let overruled = self.overruled.map(|places| places.into_iter().map(|place| last - place).collect());
        let lights = self.lights.into_iter().map(|(name, slices)| (name, slices.reversed())).collect();
        Self { layout: self.layout.reversed(), overruled, front, back, lights, ..self }
    }

    /// The front-light slices in another order, where the names and the times of capture disagree: that of the times,
    /// or that of the names where the times decided. `None` where both agree, and where `manifest.json` gives the
    /// order.
    pub fn overruled_order(&self) -> Option<&[usize]> {
        self.overruled.as_deref()
    }

    /// Names in order, and the size of all slices.
    pub fn layout(&self) -> &StackLayout {
        &self.layout
    }

    /// Observations that the user should know and that are no reason to refuse the archive.
    pub fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    /// The front-light slices, at least two.
    pub fn front(&self) -> &ArchivedSlices {
        &self.front
    }

    /// The back-light slices: none, or as many as there are front-light slices.
    pub fn back(&self) -> &ArchivedSlices {
        &self.back
    }

    /// The further lights by name, each with as many slices as there are front-light slices.
    pub fn lights(&self) -> &[(String, ArchivedSlices)] {
        &self.lights
    }

    /// The slices of the moved target, any number.
    pub fn moved(&self) -> &ArchivedSlices {
        &self.moved
    }

    /// The bytes of the file of front-light slice `index`, for its metadata.
    ///
    /// # Errors
    /// As [`ArchivedSlices::bytes`].
    pub fn front_bytes(&self, index: usize) -> Result<Vec<u8>, Error> {
        self.front.bytes(index)
    }
}

/// Opens the zip at `path` and checks everything that its directory and the headers of its pictures show.
///
/// # Errors
/// | kind | cause |
/// |---|---|
/// | [`ErrorKind::InvalidArchive`] | not a zip, truncated, wrong CRC; names with `..`, absolute or duplicate names; folders that stand for no light; a manifest that does not match |
/// | [`ErrorKind::UnsupportedArchive`] | encrypted members, other compression methods, split archives |
/// | [`ErrorKind::ArchiveTooLarge`] | a limit is exceeded |
/// | [`ErrorKind::InvalidImage`] | a slice is not a picture, has an implausible size, or is rotated unlike the others |
/// | [`ErrorKind::SizeMismatch`], [`ErrorKind::SliceCountMismatch`] | slices that do not belong together |
/// | [`ErrorKind::ResourcesExhausted`] | the disk cannot be read |
pub fn open(path: &Path, limits: &ArchiveLimits) -> Result<StackArchive, Error> {
    checked(Container::open_file(path, limits)?, limits, u64::MAX)
}

/// Like [`open`], for a zip that need not be a file on this machine. An error of the reader is
/// [`ErrorKind::ResourcesExhausted`].
///
/// # Errors
/// As [`open`].
pub fn open_shared(zip: Arc<dyn ReadAt>, limits: &ArchiveLimits) -> Result<StackArchive, Error> {
    checked(Container::open(zip, limits)?, limits, u64::MAX)
}

/// Like [`open_shared`], but fast enough for a client to wait: at most [`NEAR_BYTES`] of each compressed member are
/// decompressed. A header beyond that (a TIFF with its directory at the end) is not checked here; the job calls
/// [`open`]. When the headers of all slices of one light are beyond it, the first slice of that light is decompressed.
///
/// # Errors
/// As [`open`].
pub fn open_near(zip: Arc<dyn ReadAt>, limits: &ArchiveLimits) -> Result<StackArchive, Error> {
    checked(Container::open(zip, limits)?, limits, NEAR_BYTES)
}

/// Bytes that [`open_near`] decompresses of a member.
const NEAR_BYTES: u64 = 1 << 20;

/// Like [`open`], for a small zip in memory.
///
/// # Errors
/// As [`open`].
///
/// # Example
/// ```
/// use pinstack_science::{archive, imaging::{Raster, Slices, codec}};
///
/// let picture = |grey| {
///     let mut png = Vec::new();
///     codec::encode_png(&mut png, &Raster::eight(32, 24, 1, vec![grey; 32 * 24]), &codec::Metadata::default())?;
///     std::io::Result::Ok(png)
/// };
/// let mut zip = std::io::Cursor::new(Vec::new());
/// archive::pack(&mut zip, [("b_10.png".into(), picture(10)?), ("b_9.png".into(), picture(9)?)].into_iter())?;
/// let stack = archive::open_in_memory(zip.into_inner(), &archive::ArchiveLimits::default())?;
/// assert_eq!(stack.layout().front, ["b_9.png", "b_10.png"]);
/// assert_eq!(stack.front().load(1)?.luma().at(0, 0), 10.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn open_in_memory(zip: Vec<u8>, limits: &ArchiveLimits) -> Result<StackArchive, Error> {
    checked(Container::in_memory(zip, limits)?, limits, u64::MAX)
}

/// The name of a file, and its bytes.
pub type NamedFile = (String, Vec<u8>);

/// Of each pair of names the first that the zip has in whatever folder, and its bytes. Nothing else is decompressed.
///
/// # Errors
/// [`ErrorKind::InvalidArchive`] if several folders have such files, and as [`open`] for a zip that cannot be read.
pub fn read_files(
    zip: Vec<u8>,
    wanted: [[&str; 2]; 2],
    limits: &ArchiveLimits,
) -> Result<[Option<NamedFile>; 2], Error> {
    let container = Container::in_memory(zip, limits)?;
    let is = |member: &Member, name: &str| member.name.rsplit('/').next() == Some(name);
    let mut members = container.members()?;
    members.retain(|member| wanted.as_flattened().iter().any(|name| is(member, name)));
    if let Some(other) = members.iter().find(|member| member.folder() != members[0].folder()) {
        let both = format!("the zip has {} and {} in two folders; zip one folder", members[0].name, other.name);
        return Err(invalid(&other.name, both));
    }
    let read = |names: [&str; 2]| {
        let found = names.iter().find_map(|name| members.iter().find(|member| is(member, name)));
        found.map(|member| Ok((member.name.clone(), container.read(member, limits)?))).transpose()
    };
    Ok([read(wanted[0])?, read(wanted[1])?])
}

fn checked(container: Container, limits: &ArchiveLimits, most: u64) -> Result<StackArchive, Error> {
    let mut warnings = Vec::new();
    let sorted = layout::sort(&container, limits, &mut warnings)?;
    of_slices(container, sorted, limits, most, warnings)
}

/// The stack of these slices, whose headers are checked. `warnings` are those of their names.
fn of_slices(
    container: Container,
    sorted: SortedSlices,
    limits: &ArchiveLimits,
    most: u64,
    mut warnings: Vec<Warning>,
) -> Result<StackArchive, Error> {
    let is_listed = sorted.is_listed;
    let front = ArchivedSlices::new(container.clone(), sorted.front, *limits);
    let back = ArchivedSlices::new(container.clone(), sorted.back, *limits);
    let none = ArchivedSlices::new(container.clone(), Vec::new(), *limits);
    let moved = ArchivedSlices::new(container.clone(), sorted.moved, *limits);
    let mut common = headers::check(&front, &back, most, &mut warnings)?;
    let moved = moved_target::checked(moved, &none, &mut common, most, &mut warnings)?;
    let mut lights = Vec::new();
    for (name, members) in sorted.lights {
        let light = (name, ArchivedSlices::new(container.clone(), members, *limits));
        lights.push(further_lights::checked(light, &none, &mut common, (most, is_listed), &mut warnings)?);
    }
    let settled = [(&front, &common.taken[0]), (&back, &common.taken[1])]
        .map(|(slices, taken)| slice_order::settle(&slices.names(), taken, is_listed));
    let (front, back) = (front.reordered(&settled[0].order), back.reordered(&settled[1].order));
    let overruled = settled[0].overruled.clone();
    warnings.extend(settled.into_iter().flat_map(|settled| settled.warnings));
    let all = [&front, &back, &moved].into_iter().chain(lights.iter().map(|(_, slices)| slices));
    let largest = slice_counts::refuse_large(all, u64::from(common.width) * u64::from(common.height))?;
    let of_light =
        |(name, slices): &(String, ArchivedSlices)| FurtherLight { name: name.clone(), slices: slices.names() };
    let layout = StackLayout {
        front: front.names(),
        back: back.names(),
        lights: lights.iter().map(of_light).collect(),
        moved: moved.names(),
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
        overruled,
        front: front.sized(common.width, common.height),
        back: back.sized(common.width, common.height),
        lights,
        moved,
    })
}

#[cfg(test)]
mod tests;
