//! A folder as a zip, without copying it: what reads archives reads folders too, with the same checks, orders and
//! sentences.
//!
//! In: the path of a folder, as the person gave it. Out: a [`FolderZip`] for [`open_shared`](super::open_shared), or of
//! each view of a [`ScanArchive`](super::ScanArchive). Its headers are made in memory; the bytes of members are those
//! of the files, read by offset. Every picture is read once beforehand, for its CRC-32. A file that changes afterwards
//! is an error that names it.
//!
//! Links are followed. Folders and files that systems add are skipped, as in a zip. Names that are not UTF-8 have
//! replacement characters.

mod file;
mod virtual_zip;

use std::{
    fs,
    os::unix::fs::MetadataExt,
    path::Path,
    sync::atomic::{AtomicUsize, Ordering},
};

use rayon::prelude::*;

use super::{
    ArchiveLimits, member_names,
    scan::{MANIFEST, ViewFiles},
};
use crate::{
    imaging::codec,
    types::{Control, Error, ErrorKind, Interrupted},
};

pub use virtual_zip::FolderZip;

use file::{FolderFile, Stamp, unreadable};
use virtual_zip::{Member, Source};

/// Folders within folders, at most.
const DEEPEST: usize = 64;

/// The files of a folder and of the folders in it.
#[derive(Debug, Clone)]
pub struct Folder {
    files: Vec<FolderFile>,
}

impl Folder {
    /// Lists the files of the folder at `path`. No file is opened.
    ///
    /// # Example
    /// ```
    /// use std::sync::Arc;
    ///
    /// use pinstack_science::{archive::{self, ArchiveLimits, folder::Folder}, synth::{Light, Rig, Scene, Stage}};
    /// use pinstack_science::{imaging::codec, types::NoControl};
    ///
    /// let (folder, stage) = (tempfile::tempdir()?, Stage::new(&Rig::sized(96, 64, 3), &Scene::plates(1)));
    /// for slice in 0..3 {
    ///     let jpeg = codec::encode_jpeg(&stage.render(Light::Front, slice), 90);
    ///     std::fs::write(folder.path().join(format!("{slice}.jpg")), jpeg)?;
    /// }
    /// let zip = Folder::list(folder.path())?.zip(&NoControl)?;
    /// let stack = archive::open_shared(Arc::new(zip), &ArchiveLimits::default())?;
    /// assert_eq!(stack.layout().front, ["0.jpg", "1.jpg", "2.jpg"]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Io`] with the path when a folder or the target of a link cannot be read;
    /// [`ErrorKind::ArchiveTooLarge`] for more files than a scan may have, or folders that are nested too deep;
    /// [`ErrorKind::InvalidArchive`] for an empty folder, and for a link to a folder that encloses it.
    pub fn list(path: &Path) -> Result<Self, Error> {
        let mut folder = Self { files: Vec::new() };
        folder.add(path, "", &mut Vec::new())?;
        folder.files.sort_by(|a, b| a.name.cmp(&b.name));
        match folder.files.is_empty() {
            true => Err(Error::new(ErrorKind::InvalidArchive, format!("{} is empty; add the slices", path.display()))),
            false => Ok(folder),
        }
    }

    /// The front light in one folder and the back light in another, as `front/` and `back/` of one folder.
    #[must_use]
    pub fn of_lights(front: Self, back: Self) -> Self {
        let within = |light: &str, folder: Self| {
            let prefix = format!("{light}/");
            folder.files.into_iter().map(move |file| FolderFile { name: format!("{prefix}{}", file.name), ..file })
        };
        Self { files: within("back", back).chain(within("front", front)).collect() }
    }

    fn add(&mut self, folder: &Path, prefix: &str, within: &mut Vec<(u64, u64)>) -> Result<(), Error> {
        let metadata = fs::metadata(folder).map_err(|error| unreadable(folder, &error))?;
        let place = (metadata.dev(), metadata.ino());
        if within.contains(&place) {
            let detail = format!("{} leads back to a folder that encloses it; remove this link", folder.display());
            return Err(Error::new(ErrorKind::InvalidArchive, detail));
        }
        if within.len() >= DEEPEST {
            let detail =
                format!("{} is more than {DEEPEST} folders deep; choose a folder of pictures", folder.display());
            return Err(Error::new(ErrorKind::ArchiveTooLarge, detail));
        }
        within.push(place);
        for entry in fs::read_dir(folder).map_err(|error| unreadable(folder, &error))? {
            let entry = entry.map_err(|error| unreadable(folder, &error))?;
            let (name, path) = (format!("{prefix}{}", entry.file_name().to_string_lossy()), entry.path());
            // of a folder it decides whatever is in it
            if matches!(member_names::label(&name), Ok(None))
                || matches!(member_names::label(&format!("{name}/x")), Ok(None))
            {
                continue;
            }
            let metadata = fs::metadata(&path).map_err(|error| unreadable(&path, &error))?;
            if metadata.is_dir() {
                self.add(&path, &format!("{name}/"), within)?;
            } else if metadata.is_file() {
                self.files.push(FolderFile { name, path, stamp: Stamp::of(&metadata) });
            }
            let most = ArchiveLimits::scan().max_members;
            if self.files.len() > most {
                let detail = format!(
                    "{} and the folders in it have more than {most} files; choose a folder of pictures",
                    folder.display()
                );
                return Err(Error::new(ErrorKind::ArchiveTooLarge, detail));
            }
        }
        within.pop();
        Ok(())
    }

    /// A zip whose directory can be read, and whose members cannot: for what looks at names alone.
    pub fn names(&self) -> FolderZip {
        FolderZip::new(self.files.iter().map(|file| member(file, &file.name, 0)).collect())
    }

    /// The folder as a zip. Progress: `reading`, by pictures.
    ///
    /// # Errors
    /// [`ErrorKind::Io`] with the path of a picture that cannot be read; [`ErrorKind::InvalidArchive`] for one that
    /// was changed meanwhile.
    pub fn zip(&self, control: &dyn Control) -> Result<FolderZip, Interrupted> {
        let all: Vec<_> = self.files.iter().map(|file| (file.name.clone(), file)).collect();
        Ok(FolderZip::new(with_checksums(&all, control)?))
    }

    /// The zip of a view of the scan that this folder is.
    ///
    /// # Errors
    /// As [`Folder::zip`]; [`ErrorKind::Internal`] for a view of another scan.
    pub fn view(&self, view: &ViewFiles, control: &dyn Control) -> Result<FolderZip, Interrupted> {
        let file = |(name, at): &(String, usize)| {
            let missing = || Error::new(ErrorKind::Internal, format!("the folder has no file of number {at}"));
            Ok((name.clone(), self.files.get(*at).ok_or_else(missing)?))
        };
        let files = view.members.iter().map(file).collect::<Result<Vec<_>, Error>>()?;
        let mut members = with_checksums(&files, control)?;
        members.extend(view.manifest.clone().map(|text| Member {
            name: MANIFEST.to_owned(),
            crc32: crc32fast::hash(&text),
            source: Source::Bytes(text),
        }));
        Ok(FolderZip::new(members))
    }
}

fn member(file: &FolderFile, name: &str, crc32: u32) -> Member {
    Member { name: name.to_owned(), crc32, source: Source::File(file.clone()) }
}

/// Members with the checksums of what is read of a stack: its pictures, and the list of its slices.
fn with_checksums(files: &[(String, &FolderFile)], control: &dyn Control) -> Result<Vec<Member>, Interrupted> {
    let done = AtomicUsize::new(0);
    control.progress("reading", 0, files.len());
    files
        .par_iter()
        .map(|(name, file)| {
            control.check()?;
            let is_read = codec::is_picture_name(name) || member_names::base(name) == MANIFEST;
            let crc32 = if is_read { file.crc32()? } else { 0 };
            control.progress("reading", done.fetch_add(1, Ordering::Relaxed) + 1, files.len());
            Ok(member(file, name, crc32))
        })
        .collect()
}

#[cfg(test)]
mod tests;
