//! The program that many use for the same, on the same slices.

use std::{
    fs::{self, File},
    io::BufWriter,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    time::{Duration, Instant},
};

use pinstack_science::imaging::{
    Plane, Raster, Rect, Samples, Slices,
    codec::{self, Metadata},
    warp::Warp,
};

use super::{
    case::Case,
    clock::{Cost, children, peak_mb},
};

const ENFUSE: [&str; 5] =
    ["--hard-mask", "--exposure-weight=0", "--saturation-weight=0", "--contrast-weight=1", "--gray-projector=l-star"];

/// What `enfuse` needs for the same slices, when it is installed.
pub fn enfuse(case: Case, folder: &Path) -> Option<Cost> {
    Command::new("enfuse").arg("--version").output().ok()?;
    let (archive, plan, size) = (case.archive(folder), case.plan(), (case.width, case.height));
    let files: Vec<PathBuf> = (0..case.slices)
        .map(|i| {
            let warp =
                Warp::new(&plan.slices[i].homography, plan.slices[i].gain, size, size).expect("a regular homography");
            let raster = archive.front().load(i).expect("a slice");
            let samples = match raster.samples {
                Samples::Eight(samples) => Samples::Eight(warp.apply(samples, 3)),
                Samples::Sixteen(samples) => Samples::Sixteen(warp.apply(samples, 3)),
            };
            let path = folder.join(format!("{i:02}.tif"));
            let file = BufWriter::new(File::create(&path).expect("a file"));
            codec::encode_tiff(file, &with_alpha(samples, &warp, size), &Metadata::default()).expect("a TIFF");
            path
        })
        .collect();
    let (before, started) = (children(), Instant::now());
    let mut child = Command::new("enfuse")
        .args(ENFUSE)
        .arg("-o")
        .arg(folder.join("enfuse.tif"))
        .args(&files)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .ok()?;
    let mut peak = None;
    let status = loop {
        peak = peak_mb(&child.id().to_string()).or(peak);
        match child.try_wait().ok()? {
            Some(status) => break status,
            None => std::thread::sleep(Duration::from_millis(20)),
        }
    };
    files.iter().for_each(|file| drop(fs::remove_file(file)));
    status.success().then(|| Cost { cpu: children() - before, wall: started.elapsed().as_secs_f64(), peak_mb: peak })
}

/// The warped slice with what it covers as alpha.
fn with_alpha(samples: Samples, warp: &Warp, (width, height): (usize, usize)) -> Raster {
    fn joined<T: Copy>(samples: &[T], mask: &Plane<u8>, full: T, none: T) -> Vec<T> {
        let alpha = |&covered: &u8| if covered == 0 { none } else { full };
        samples.chunks_exact(3).zip(&mask.data).flat_map(|(p, covered)| [p[0], p[1], p[2], alpha(covered)]).collect()
    }
    let mask = warp.coverage().mask(Rect::whole(width, height));
    match samples {
        Samples::Eight(samples) => Raster::eight(width, height, 4, joined(&samples, &mask, u8::MAX, 0)),
        Samples::Sixteen(samples) => Raster::sixteen(width, height, 4, joined(&samples, &mask, u16::MAX, 0)),
    }
}
