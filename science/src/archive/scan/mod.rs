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
    collections::BTreeSet,
    io::{Seek, Write},
    path::Path,
    sync::Arc,
};

use super::{
    ArchiveLimits, Light, NEAR_BYTES, StackArchive, container::Container, layout, members::SortedSlices, moved_target,
    of_slices, open_near, open_shared,
};
use crate::types::{Error, ErrorKind, ReadAt, Warning, text::folded};

pub use names::{NameGrouping, NamedView, group_names};
pub(super) use output::MANIFEST;
pub use view::{Angle, AxisRule, Ignored, ScanRules, ScanView, ViewFiles};

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
    grouped(Container::open_file(path, limits)?, limits, rules)
}

/// Like [`open_scan`], for a zip that need not be a file on this machine.
///
/// # Errors
/// As [`open_scan`].
pub fn open_scan_shared(zip: Arc<dyn ReadAt>, limits: &ArchiveLimits, rules: &ScanRules) -> Result<ScanArchive, Error> {
    grouped(Container::open(zip, limits)?, limits, rules)
}

/// Whether the pictures of a zip are in several folders that stand for no light, as the views of a scan are. Folders
/// beside one of a front light are further lights. Of a scan whose file names tell the views apart it is false: that
/// may be one stack.
///
/// # Errors
/// As [`open_scan`] for a zip that cannot be read, and for names that are refused.
pub fn holds_scan(zip: Arc<dyn ReadAt>, limits: &ArchiveLimits) -> Result<bool, Error> {
    let container = Container::open(zip, limits)?;
    let (split, _) = layout::split_with_raw(layout::checked_members(&container, &mut Vec::new())?);
    let (pictures, _) = layout::unwrapped(moved_target::split(split.pictures)?.0);
    let folders = pictures.iter().filter_map(|picture| picture.inner.rsplit_once('/'));
    let folders: BTreeSet<Vec<String>> = folders.map(|(all, _)| all.split('/').map(folded).collect()).collect();
    let with_front: BTreeSet<&[String]> = folders
        .iter()
        .filter_map(|all| all.split_last().filter(|(last, _)| Light::of_folder(last) == Some(Light::Front)))
        .map(|(_, outside)| outside)
        .collect();
    let view = |all: &'_ Vec<String>| {
        let outside = all.split_last().map(|(_, outside)| outside).filter(|outside| with_front.contains(outside));
        let names = outside.unwrap_or(all).iter().filter(|name| Light::of_folder(name).is_none()).cloned();
        Some(names.collect::<Vec<_>>()).filter(|names| !names.is_empty())
    };
    Ok(folders.iter().filter_map(view).collect::<BTreeSet<_>>().len() > 1)
}

/// The stack of a zip, or the stacks of the scan that it holds, by [`holds_scan`].
///
/// # Errors
/// As [`open`](super::open) and [`open_scan`].
pub fn open_stacks(zip: Arc<dyn ReadAt>, limits: &ArchiveLimits) -> Result<Vec<StackArchive>, Error> {
    match scan_in(&zip, limits)? {
        Some(scan) => (0..scan.views().len()).map(|index| scan.open_view(index)).collect(),
        None => Ok(vec![open_shared(zip, limits)?]),
    }
}

/// The first of [`open_stacks`], as fast as [`open_near`].
///
/// # Errors
/// As [`open_stacks`].
pub fn open_first_near(zip: Arc<dyn ReadAt>, limits: &ArchiveLimits) -> Result<StackArchive, Error> {
    match scan_in(&zip, limits)? {
        Some(scan) => scan.opened(0, NEAR_BYTES),
        None => open_near(zip, limits),
    }
}

fn scan_in(zip: &Arc<dyn ReadAt>, limits: &ArchiveLimits) -> Result<Option<ScanArchive>, Error> {
    let limits = ArchiveLimits { max_member_bytes: limits.max_member_bytes, ..ArchiveLimits::scan() };
    let is_scan = holds_scan(Arc::clone(zip), &limits)?;
    is_scan.then(|| open_scan_shared(Arc::clone(zip), &limits, &ScanRules::default())).transpose()
}

fn grouped(container: Container, limits: &ArchiveLimits, rules: &ScanRules) -> Result<ScanArchive, Error> {
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

    /// The members of the zip of view `index`, for a reader that makes it without copying.
    ///
    /// # Errors
    /// [`ErrorKind::Internal`] when there is no such view.
    pub fn view_files(&self, index: usize) -> Result<ViewFiles, Error> {
        Ok(self.group(index)?.files())
    }

    /// The stack of view `index`, read from the scan itself. Names are those in the scan.
    ///
    /// # Errors
    /// As [`open`](super::open) for the slices of this view; [`ErrorKind::Internal`] when there is no such view.
    pub fn open_view(&self, index: usize) -> Result<StackArchive, Error> {
        self.opened(index, u64::MAX)
    }

    fn opened(&self, index: usize, most: u64) -> Result<StackArchive, Error> {
        let group = self.group(index)?;
        let is_listed = group.files().manifest.is_some();
        let sorted = SortedSlices {
            front: group.front.clone(),
            back: group.back.clone(),
            lights: Vec::new(),
            moved: Vec::new(),
            is_listed,
        };
        let limits = ArchiveLimits { max_total_bytes: ArchiveLimits::default().max_total_bytes, ..self.limits };
        of_slices(self.container.clone(), sorted, &limits, most, Vec::new())
    }

    fn group(&self, index: usize) -> Result<&Group, Error> {
        let missing = || Error::new(ErrorKind::Internal, format!("there is no view {index} in this scan"));
        self.groups.get(index).ok_or_else(missing)
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
        self.group(index)?.write(&self.container, &self.limits, out)
    }
}

#[cfg(test)]
mod tests;
