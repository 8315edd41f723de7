//! Other focus stacking programs, if they are installed.

use std::{
    ffi::{OsStr, OsString},
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use pinstack_science::imaging::Raster;

use super::case::samples;

/// The programs that are available.
pub struct Peers {
    enfuse: bool,
    /// A Python interpreter that can import shinestacker.
    python: Option<OsString>,
}

fn succeeds(program: impl AsRef<OsStr>, arguments: &[&OsStr]) -> bool {
    let run = Command::new(program).args(arguments).stdout(Stdio::null()).stderr(Stdio::null()).status();
    run.is_ok_and(|status| status.success())
}

impl Peers {
    /// Looks for `enfuse` on the path and for shinestacker in the interpreter that PINSTACK_SHINESTACKER names.
    pub fn detect() -> Self {
        let imports = ["-c", "import shinestacker"].map(OsStr::new);
        let python = std::env::var_os("PINSTACK_SHINESTACKER").filter(|python| succeeds(python, &imports));
        Self { enfuse: succeeds("enfuse", &[OsStr::new("--version")]), python }
    }

    /// The name and the fused image of each program; the slices are aligned already.
    pub fn fuse(&self, slices: &[Raster]) -> Vec<(&'static str, Raster)> {
        if !self.enfuse && self.python.is_none() {
            return Vec::new();
        }
        let work = tempfile::tempdir().expect("a folder");
        let folder = work.path().join("slices");
        fs::create_dir(&folder).expect("a folder");
        let paths: Vec<PathBuf> = (0..slices.len()).map(|i| folder.join(format!("{i:02}.tif"))).collect();
        for (slice, path) in slices.iter().zip(&paths) {
            let (width, height) = (slice.width as u32, slice.height as u32);
            image::save_buffer(path, samples(slice), width, height, image::ColorType::Rgb8).expect("a slice");
        }
        let mut made = Vec::new();
        if self.enfuse {
            let out = work.path().join("enfuse.tif");
            let options = [
                "--hard-mask",
                "--exposure-weight=0",
                "--saturation-weight=0",
                "--contrast-weight=1",
                "--gray-projector=l-star",
                "-o",
            ];
            let mut arguments: Vec<&OsStr> = options.iter().map(OsStr::new).collect();
            arguments.push(out.as_os_str());
            arguments.extend(paths.iter().map(|path| path.as_os_str()));
            if succeeds("enfuse", &arguments) {
                made.extend(read(&out).map(|picture| ("enfuse", picture)));
            } else {
                eprintln!("enfuse fails on this stack");
            }
        }
        if let Some(python) = &self.python {
            let script = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/common/fuse_with_shinestacker.py");
            let arguments = [OsStr::new(script), work.path().as_os_str(), OsStr::new("slices")];
            if succeeds(python, &arguments) {
                for (name, folder) in [("shinestacker pyramid", "pyramid"), ("shinestacker depth map", "depth_map")] {
                    made.extend(only_file(&work.path().join(folder)).and_then(|p| read(&p)).map(|r| (name, r)));
                }
            } else {
                eprintln!("shinestacker fails on this stack");
            }
        }
        made
    }
}

fn only_file(folder: &Path) -> Option<PathBuf> {
    fs::read_dir(folder).ok()?.filter_map(Result::ok).map(|entry| entry.path()).find(|path| path.is_file())
}

fn read(path: &Path) -> Option<Raster> {
    let picture = image::open(path).ok()?.to_rgb8();
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    Some(Raster::eight(width, height, 3, picture.into_raw()))
}
