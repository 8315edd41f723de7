//! Files that hold the bytes of a blob: a blob as it is read, and a file that is to become one.

use std::{
    fs::File,
    path::{Path, PathBuf},
    sync::Arc,
};

use pinstack_science::types::ReadAt;
use tempfile::TempPath;

use super::{StoreError, StoreResult, folder::blocking, ranges::Ranges};

#[derive(Debug)]
enum Place {
    /// Removed when dropped.
    Temporary(TempPath),
    /// Kept when dropped: its owner removes it.
    Persistent(PathBuf),
}

impl Place {
    fn path(&self) -> &Path {
        match self {
            Self::Temporary(path) => path,
            Self::Persistent(path) => path,
        }
    }
}

/// A local file with the bytes of a blob, valid while this is held. It must not be changed.
#[derive(Debug)]
pub struct LocalBlob(Place);

impl LocalBlob {
    /// The blob itself.
    pub fn in_place(path: PathBuf) -> Self {
        Self(Place::Persistent(path))
    }

    /// A copy that is removed when this is dropped.
    pub fn copy(path: TempPath) -> Self {
        Self(Place::Temporary(path))
    }

    /// The path of the file.
    pub fn path(&self) -> &Path {
        self.0.path()
    }

    /// Opens it for code that seeks.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub async fn open(&self) -> StoreResult<File> {
        open(self.path()).await
    }
}

/// A blob whose bytes can be read by offset while this is held.
#[derive(Debug)]
pub struct OpenBlob {
    bytes: Arc<dyn ReadAt>,
    /// Of a blob on another machine.
    ranges: Option<Arc<Ranges>>,
}

impl OpenBlob {
    /// A file with all bytes.
    pub fn of_file(file: File) -> Self {
        Self { bytes: Arc::new(file), ranges: None }
    }

    pub(super) fn of_ranges(ranges: Ranges) -> Self {
        let ranges = Arc::new(ranges);
        Self { bytes: Arc::clone(&ranges) as Arc<dyn ReadAt>, ranges: Some(ranges) }
    }

    /// The bytes. Reading them may wait for another machine, so it belongs on a thread that may block.
    pub fn bytes(&self) -> Arc<dyn ReadAt> {
        Arc::clone(&self.bytes)
    }

    /// Why bytes could not be read, if the storage is to blame. Tells it once.
    pub fn failure(&self) -> Option<StoreError> {
        self.ranges.as_ref().and_then(|ranges| ranges.failure())
    }
}

/// A complete local file that is to become a blob ([`BlobStore::put`](super::BlobStore::put)).
#[derive(Debug)]
pub struct SpoolFile {
    place: Place,
    /// Key of a blob with the same bytes.
    origin: Option<String>,
}

impl SpoolFile {
    /// A file that is removed when this is dropped, unless it has become a blob.
    pub fn temporary(path: TempPath) -> Self {
        Self { place: Place::Temporary(path), origin: None }
    }

    /// A temporary file with the bytes of the blob `origin`, which need not be sent again if the store can copy.
    pub fn copy_of(path: TempPath, origin: &str) -> Self {
        Self { place: Place::Temporary(path), origin: Some(origin.to_owned()) }
    }

    /// A file that stays when this is dropped, unless it has become a blob: the parts of an upload, a file in the
    /// scratch folder of a job.
    pub fn persistent(path: PathBuf) -> Self {
        Self { place: Place::Persistent(path), origin: None }
    }

    /// The path of the file.
    pub fn path(&self) -> &Path {
        self.place.path()
    }

    /// Opens it for code that seeks.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub async fn open(&self) -> StoreResult<OpenBlob> {
        open(self.path()).await.map(OpenBlob::of_file)
    }

    /// Key of a blob with the same bytes, if it was made from one. The blob may have been removed since.
    pub fn origin(&self) -> Option<&str> {
        self.origin.as_deref()
    }
}

async fn open(path: &Path) -> StoreResult<File> {
    let path = path.to_owned();
    blocking(move || File::open(path).map_err(|error| StoreError::of_io(error, "cannot open an upload".into()))).await
}
