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

use std::{io, path::Path};

use super::{StoreError, StoreResult, Workspace, folder};

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

#[cfg(test)]
mod tests;
