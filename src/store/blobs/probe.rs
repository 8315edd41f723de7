//! Whether a file can be written and moved into place: what every upload and every result needs. `blobs` may be a link or a
//! mount that lies on another file system, where nothing can be moved to.

use std::{fs, io, os::unix::fs::MetadataExt, path::Path};

/// Name of the probe in the folder that it is moved to; no blob has such a name.
const NAME: &str = "probe";

/// Writes a file into the spool folder and moves it into each of `to`.
///
/// # Errors
/// When it cannot be written or not be moved; the message says which and what to do.
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
            // another process looked at the same moment
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            other => other?,
        }
    }
    Ok(())
}

/// Whether these folders lie on one file system.
///
/// # Errors
/// When they do not, with what to do; when they cannot be looked at.
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
        "{} lies on another file system than {}, so no file can be moved there; put the whole data folder on one file \
         system, and make the data folder itself the link or the mount",
        to.display(),
        from.display()
    );
    io::Error::new(io::ErrorKind::CrossesDevices, why)
}
