//! Blobs and upload parts as files in a data folder.
//!
//! ```text
//! {data_dir}/blobs/{key}          blobs
//! {data_dir}/partial/{id}.part    bytes of a resumable upload
//! {data_dir}/partial/{id}.lock    its lock
//! {data_dir}/spool/{uuid}/        the workspace of one process
//! ```
//!
//! All of them must be on one file system, because storing a blob is a rename.

mod blobs;
mod parts;
mod probe;

pub use blobs::LocalBlobStore;
pub use parts::LocalUploadParts;

use std::{fs, io, path::Path};

use anyhow::Context;

use super::{StoreError, StoreResult, Workspace, failpoint::step, folder};

/// Opens the stores below `data_dir` and a workspace for this process. Missing folders are created.
///
/// # Errors
/// When the folders cannot be created or written, or are not on one file system.
pub fn open(data_dir: &Path) -> StoreResult<(LocalBlobStore, LocalUploadParts, Workspace)> {
    let opened = open_folders(data_dir);
    opened.map_err(|error| StoreError::of_io(error, format!("cannot use the folder {}", data_dir.display())))
}

fn open_folders(data_dir: &Path) -> io::Result<(LocalBlobStore, LocalUploadParts, Workspace)> {
    folder::make(data_dir)?;
    let parts = LocalUploadParts::open(data_dir)?;
    let root = LocalBlobStore::make_folders(data_dir)?;
    folder::sync_folder(data_dir)?;
    let workspace = Workspace::open(data_dir)?;
    let blobs = LocalBlobStore::open(root, &workspace, parts.folder())?;
    Ok((blobs, parts, workspace))
}

/// Creates a private folder.
fn make_private(folder: &Path) -> io::Result<()> {
    step("open.folders")?;
    fs::create_dir_all(folder)?;
    folder::keep_private(folder, folder::FOLDER)
}

/// Removes a file, or a folder with its content, if it exists.
pub(super) fn remove(path: &Path) -> io::Result<()> {
    step("remove")?;
    let removed = match fs::symlink_metadata(path) {
        Ok(metadata) if metadata.is_dir() => fs::remove_dir_all(path),
        Ok(_) => fs::remove_file(path),
        Err(error) => Err(error),
    };
    match removed {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        other => other,
    }
}

/// Runs blocking file work off the async threads.
pub(super) async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> StoreResult<T> + Send + 'static,
) -> StoreResult<T> {
    tokio::task::spawn_blocking(work).await.context("a file task panicked")?
}

#[cfg(test)]
mod tests;
