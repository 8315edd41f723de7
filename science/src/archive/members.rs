//! Members of a zip, and the roles they have in a stack.

use super::light::Light;

/// A file in the zip.
#[derive(Debug, Clone)]
pub(super) struct Member {
    /// Position in the directory of the zip.
    pub index: usize,
    /// Name with `/` between folders, as shown to users.
    pub name: String,
    /// Declared uncompressed size, bytes.
    pub size: u64,
    /// The encoding of the name is unknown: it is not UTF-8, and unlikely to be code page 437.
    pub unclear_name: bool,
}

impl Member {
    /// The folders of the name; empty for the root.
    pub(super) fn folder(&self) -> &str {
        self.name.rsplit_once('/').map_or("", |(folder, _)| folder)
    }
}

/// A member that is a picture.
pub(super) struct Picture {
    /// The member.
    pub member: Member,
    /// Its name without the folders that enclose all pictures.
    pub inner: String,
}

impl Picture {
    /// The light that the first folder stands for, and the name within that folder.
    pub(super) fn in_light_folder(&self) -> Option<(Light, &str)> {
        let (folder, rest) = self.inner.split_once('/')?;
        Some((Light::of_folder(folder)?, rest))
    }
}

/// The slices of all lights and of the moved target, in order.
pub(super) struct SortedSlices {
    /// Front-light slices.
    pub front: Vec<Member>,
    /// Back-light slices.
    pub back: Vec<Member>,
    /// Slices of further lights, by name.
    pub lights: Vec<(String, Vec<Member>)>,
    /// Slices of the moved target.
    pub moved: Vec<Member>,
    /// `manifest.json` gives the order.
    pub is_listed: bool,
}
