//! Parts of the sentences that an archive is refused with.

use super::light::Light;
use crate::types::{Error, ErrorKind};

/// An [`ErrorKind::InvalidArchive`] error about one file.
pub(super) fn invalid(name: &str, detail: impl Into<String>) -> Error {
    Error::new(ErrorKind::InvalidArchive, detail).in_file(name, None)
}

/// Names for a sentence: the first five, and the number of the others.
pub(super) fn listed<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    const SHOWN: usize = 5;
    let names: Vec<&str> = names.into_iter().collect();
    let shown = names.iter().take(SHOWN).copied().collect::<Vec<_>>().join(", ");
    match names.len() {
        n if n > SHOWN => format!("{shown} and {} more", n - SHOWN),
        _ => shown,
    }
}

/// The word for one thing or that for several.
pub(super) fn one_or_more<'a>(count: usize, one: &'a str, more: &'a str) -> &'a str {
    if count == 1 { one } else { more }
}

/// A number of slices in words: `1 back-light slice`, `3 back-light slices`.
pub(super) fn slices_of(count: usize, light: Light) -> String {
    format!("{count} {} {}", light.word(), one_or_more(count, "slice", "slices"))
}
