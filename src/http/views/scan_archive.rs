//! How the zip of a scan is taken apart, as the API shows it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::contract::Name;
use pinstack_science::{
    archive::scan::{Ignored, ScanArchive, ScanView},
    types::Warning,
};

/// The views that were found in the zip of a scan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ScanArchiveView {
    /// The scan.
    pub scan: Name,
    /// The views, by tilt, pan and name.
    pub views: Vec<ArchivedView>,
    /// Files that belong to no view, and why.
    pub ignored: Vec<Ignored>,
    /// What the user should know.
    pub warnings: Vec<Warning>,
}

/// A view in the zip of a scan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ArchivedView {
    /// URL of the stack that was made of it; null with `dry_run`, or when the stack was deleted.
    pub stack: Option<String>,
    /// Pan, degrees; null when the names do not tell.
    pub pan_deg: Option<f64>,
    /// Tilt, degrees; null when the names do not tell.
    pub tilt_deg: Option<f64>,
    /// Label; null when the names tell the angles alone.
    pub label: Option<String>,
    /// Folder, or what the names of its slices have in common.
    pub folder: String,
    /// Number of front-light slices.
    pub front: u32,
    /// Number of back-light slices.
    pub back: u32,
    /// First and last front-light slice, in the order of fusion.
    pub slices: [String; 2],
    /// Why the view cannot be fused, as far as names and numbers tell; null when nothing is wrong.
    pub problem: Option<String>,
}

impl ScanArchiveView {
    /// The grouping of a zip. `slice_count`: slices per light that the profile needs.
    pub fn of(scan: &Name, archive: &ScanArchive, slice_count: usize) -> Self {
        Self {
            scan: scan.clone(),
            views: archive.views().iter().map(|view| ArchivedView::of(view, slice_count)).collect(),
            ignored: archive.ignored().to_vec(),
            warnings: archive.warnings().to_vec(),
        }
    }
}

impl ArchivedView {
    fn of(view: &ScanView, slice_count: usize) -> Self {
        let (front, back) = (view.front.len(), view.back.len());
        let problem = if front != slice_count {
            Some(format!("it has {front} front-light slices, the profile has {slice_count}"))
        } else if back != 0 && back != front {
            Some(format!("it has {front} front-light and {back} back-light slices; both need the same number"))
        } else {
            None
        };
        let name = |slice: Option<&String>| slice.cloned().unwrap_or_default();
        let count = |slices: usize| u32::try_from(slices).unwrap_or(u32::MAX);
        Self {
            stack: None,
            pan_deg: view.pan_deg,
            tilt_deg: view.tilt_deg,
            label: view.label.clone(),
            folder: view.folder.clone(),
            front: count(front),
            back: count(back),
            slices: [name(view.front.first()), name(view.front.last())],
            problem,
        }
    }

    /// The file name of the zip of a view: its label, or its angles, or the last folder.
    pub fn file_name(view: &ScanView) -> String {
        let angles = view.angles().map(|angles| angles.file_stem());
        let folder = || view.folder.trim_matches('/').rsplit('/').next().unwrap_or_default().to_owned();
        format!("{}.zip", view.label.clone().or(angles).unwrap_or_else(folder))
    }
}
