//! Folders and files of a store: durable, and private to the account that the service runs under. Work on them runs on
//! threads that may block.

use std::{
    fs::{self, DirBuilder, File, Permissions},
    io,
    os::unix::fs::{DirBuilderExt, PermissionsExt},
    path::Path,
};

use anyhow::Context;

use super::{StoreResult, failpoint::step};

/// Name of the database of a store.
pub const DATABASE: &str = "pinstack.sqlite";

/// Mode of a folder of a store.
pub const FOLDER: u32 = 0o700;
/// Mode of a file of a store.
pub const FILE: u32 = 0o600;

/// Creates a folder and its missing parents, durably. An existing folder is made private if it is a store or empty. A
/// folder with other content keeps its mode, because it may be shared with others.
///
/// # Errors
/// When it cannot be created.
pub fn make(folder: &Path) -> io::Result<()> {
    let missing: Vec<&Path> =
        folder.ancestors().take_while(|part| !part.as_os_str().is_empty() && !part.exists()).collect();
    if missing.is_empty() {
        let is_ours = folder.join(DATABASE).exists() || fs::read_dir(folder)?.next().is_none();
        return if is_ours { keep_private(folder, FOLDER) } else { Ok(()) };
    }
    step("open.folders")?;
    DirBuilder::new().recursive(true).mode(FOLDER).create(folder)?;
    for made in missing {
        match made.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => sync_folder(parent)?,
            _ => sync_folder(Path::new("."))?,
        }
    }
    Ok(())
}

/// Makes the names in a folder durable.
pub(super) fn sync_folder(folder: &Path) -> io::Result<()> {
    step("folder.sync")?;
    File::open(folder)?.sync_all()
}

/// Removes the permissions that `mode` does not allow. A missing file is ignored. The mode of a file of another account
/// cannot be changed; a warning is logged then.
///
/// # Errors
/// When the mode cannot be read or set.
pub fn keep_private(path: &Path, mode: u32) -> io::Result<()> {
    let now = match fs::metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        other => other?.permissions().mode() & 0o777,
    };
    if now & !mode == 0 {
        return Ok(());
    }
    match fs::set_permissions(path, Permissions::from_mode(now & mode)) {
        Err(error) if error.kind() == io::ErrorKind::PermissionDenied => {
            let path = path.display();
            let mode = format!("{now:o}");
            tracing::warn!(%path, mode, "other accounts may read the data, and the mode cannot be changed");
            Ok(())
        }
        other => other,
    }
}

/// Creates a private folder.
pub(super) fn make_private(folder: &Path) -> io::Result<()> {
    step("open.folders")?;
    fs::create_dir_all(folder)?;
    keep_private(folder, FOLDER)
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
mod tests {
    use super::*;

    fn mode(path: &Path) -> u32 {
        fs::metadata(path).expect("it is there").permissions().mode() & 0o777
    }

    #[test]
    fn a_store_is_private_and_a_folder_with_other_content_keeps_its_mode() {
        let outer = tempfile::tempdir().expect("a folder");
        let new = outer.path().join("a/b");
        make(&new).expect("made");
        assert_eq!((mode(&new), mode(&outer.path().join("a"))), (0o700, 0o700));

        let (store, shared) = (outer.path().join("store"), outer.path().join("shared"));
        for (folder, file) in [(&store, DATABASE), (&shared, "thesis.tex")] {
            fs::create_dir(folder).expect("made");
            fs::write(folder.join(file), "x").expect("written");
            fs::set_permissions(folder, Permissions::from_mode(0o755)).expect("set");
            make(folder).expect("there already");
        }
        assert_eq!((mode(&store), mode(&shared)), (0o700, 0o755));
    }
}
