//! A file of a folder: how it is opened, and how a change of it is noticed.

use std::{
    fs::{self, File, Metadata},
    io::{self, Read},
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
};

use crate::types::{Error, ErrorKind};

/// Bytes that are read at a time for a checksum.
const STEP: usize = 1 << 20;

/// A file, as it was when its folder was listed.
#[derive(Debug, Clone)]
pub(super) struct FolderFile {
    /// Path from the folder, with `/` between names.
    pub name: String,
    /// The path of the folder as it was given, and the name.
    pub path: PathBuf,
    pub stamp: Stamp,
}

/// Size and time of change: what shows that a file is still the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stamp {
    pub bytes: u64,
    changed: (i64, i64),
}

impl Stamp {
    pub(super) fn of(metadata: &Metadata) -> Self {
        Self { bytes: metadata.len(), changed: (metadata.mtime(), metadata.mtime_nsec()) }
    }
}

impl FolderFile {
    /// Opens the file, if it is still the one that was listed.
    pub(super) fn open(&self) -> Result<File, Error> {
        let file = File::open(&self.path).map_err(|error| unreadable(&self.path, &error))?;
        self.require_unchanged(&file)?;
        Ok(file)
    }

    /// # Errors
    /// [`ErrorKind::InvalidArchive`] for a file of another size or time of change than when it was listed.
    pub(super) fn require_unchanged(&self, file: &File) -> Result<(), Error> {
        let metadata = file.metadata().map_err(|error| unreadable(&self.path, &error))?;
        if Stamp::of(&metadata) == self.stamp { Ok(()) } else { Err(self.changed()) }
    }

    /// The error for a file that was changed.
    pub(super) fn changed(&self) -> Error {
        let detail = format!(
            "{} was changed while it was read; wait until all pictures are there, then try again",
            self.path.display()
        );
        Error::new(ErrorKind::InvalidArchive, detail).in_file(&self.name, None)
    }

    /// The checksum of the whole file.
    pub(super) fn crc32(&self) -> Result<u32, Error> {
        let mut file = self.open()?;
        let (mut hash, mut buffer) = (crc32fast::Hasher::new(), vec![0; STEP]);
        let mut read = 0;
        loop {
            match file.read(&mut buffer).map_err(|error| unreadable(&self.path, &error))? {
                0 => break,
                more => {
                    hash.update(&buffer[..more]);
                    read += more as u64;
                }
            }
        }
        self.require_unchanged(&file)?;
        if read == self.stamp.bytes { Ok(hash.finalize()) } else { Err(self.changed()) }
    }
}

/// The error for a path that cannot be read.
pub(super) fn unreadable(path: &Path, error: &io::Error) -> Error {
    let shown = path.display();
    let is_link = fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_symlink());
    let what = if is_link { format!("the target of the link {shown}") } else { shown.to_string() };
    Error::new(ErrorKind::Io, format!("cannot read {what} ({error}); check the path and its permissions"))
}
