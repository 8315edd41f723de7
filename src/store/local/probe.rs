//! Checks that a file can be written and renamed into place, as for every upload and every result. `blobs` may be a
//! link or a mount on another file system, where a rename fails.

use std::{fs, io, os::unix::fs::MetadataExt, path::Path};

/// Name of the probe in the target folder; no blob has such a name.
const NAME: &str = "probe";

/// Writes a file into the workspace and renames it into each of `to`.
pub(super) fn probe(spool: &Path, to: &[&Path]) -> io::Result<()> {
    for to in to {
        let (file, moved) = (spool.join(format!("{NAME}-{}", uuid::Uuid::now_v7())), to.join(NAME));
        let renamed = fs::write(&file, b"ready?").and_then(|()| fs::rename(&file, &moved));
        let removed = fs::remove_file(if renamed.is_ok() { &moved } else { &file });
        renamed.map_err(|error| match error.kind() {
            io::ErrorKind::CrossesDevices => elsewhere(spool, to),
            _ => error,
        })?;
        match removed {
            // another process probed at the same time
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            other => other?,
        }
    }
    Ok(())
}

/// Requires that these folders are on one file system.
///
/// # Errors
/// When they are not, with what to do; when they cannot be queried.
pub(super) fn same_file_system(first: &Path, others: &[&Path]) -> io::Result<()> {
    let device = fs::metadata(first)?.dev();
    for other in others {
        if fs::metadata(other)?.dev() != device {
            return Err(elsewhere(first, other));
        }
    }
    Ok(())
}

fn elsewhere(from: &Path, to: &Path) -> io::Error {
    let why = format!(
        "{} is on another file system than {}, so files cannot be renamed into it; keep the data folder on one file system: \
         make the data folder itself the link or the mount",
        to.display(),
        from.display()
    );
    io::Error::new(io::ErrorKind::CrossesDevices, why)
}
