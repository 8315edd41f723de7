//! The folder of the results.

use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, bail};

use crate::{
    cli::local,
    contract::{
        artifact::{FileFormat, StackArtifact},
        outcome::Artifact,
    },
    jobs::OutputFile,
};
use pinstack_science::types::profile::ProfileInput;

/// The profile of a run, and the report of its calibration.
pub(super) const PROFILE: &str = "profile.json";
pub(super) const REPORT: &str = "profile.html";

/// The folder of the results of a run. It is removed in the end if it is empty.
pub(super) struct Output {
    /// The folder.
    pub folder: PathBuf,
    /// Each stack has a folder of its own in it.
    has_folders: bool,
}

impl Output {
    /// Makes the folder `out`; by default `FOLDER-fused` beside the only input, and `fused` beside the first of
    /// several.
    ///
    /// # Errors
    /// When it has files already and they are not to be replaced, is in one of the `inputs`, or cannot be made.
    pub(super) fn make(
        out: Option<PathBuf>,
        folders: &[PathBuf],
        inputs: &[PathBuf],
        views: usize,
        force: bool,
    ) -> Result<Self> {
        let folder = out.unwrap_or_else(|| by_default(folders));
        let shown = folder.display();
        let has_files = match fs::read_dir(&folder) {
            Ok(mut entries) => entries.next().is_some(),
            Err(error) if error.kind() == io::ErrorKind::NotFound => false,
            Err(error) => return Err(error).with_context(|| format!("cannot use the folder {shown} for results")),
        };
        if has_files && !force {
            bail!("{shown} has files already; give --force to replace the results in it, or another folder with -o");
        }
        fs::create_dir_all(&folder).with_context(|| format!("cannot make the folder {shown}"))?;
        let real = fs::canonicalize(&folder)?;
        let encloses =
            |input: &&PathBuf| input.is_dir() && fs::canonicalize(input).is_ok_and(|input| real.starts_with(input));
        if let Some(input) = inputs.iter().find(encloses) {
            let _ = fs::remove_dir(&folder);
            bail!(
                "{shown} is in {}, so its results would be taken for slices; give another folder with -o",
                input.display()
            );
        }
        Ok(Self { folder, has_folders: views > 1 || folders.len() > 1 })
    }

    /// Runs `work` with an empty scratch folder on the disk of the results, and removes it.
    ///
    /// # Errors
    /// Those of `work`; when the folder cannot be made.
    pub(super) fn in_scratch<T>(&self, work: impl FnOnce(&Path) -> Result<T>) -> Result<T> {
        let scratch = tempfile::Builder::new().prefix(".pinstack-").tempdir_in(&self.folder);
        let scratch = scratch.with_context(|| format!("cannot write into {}", self.folder.display()))?;
        work(scratch.path())
    }

    /// The folder of a stack.
    ///
    /// # Errors
    /// When it cannot be made.
    pub(super) fn folder_of(&self, name: &str) -> Result<PathBuf> {
        let folder = if self.has_folders { self.folder.join(name) } else { self.folder.clone() };
        fs::create_dir_all(&folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        Ok(folder)
    }

    /// Writes the profile of the run.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(super) fn write_profile(&self, profile: &ProfileInput) -> Result<()> {
        self.write(PROFILE, &local::json_of(profile)?)
    }

    /// Writes a document of the run.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(super) fn write(&self, name: &str, text: &str) -> Result<()> {
        write(&self.folder.join(name), text)
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        let _ = fs::remove_dir(&self.folder);
    }
}

/// Writes a document.
///
/// # Errors
/// With its path.
pub(super) fn write(path: &Path, text: &str) -> Result<()> {
    fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}

fn by_default(folders: &[PathBuf]) -> PathBuf {
    let first = folders.first().map_or(Path::new("."), PathBuf::as_path);
    let beside = match (first.file_name(), first.parent()) {
        (Some(_), Some(parent)) => parent.to_owned(),
        _ => first.join(".."),
    };
    match folders {
        [one] => beside.join(format!("{}-fused", local::name_of(one))),
        _ => beside.join("fused"),
    }
}

/// Moves the files of a job into `folder` and returns the name of each. Files of an earlier run are removed, because
/// this one may have others.
///
/// # Errors
/// When a file cannot be moved.
pub(super) fn moved(artifacts: &[Artifact], files: &[OutputFile], folder: &Path) -> Result<BTreeMap<String, String>> {
    for artifact in StackArtifact::ALL {
        for format in [FileFormat::Png, FileFormat::Tiff, FileFormat::Jpeg] {
            let old = folder.join(format!("{}.{}", artifact.name(), format.extension()));
            match fs::remove_file(&old) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => {
                    return Err(error).with_context(|| format!("cannot replace {}", old.display()));
                }
                _ => {}
            }
        }
    }
    let mut names = BTreeMap::new();
    for (artifact, file) in artifacts.iter().zip(files) {
        let name = file.path.file_name().unwrap_or_default();
        let to = folder.join(name);
        fs::rename(&file.path, &to).with_context(|| format!("cannot write {}", to.display()))?;
        names.insert(artifact.name.clone(), name.to_string_lossy().into_owned());
    }
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_beside_what_was_named() {
        let of = |folders: &[&str]| by_default(&folders.iter().map(PathBuf::from).collect::<Vec<_>>());
        assert_eq!(of(&["a/beetle"]), Path::new("a/beetle-fused"));
        assert_eq!(of(&["beetle/"]), Path::new("beetle-fused"));
        assert_eq!(of(&["x/stack.zip"]), Path::new("x/stack-fused"));
        assert_eq!(of(&["a/v1", "a/v2"]), Path::new("a/fused"));
        assert_eq!(of(&["."]).parent(), Some(Path::new("./..")));
    }

    #[test]
    fn files_are_replaced_only_if_that_is_wanted_and_never_within_an_input() {
        let folder = tempfile::tempdir().expect("a folder");
        let input = folder.path().join("beetle");
        fs::create_dir(&input).expect("a folder");
        let inputs = [input.clone()];
        let made = |out: Option<&Path>, force| Output::make(out.map(Path::to_owned), &inputs, &inputs, 1, force);
        let within = made(Some(&input.join("fused")), true).err().expect("refused").to_string();
        assert!(within.contains("would be taken for slices"), "{within}");
        assert!(!input.join("fused").exists());
        let output = made(None, false).expect("made");
        assert_eq!(output.folder, folder.path().join("beetle-fused"));
        output.write("summary.txt", "").expect("written");
        assert!(made(None, false).err().expect("refused").to_string().contains("--force"));
        assert!(made(None, true).is_ok());
        let empty = folder.path().join("empty");
        drop(made(Some(&empty), false).expect("made"));
        assert!(!empty.exists());
        output.in_scratch(|scratch| Ok(fs::write(scratch.join("x"), "")?)).expect("written");
        assert_eq!(fs::read_dir(&output.folder).expect("read").count(), 1);
    }
}
