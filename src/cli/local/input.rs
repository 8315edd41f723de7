//! What a person names: folders and zips, each of one stack or of a scan, as views.

use std::{
    collections::HashSet,
    fs::{self, File},
    path::{Path, PathBuf},
    sync::{Arc, OnceLock},
};

use anyhow::{Result, anyhow, bail};

use super::words;
use crate::contract::JobError;
use pinstack_science::{
    archive::{self, ArchiveLimits, ScanArchive, ScanRules, ScanView, StackArchive, folder::Folder, scan::ViewFiles},
    types::{Control, Interrupted, ReadAt, view::ViewAngles},
};

/// A stack that a person named, or a view of a scan.
pub(in crate::cli) struct View {
    /// Its name, unique in the run: of files and folders, without dots and blanks.
    pub name: String,
    /// The folder or zip as it was typed.
    pub input: PathBuf,
    /// Pan and tilt, if names say both.
    pub angles: Option<ViewAngles>,
    is_folder: bool,
    source: Source,
}

/// Where its slices are.
enum Source {
    /// A zip of one stack.
    Zip(Arc<File>),
    /// A folder, or the files of it that are a view.
    Folder { files: Arc<Folder>, view: Option<ViewFiles>, zip: OnceLock<Arc<dyn ReadAt>> },
    /// A view in the zip of a scan.
    Scan { scan: Arc<ScanArchive>, index: usize },
}

/// The views in folders and zips. `back`: the folder of the back light of the only one.
///
/// # Errors
/// With the path as it was typed: what cannot be read, is no zip, or has no stacks.
pub(in crate::cli) fn views(inputs: &[PathBuf], back: Option<&Path>) -> Result<Vec<View>> {
    if back.is_some() && (inputs.len() != 1 || !inputs.iter().all(|input| input.is_dir())) {
        bail!("--back is the folder of the back light of one folder; give one folder, and no zip");
    }
    let mut views = Vec::new();
    for input in inputs {
        let mut found = of_input(input, back)?;
        if inputs.len() > 1 && found.len() > 1 {
            let of = stem(&name_of(input));
            found.iter_mut().for_each(|view| view.name = format!("{of}_{}", view.name));
        }
        views.extend(found);
    }
    make_unique(&mut views);
    Ok(views)
}

fn of_input(input: &Path, back: Option<&Path>) -> Result<Vec<View>> {
    let metadata = fs::metadata(input);
    let metadata = metadata.map_err(|error| anyhow!("cannot read {} ({error}); check the path", input.display()))?;
    let is_folder = metadata.is_dir();
    let told = |error: pinstack_science::types::Error| anyhow!(words::about(input, is_folder, &error.detail));
    let (folder, names): (Option<Arc<Folder>>, Arc<dyn ReadAt>) = if is_folder {
        let front = Folder::list(input).map_err(told)?;
        let folder = match back {
            Some(back) => Folder::of_lights(front, Folder::list(back).map_err(|error| anyhow!(error.detail))?),
            None => front,
        };
        let names = folder.names();
        (Some(Arc::new(folder)), Arc::new(names))
    } else {
        let file = File::open(input).map_err(|error| anyhow!("cannot read {} ({error})", input.display()))?;
        (None, Arc::new(file))
    };
    let view = |name: String, angles, source| View { name, input: input.to_owned(), angles, is_folder, source };
    if !archive::holds_scan(Arc::clone(&names), &ArchiveLimits::scan()).map_err(told)? {
        let name = name_of(input);
        let source = match folder {
            Some(files) => Source::Folder { files, view: None, zip: OnceLock::new() },
            None => Source::Zip(Arc::new(File::open(input)?)),
        };
        return Ok(vec![view(stem(&name), ViewAngles::of_name(&name), source)]);
    }
    let scan = archive::open_scan_shared(names, &ArchiveLimits::scan(), &ScanRules::default()).map_err(told)?;
    let scan = Arc::new(scan);
    let sources = (0..scan.views().len()).map(|index| -> Result<Source> {
        match &folder {
            Some(files) => {
                let view = Some(scan.view_files(index).map_err(told)?);
                Ok(Source::Folder { files: Arc::clone(files), view, zip: OnceLock::new() })
            }
            None => Ok(Source::Scan { scan: Arc::clone(&scan), index }),
        }
    });
    let named = |of: &ScanView| {
        of.angles().map_or_else(|| stem(of.label.as_deref().unwrap_or(&of.folder)), |angles| angles.file_stem())
    };
    scan.views().iter().zip(sources).map(|(of, source)| Ok(view(named(of), of.angles(), source?))).collect()
}

impl View {
    /// Its slices, opened and checked.
    ///
    /// # Errors
    /// As [`archive::open`]; [`Interrupted::Cancelled`].
    pub(in crate::cli) fn stack(&self, control: &dyn Control) -> Result<StackArchive, Interrupted> {
        let limits = ArchiveLimits::default();
        Ok(match &self.source {
            Source::Zip(zip) => archive::open_shared(Arc::clone(zip) as _, &limits)?,
            Source::Folder { files, view, zip } => {
                archive::open_shared(folder_zip(files, view.as_ref(), zip, control)?, &limits)?
            }
            Source::Scan { scan, index } => scan.open_view(*index)?,
        })
    }

    /// A zip of its slices. A view in the zip of a scan is copied into a file in `scratch` that has no name.
    ///
    /// # Errors
    /// What cannot be read or written; [`JobError::Cancelled`].
    pub(in crate::cli) fn zip(&self, scratch: &Path, control: &dyn Control) -> Result<Arc<dyn ReadAt>, JobError> {
        match &self.source {
            Source::Zip(zip) => Ok(Arc::clone(zip) as _),
            Source::Folder { files, view, zip } => Ok(folder_zip(files, view.as_ref(), zip, control)?),
            Source::Scan { scan, index } => {
                let file = tempfile::tempfile_in(scratch).map_err(super::run::unwritten)?;
                scan.write_view(*index, &file)?;
                Ok(Arc::new(file))
            }
        }
    }

    /// A sentence about it, with the path as it was typed.
    pub(in crate::cli) fn told(&self, detail: &str) -> String {
        words::about(&self.input, self.is_folder, detail)
    }
}

/// The zip of a folder, made once: its pictures are read for it.
fn folder_zip(
    files: &Folder,
    view: Option<&ViewFiles>,
    zip: &OnceLock<Arc<dyn ReadAt>>,
    control: &dyn Control,
) -> Result<Arc<dyn ReadAt>, Interrupted> {
    if let Some(made) = zip.get() {
        return Ok(Arc::clone(made));
    }
    let made = match view {
        Some(view) => files.view(view, control)?,
        None => files.zip(control)?,
    };
    Ok(Arc::clone(zip.get_or_init(|| Arc::new(made))))
}

/// The last name of a path, of a zip without its extension. Of `.` and `..` that of the folder they stand for.
pub(in crate::cli) fn name_of(input: &Path) -> String {
    let real = fs::canonicalize(input).unwrap_or_default();
    let path = if input.file_name().is_some() { input } else { &real };
    let name = if path.is_dir() { path.file_name() } else { path.file_stem() };
    name.map_or_else(|| "stack".to_owned(), |name| name.to_string_lossy().into_owned())
}

/// A name for files: several programs end the name of an image at its first dot or blank.
fn stem(name: &str) -> String {
    let is_bad = |c: char| c.is_whitespace() || c.is_control() || matches!(c, '.' | '/' | '\\' | ':');
    let stem: String = name.chars().map(|c| if is_bad(c) { '_' } else { c }).collect();
    if stem.is_empty() { "stack".to_owned() } else { stem }
}

/// Numbers names that occur again, also those that differ in case only.
fn make_unique(views: &mut [View]) {
    let mut seen = HashSet::new();
    for view in views {
        let (name, mut number) = (view.name.clone(), 2);
        while !seen.insert(view.name.to_lowercase()) {
            view.name = format!("{name}_{number}");
            number += 1;
        }
    }
}
