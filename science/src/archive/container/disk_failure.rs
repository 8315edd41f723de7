//! The first I/O error of the disk. Libraries wrap such errors so that they look like a damaged zip.

use std::{
    io,
    sync::{Arc, OnceLock},
};

use crate::types::{Error, ErrorKind};

/// What is said of that error, if there was one. All clones share it, and it stays: a thread that succeeds must not
/// hide it from the one that failed.
#[derive(Clone, Default)]
pub(super) struct DiskFailure(Arc<OnceLock<Error>>);

impl DiskFailure {
    /// Keeps the first failure. An interrupted read is none: it is repeated.
    pub(super) fn note(&self, error: &io::Error) {
        if error.kind() != io::ErrorKind::Interrupted {
            let of_system = || error.raw_os_error().map_or_else(|| error.kind().into(), io::Error::from_raw_os_error);
            let _ = self.0.set(told(error).unwrap_or_else(|| unreadable(of_system())));
        }
    }

    /// Replaces the error of `result` when the disk has failed before: that may be the cause.
    pub(super) fn explain<T>(&self, result: Result<T, Error>) -> Result<T, Error> {
        result.map_err(|fault| self.0.get().cloned().unwrap_or(fault))
    }
}

/// What the reader itself says about its error: a [`folder`](crate::archive::folder) names the file.
fn told(error: &io::Error) -> Option<Error> {
    error.get_ref()?.downcast_ref::<Error>().cloned()
}

/// An I/O error of the server, not of the archive.
pub(super) fn unreadable(error: io::Error) -> Error {
    if let Some(told) = told(&error) {
        return told;
    }
    let detail = format!(
        "the server cannot read the upload from its disk ({error}); this is no fault of the archive: try again in a moment"
    );
    Error::new(ErrorKind::ResourcesExhausted, detail).caused_by(error)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_of_the_disk_explains_what_fails_after_it_even_if_something_else_succeeded_meanwhile() {
        let damaged = || Err::<(), _>(Error::new(ErrorKind::InvalidArchive, "the picture is damaged"));
        let failure = DiskFailure::default();
        assert_eq!(failure.explain(damaged()).unwrap_err().kind, ErrorKind::InvalidArchive);
        failure.note(&io::ErrorKind::Interrupted.into());
        assert_eq!(failure.explain(damaged()).unwrap_err().kind, ErrorKind::InvalidArchive);
        failure.clone().note(&io::Error::from_raw_os_error(5));
        assert!(failure.explain(Ok(())).is_ok());
        assert_eq!(failure.explain(damaged()).unwrap_err().kind, ErrorKind::ResourcesExhausted);
    }

    #[test]
    fn what_the_reader_says_about_its_error_is_kept() {
        let changed = Error::new(ErrorKind::InvalidArchive, "a.png was changed");
        let failure = DiskFailure::default();
        failure.note(&io::Error::other(changed.clone()));
        let damaged = Err::<(), _>(Error::new(ErrorKind::InvalidArchive, "the picture is damaged"));
        assert_eq!(failure.explain(damaged), Err(changed.clone()));
        assert_eq!(unreadable(io::Error::other(changed.clone())), changed);
    }
}
