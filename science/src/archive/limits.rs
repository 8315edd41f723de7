//! How large an archive may be: what a zip is checked against before memory is allocated.

use crate::imaging::codec;

/// Limits of an archive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ArchiveLimits {
    /// Maximum number of members of any kind.
    pub max_members: usize,
    /// Maximum uncompressed size of one member, bytes.
    pub max_member_bytes: u64,
    /// Maximum uncompressed size of all pictures together, bytes.
    pub max_total_bytes: u64,
    /// Maximum number of bytes read to parse the directory. 1 MiB plus 2 KiB per member is the limit where it is lower.
    pub max_directory_bytes: u64,
    /// Limits of one picture.
    pub image: codec::Limits,
}

impl ArchiveLimits {
    /// The limits of a zip that holds a whole scan: 100,000 members, and no limit on their sum but that of the upload.
    /// The directory takes about 1 KiB of memory per member. Each view has the limits of a stack when it is opened.
    pub fn scan() -> Self {
        Self { max_members: 100_000, max_total_bytes: u64::MAX, ..Self::default() }
    }
}

impl Default for ArchiveLimits {
    fn default() -> Self {
        Self {
            max_members: 2_500,
            max_member_bytes: 1 << 30,
            max_total_bytes: 64 << 30,
            max_directory_bytes: 64 << 20,
            image: codec::Limits::default(),
        }
    }
}
