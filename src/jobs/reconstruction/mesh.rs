//! The mesh that an outside program makes of the model and the images.
//!
//! In: the command of the setting `mesh_command`, with placeholders for folders and files. Out: a PLY or GLB with
//! faces. Whatever is wrong with the command becomes a finding: the rest of the reconstruction is right without it.

use std::{
    fs::{self, File},
    io::{self, Read},
    path::{Path, PathBuf},
};

use super::process::Place;
use crate::contract::{Code, JobError, artifact::FileFormat, reconstruction::ReconstructionFinding};

/// What the placeholders of the command stand for, within the folder of the bundle. The output has no extension.
const PLACES: [(&str, &str); 4] =
    [("{model}", "text"), ("{images}", "images"), ("{masks}", "masks"), ("{output}", "mesh")];
/// Longest head of a PLY.
const HEAD: u64 = 64 << 10;

/// The file and its format.
pub(super) type MeshFile = (PathBuf, FileFormat);

/// What came of the command.
pub(super) enum Mesh {
    Made(MeshFile),
    /// The command failed, exceeded a limit, or made no mesh.
    Missing(ReconstructionFinding),
}

/// Runs the command.
///
/// # Errors
/// [`JobError::Cancelled`], and [`Code::InsufficientStorage`] when the disk is full.
pub(super) fn mesh(place: &Place<'_>, command: &[String]) -> Result<Mesh, JobError> {
    let Some((program, arguments)) = command.split_first() else { return Ok(missing("the command is empty")) };
    let arguments: Vec<String> = arguments.iter().map(|argument| filled(argument, place.folder)).collect();
    match place.run(Path::new(program), &arguments, "the command of mesh_command", |_| {}) {
        Ok(()) => Ok(made(&place.folder.join("mesh")).map_or_else(|detail| missing(&detail), Mesh::Made)),
        Err(JobError::Failed(fault)) if fault.code != Code::InsufficientStorage => Ok(missing(&fault.detail)),
        Err(error) => Err(error),
    }
}

fn missing(why: &str) -> Mesh {
    let detail = format!("there is no mesh: {why}");
    Mesh::Missing(ReconstructionFinding { code: "no_mesh".to_owned(), detail, views: Vec::new() })
}

/// An argument with paths in place of the placeholders.
fn filled(argument: &str, folder: &Path) -> String {
    PLACES
        .iter()
        .fold(argument.to_owned(), |text, (mark, name)| text.replace(mark, &folder.join(name).to_string_lossy()))
}

/// The file that the command made, by its first bytes, or why there is none.
fn made(output: &Path) -> Result<MeshFile, String> {
    let found = [(FileFormat::Ply, "ply"), (FileFormat::Glb, "glb")].into_iter().find_map(|(format, extension)| {
        let path = output.with_extension(extension);
        fs::symlink_metadata(&path).is_ok_and(|file| file.is_file()).then_some((path, format))
    });
    let Some((path, format)) = found else {
        return Err(
            "the command of mesh_command ended well, but wrote neither {output}.ply nor {output}.glb".to_owned()
        );
    };
    match is_mesh(&path, format) {
        Ok(true) => Ok((path, format)),
        Ok(false) => Err(format!(
            "the command of mesh_command wrote a file that is no {} with faces",
            format.extension().to_uppercase()
        )),
        Err(error) => Err(format!("what the command of mesh_command wrote cannot be read: {error}")),
    }
}

fn is_mesh(path: &Path, format: FileFormat) -> io::Result<bool> {
    let mut head = Vec::new();
    let file = File::open(path)?;
    let length = file.metadata()?.len();
    file.take(HEAD).read_to_end(&mut head)?;
    if format == FileFormat::Glb {
        // magic, version 2, length
        let Some((magic, rest)) = head.split_at_checked(8) else { return Ok(false) };
        let told = rest.first_chunk().map(|bytes| u64::from(u32::from_le_bytes(*bytes)));
        return Ok(magic == b"glTF\x02\0\0\0" && told == Some(length));
    }
    let text = String::from_utf8_lossy(&head);
    let Some((head, _)) = text.split_once("end_header") else { return Ok(false) };
    let faces = head.lines().find_map(|line| line.trim().strip_prefix("element face ")?.parse::<u64>().ok());
    Ok(head.starts_with("ply") && faces.is_some_and(|faces| faces > 0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn placeholders_become_paths_and_a_mesh_is_told_by_its_head() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = folder.path().display();
        assert_eq!(filled("--in={model}:{images}", folder.path()), format!("--in={at}/text:{at}/images"));
        let output = folder.path().join("mesh");
        let written = |extension: &str, bytes: &[u8]| {
            fs::write(output.with_extension(extension), bytes).expect("written");
            let made = made(&output);
            fs::remove_file(output.with_extension(extension)).expect("removed");
            made.map(|(_, format)| format)
        };
        let head = "ply\nformat ascii 1.0\nelement vertex 3\nelement face 1\nend_header\n";
        assert_eq!(written("ply", head.as_bytes()), Ok(FileFormat::Ply));
        assert!(written("ply", head.replace("face 1", "face 0").as_bytes()).is_err(), "points are no mesh");
        let glb = b"glTF\x02\0\0\0\x0c\0\0\0";
        assert_eq!(written("glb", glb), Ok(FileFormat::Glb));
        assert!(written("glb", &glb[..11]).expect_err("it is cut off").contains("no GLB with faces"));
        assert!(made(&output).expect_err("there is none").contains("wrote neither"));
    }
}
