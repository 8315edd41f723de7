//! COLMAP on this machine: where it is, and what a run may use.

use std::{
    env, fs,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
    time::Duration,
};

use super::need;
use crate::contract::reconstruction::ReconstructionRequest;

/// Name of the program in `PATH`.
const NAME: &str = "colmap";

/// How to install it, for people.
pub const INSTALL: &str = "install it (Debian and Ubuntu: apt-get install colmap; macOS: brew install colmap), or give its path in the setting \
     'colmap', and start the server again";

/// COLMAP, and the limits of its runs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Colmap {
    /// Path of the program.
    pub program: PathBuf,
    /// The command that makes a mesh, with its arguments; empty: none.
    pub mesh_command: Vec<String>,
    /// Longest time of one reconstruction.
    pub most_time: Duration,
    /// Most memory that it may use, bytes.
    pub most_memory: u64,
}

impl Colmap {
    /// Bytes that a reconstruction writes at most, without the pictures.
    pub fn disk_need(&self, request: &ReconstructionRequest) -> u64 {
        let mesh = if self.mesh_command.is_empty() { 0 } else { need::mesh_disk(request) };
        need::disk(request).saturating_add(mesh)
    }
}

/// The program: that of the setting, or else the first one in `PATH`. `None` when there is no such file, or it is not
/// executable.
pub fn find(setting: Option<&Path>) -> Option<PathBuf> {
    match setting {
        Some(path) => Some(path.to_owned()).filter(|path| is_program(path)),
        None => in_path(NAME),
    }
}

/// The first program of this name in `PATH`.
pub(super) fn in_path(name: &str) -> Option<PathBuf> {
    let folders = env::var_os("PATH")?;
    env::split_paths(&folders).map(|folder| folder.join(name)).find(|path| is_program(path))
}

/// Whether a file is there and executable.
pub fn is_program(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|file| file.is_file() && file.permissions().mode() & 0o111 != 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_an_executable_file_is_a_program() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("colmap");
        assert_eq!(find(Some(&file)), None);
        fs::write(&file, "#!/bin/sh\n").expect("a file");
        assert_eq!(find(Some(&file)), None);
        fs::set_permissions(&file, fs::Permissions::from_mode(0o755)).expect("a mode");
        assert_eq!(find(Some(&file)), Some(file));
        assert_eq!(find(Some(folder.path())), None);
    }
}
