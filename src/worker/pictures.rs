//! Places the pictures of a reconstruction in a folder, where COLMAP reads them.

use std::{fs, io, path::Path};

use super::ending::{Stopped, internal};
use crate::{
    contract::{Code, Fault, reconstruction::ReconstructionRequest},
    store::{Store, StoreError, blobs::LocalBlob},
};

/// Places every image and mask of a reconstruction below `folder`. A file of this machine is linked, not copied.
///
/// # Errors
/// [`Code::UploadRemoved`] when a stack was deleted since the reconstruction was accepted; the errors of the storage.
pub(super) async fn place_pictures(
    store: &Store,
    request: &ReconstructionRequest,
    folder: &Path,
) -> Result<(), Stopped> {
    match place(store, request, folder).await.map_err(internal)? {
        None => Ok(()),
        Some(missing) => Err(missing.into()),
    }
}

/// The same; what is missing is the result.
///
/// # Errors
/// When the storage cannot be read, or the folder not be written.
pub async fn place(store: &Store, request: &ReconstructionRequest, folder: &Path) -> Result<Option<Fault>, StoreError> {
    let cannot = |error: io::Error| StoreError::of_io(error, "cannot place the pictures of a reconstruction".into());
    for folder in [folder.join("images"), folder.join("masks")] {
        fs::create_dir_all(folder).map_err(cannot)?;
    }
    for (path, picture) in request.pictures() {
        let Some(found) = store.blobs.fetch(&picture.key, &store.workspace).await? else {
            let detail = format!(
                "the picture {path} is not stored any more: its stack was deleted since the reconstruction was accepted; \
                 start the reconstruction again"
            );
            return Ok(Some(Fault::new(Code::UploadRemoved, detail)));
        };
        let to = folder.join(path);
        let placed = tokio::task::spawn_blocking(move || place_one(&found, &to)).await;
        placed.map_err(|error| StoreError::Other(error.into()))?.map_err(cannot)?;
    }
    Ok(None)
}

fn place_one(found: &LocalBlob, to: &Path) -> io::Result<()> {
    match fs::hard_link(found.path(), to) {
        Ok(()) => Ok(()),
        // another file system, or one without links
        Err(_) => fs::copy(found.path(), to).map(|_| ()),
    }
}
