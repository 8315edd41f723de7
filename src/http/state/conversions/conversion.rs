//! What a stored picture is converted to, and the file that results.

use std::{path::Path, sync::Arc};

use tempfile::NamedTempFile;

use crate::{
    contract::{
        Fault,
        artifact::{Colours, FileFormat},
        options::StackOptions,
    },
    jobs::SliceLight,
};
use pinstack_science::types::profile::ProfileInput;

/// A converted file, removed when the last reference is dropped.
#[derive(Debug)]
pub struct Converted {
    pub(super) file: NamedTempFile,
    /// Key of the stored picture.
    pub(super) source: String,
    /// Its size, bytes.
    pub length: u64,
}

impl Converted {
    /// Its path.
    pub fn path(&self) -> &Path {
        self.file.path()
    }
}

/// What a stored picture is converted to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Form {
    /// A file of another format.
    File(FileFormat),
    /// All resolutions, for a viewer.
    Pyramid(Colours),
    /// The same of the slice of this light with this index in the order of fusion.
    Slice(SliceLight, usize),
}

/// What a slice of a stack is warped with.
#[derive(Debug)]
pub struct SliceRecipe {
    /// The revision of the profile that the stack was fused with.
    pub profile: ProfileInput,
    /// The options of the stack.
    pub options: StackOptions,
    /// The light of the slice, and its index in the order of fusion.
    pub slice: (SliceLight, usize),
}

/// How a file is made.
#[derive(Debug, Clone)]
pub enum Conversion {
    /// The stored picture in another format.
    File(FileFormat),
    /// The pyramid of the stored picture.
    Pyramid(Colours),
    /// The pyramid of a slice in the stored zip.
    Slice(Arc<SliceRecipe>),
}

impl Conversion {
    pub(super) fn form(&self) -> Form {
        match self {
            Self::File(format) => Form::File(*format),
            Self::Pyramid(colours) => Form::Pyramid(*colours),
            Self::Slice(recipe) => Form::Slice(recipe.slice.0, recipe.slice.1),
        }
    }
}

/// The result of a conversion. A fault is reported to all waiting requests.
pub(super) type Outcome = Result<Arc<Converted>, Fault>;
