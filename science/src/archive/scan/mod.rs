//! Takes a zip with a whole scan apart into views, and each view into a zip that [`open`](super::open) accepts.
//! [`group_names`] does the same for names alone, before anything is zipped.
//!
//! In: the directory of the zip, and a `manifest.json` if there is one. Pictures are neither decompressed nor decoded;
//! the zip of each view is checked when it is opened. Memory: about 2 KiB per member.
//!
//! # Layouts that are understood
//! | layout | example |
//! |---|---|
//! | a folder per view, with folders of the lights | `bee/view_01/front/1.jpg`, `bee/view_01/back/1.jpg` |
//! | a folder per view, front light only, or with a sibling for the back light | `view_01/1.jpg`, `view_01_back/1.jpg` |
//! | folders of the lights, with a folder per view in each | `without_backlight/x=6/y=120/1.jpg` |
//! | a view per prefix of the file names | `_x_00190_y_00000_step_-08000_.jpg`, `scan01_001_fs03.jpg`, `angle_001_focus_001.tiff` |
//! | a light in the file names | `view01_front_03.jpg`, `view01_back_03.jpg` |
//! | any names, with a manifest | below |
//!
//! Folders that enclose everything are looked through. In file names, the number of the slice follows a word for focus
//! (`step`, `focus`, `fs`, `slice`, `z`, `frame`, ...) or is the last number. All other numbers and words name the
//! view.
//!
//! # Angles
//! Angles come from `pan` and `tilt` in the name of a view ([`ViewAngles::of_name`](crate::types::view::ViewAngles)),
//! from `x=6/y=120` (tilt and pan in degrees), from motor steps `_x_00190_y_00000_` when [`ScanRules`] say how many
//! degrees a step has, or from `image_0001_-70_0` (number, tilt, pan). An angle that all views have may be in a folder
//! that encloses them.
//!
//! # Manifest
//! `manifest.json` in the root, or in the folder that encloses everything, lists all views when names say nothing:
//!
//! ```json
//! { "views": [
//!     { "label": "side", "pan_deg": 20, "tilt_deg": -6, "front": ["a.jpg", "b.jpg"], "back": ["c.jpg", "d.jpg"] }
//! ] }
//! ```
//!
//! `label`, `pan_deg`, `tilt_deg` and `back` may be omitted. The order of the slices is that of the lists.

mod angles;
mod checks;
mod file_names;
mod folders;
mod grouping;
mod manifest;
mod names;
mod output;
mod view;

use std::{
    io::{Seek, Write},
    path::Path,
};

use super::{ArchiveLimits, container::Container, layout};
use crate::types::{Error, ErrorKind, Warning};

pub use names::{NameGrouping, NamedView, group_names};
pub use view::{Angle, AxisRule, Ignored, ScanRules, ScanView};

use grouping::Enclosing;
use view::Group;

/// A zip whose members are sorted into views.
pub struct ScanArchive {
    container: Container,
    limits: ArchiveLimits,
    views: Vec<ScanView>,
    groups: Vec<Group>,
    ignored: Vec<Ignored>,
    warnings: Vec<Warning>,
}

/// Opens the zip at `path` and sorts its pictures into views. `limits` are usually [`ArchiveLimits::scan`].
///
/// # Errors
/// | kind | cause |
/// |---|---|
/// | [`ErrorKind::InvalidArchive`] | as [`open`](super::open); a zip that is one stack; no layout recognised; ambiguous names; equal angles; a manifest that does not match |
/// | [`ErrorKind::SliceCountMismatch`] | a view with one slice, with back light only, or with unequal lights |
/// | [`ErrorKind::InvalidImage`] | camera raw files without a picture |
/// | others | as [`open`](super::open) |
pub fn open_scan(path: &Path, limits: &ArchiveLimits, rules: &ScanRules) -> Result<ScanArchive, Error> {
    let container = Container::open_file(path, limits)?;
    let mut warnings = Vec::new();
    let members = layout::checked_members(&container, &mut warnings)?;
    let split = layout::split(members, &mut warnings)?;
    if split.pictures.is_empty() {
        return Err(layout::no_pictures(&split.others));
    }
    layout::refuse_twins(&split.pictures)?;
    layout::refuse_too_much(&split.pictures, limits)?;
    let listed = match manifest::find(&split.others, &split.pictures) {
        Some(member) => {
            manifest::refuse_too_large(member)?;
            manifest::read(member, &container.read(member, limits)?, &split.pictures)?
        }
        None => None,
    };
    let is_listed = listed.is_some();
    let (groups, ignored) = grouping::group(split, listed, rules, Enclosing::Dropped, &mut warnings)?;
    checks::check(&groups, is_listed)?;
    checks::warn(&groups, &mut warnings);
    let views = groups.iter().map(|group| group.view(&container)).collect::<Result<_, _>>()?;
    Ok(ScanArchive { container, limits: *limits, views, groups, ignored, warnings })
}

impl ScanArchive {
    /// The views, at least two unless a manifest lists one: by tilt, then by pan; then those without angles, in natural
    /// order.
    pub fn views(&self) -> &[ScanView] {
        &self.views
    }

    /// The files that belong to no view, in natural order. Files that operating systems add are not listed.
    pub fn ignored(&self) -> &[Ignored] {
        &self.ignored
    }

    /// Observations that the user should know and that are no reason to refuse the zip.
    pub fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    /// Writes view `index` as a zip with the folders `front` and `back`. Deflated members are copied with their
    /// compressed bytes where their headers allow it; others are stored. Size and CRC of each member are checked. The
    /// same scan gives the same bytes.
    ///
    /// # Errors
    /// [`ErrorKind::InvalidArchive`] with the file name for a damaged member;
    /// [`ErrorKind::ResourcesExhausted`] when the scan cannot be read; [`ErrorKind::DiskFull`] and [`ErrorKind::Io`]
    /// when `out` cannot be written; [`ErrorKind::Internal`] when there is no such view.
    pub fn write_view(&self, index: usize, out: impl Write + Seek) -> Result<(), Error> {
        let missing = || Error::new(ErrorKind::Internal, format!("there is no view {index} in this scan"));
        self.groups.get(index).ok_or_else(missing)?.write(&self.container, &self.limits, out)
    }
}

#[cfg(test)]
mod tests;
