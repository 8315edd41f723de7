//! The reconstruction job: the views of a scan go through COLMAP, and its model becomes numbers, findings and files.
//!
//! In: a folder with images and masks, which the worker has placed as a bundle for COLMAP has them. Out: a
//! [`ReconstructionOutcome`] and its files. COLMAP runs as a process of its own ([`process`]), because it is a program
//! of others that may crash, hang, or use too much; a defect of it must not end the worker.
//!
//! | stage | program |
//! |---|---|
//! | `extracting features` | `colmap feature_extractor`, with masks and the camera of the profile |
//! | `matching` | `colmap matches_importer` with neighbours by pan and tilt; without angles `colmap exhaustive_matcher`
//! |
//! | `mapping` | `colmap mapper`, with the limit for errors of reprojection that the request names |
//! | `measuring` | the largest model is read: errors, poses, findings |
//! | `silhouettes`, `colours` | the visual hull of the masks ([`mod@surface`]) |
//! | `meshing` | the command of the setting `mesh_command`, if there is one ([`mod@mesh`]) |

mod commands;
mod findings;
mod launch;
mod measured;
mod mesh;
mod model;
pub mod need;
mod process;
mod program;
mod surface;
mod turntable;

use std::{
    fs::{self, File},
    io::{self, Read},
    path::{Path, PathBuf},
    time::Instant,
};

use self::{
    commands::{Features, Plan, registered, steps},
    measured::{Found, pose_options},
    mesh::{Mesh, MeshFile, mesh},
    model::Model,
    process::{Limits, Place, unwritable},
    surface::{Surface, surface},
};
use super::{
    JobContext, JobOutput, ProgressSink,
    artifact_writer::{ArtifactWriter, WrittenArtifact},
    stages::{Phase, Stage},
};
use crate::contract::{
    Code, Fault, JobError,
    artifact::FileFormat,
    outcome::{JobOutcome, ReconstructionOutcome},
    reconstruction::{ReconstructionRequest, files},
};
use pinstack_science::{
    archive::pack,
    hull,
    photogrammetry::{
        bundle::{self, BundleScan, BundleView, Content, Layout},
        poses,
    },
    types::Control,
};

pub use launch::is_without_network;
pub use program::{Colmap, INSTALL, find, is_program};

/// Folder of the bundle within the scratch folder of the job.
pub const BUNDLE: &str = "bundle";

/// The stage that only a reconstruction with a command for a mesh has.
const MESHING: &str = "meshing";

/// Stages with their weights.
const STAGES: [Stage; 8] = [
    ("extracting features", 3.0),
    ("matching", 2.0),
    ("mapping", 6.0),
    ("measuring", 0.5),
    ("silhouettes", 0.5),
    ("colours", 0.5),
    (MESHING, 6.0),
    ("writing", 0.5),
];

/// The three files of a model as text.
const MODEL_FILES: [&str; 3] = ["cameras.txt", "images.txt", "points3D.txt"];

/// Runs the job.
///
/// # Errors
/// [`JobError::Cancelled`]; [`Code::ReconstructionFailed`] when COLMAP fails or exceeds a limit; the errors of the
/// disk.
pub fn run(
    context: &JobContext,
    request: &ReconstructionRequest,
    colmap: Option<&Colmap>,
    threads: usize,
    sink: &dyn ProgressSink,
) -> Result<JobOutput, JobError> {
    let missing = || Fault::new(Code::Unavailable, format!("there is no COLMAP on this machine; {INSTALL}"));
    let colmap = colmap.ok_or_else(missing)?;
    let has_mesh = !colmap.mesh_command.is_empty();
    let stages: Vec<Stage> = STAGES.into_iter().filter(|(name, _)| has_mesh || *name != MESHING).collect();
    let phase = Phase::new(sink, &stages, 0.0, 1.0);
    let folder = context.scratch.join(BUNDLE);
    let has_pairs = write_texts(request, &folder)?;
    let log = context.scratch.join("colmap.log");
    File::create(&log).map_err(|error| unwritable(&error))?;
    let pictures = request.upload.bytes;
    let limits = Limits {
        until: Instant::now() + colmap.most_time,
        time: colmap.most_time,
        memory: colmap.most_memory,
        disk: colmap.disk_need(request).saturating_add(pictures),
    };
    let place = Place { folder: &folder, log: &log, limits, sink };
    let extraction_threads = need::extraction_threads(request, threads, colmap.most_memory);
    let plan = Plan { request, has_pairs, threads, extraction_threads };
    let run = Run { colmap, place, plan, phase: &phase };
    let found = reconstruct(&run)?;
    let surface = match found.model.images.is_empty() {
        true => Surface::WithoutMasks,
        false => surface(&folder, &folder.join("text"), found.poses.as_ref(), &phase)?,
    };
    let (mut file_of_mesh, mut no_mesh) = (None, None);
    if has_mesh && !found.model.images.is_empty() {
        phase.progress(MESHING, 0, 1);
        match mesh(&run.place, &colmap.mesh_command)? {
            Mesh::Made(file) => file_of_mesh = Some(file),
            Mesh::Missing(finding) => no_mesh = Some(finding),
        }
    }
    phase.progress("writing", 0, 1);
    let mut result = found.result(request);
    match &surface {
        Surface::Made(_, figures) => result.hull = Some(figures.clone()),
        Surface::Impossible(finding) => result.findings.push(finding.clone()),
        Surface::WithoutMasks => {}
    }
    result.findings.extend(no_mesh);
    let writer = ArtifactWriter::new(context, sink);
    let written = write((&found, &surface, file_of_mesh.as_ref()), request, &writer, &folder, &log)?;
    phase.progress("writing", 1, 1);
    let (artifacts, files) = written.into_iter().unzip();
    let outcome = JobOutcome::Reconstruction(ReconstructionOutcome { artifacts, result });
    // what is conspicuous is in the result, with the views concerned
    Ok(JobOutput { outcome, warnings: Vec::new(), profile: None, files })
}

/// A run of COLMAP.
struct Run<'a> {
    colmap: &'a Colmap,
    place: Place<'a>,
    plan: Plan<'a>,
    phase: &'a Phase<'a>,
}

impl Run<'_> {
    fn command(&self, arguments: &[String], on_line: impl FnMut(&str)) -> Result<(), JobError> {
        let what = format!("{} of COLMAP", arguments.first().map_or("a command", String::as_str));
        self.place.run(&self.colmap.program, arguments, &what, on_line)
    }
}

/// The files of the bundle that are texts; the pictures are there. Returns whether one of them lists pairs of views.
fn write_texts(request: &ReconstructionRequest, folder: &Path) -> Result<bool, JobError> {
    let mut has_pairs = false;
    for entry in bundle::plan(Layout::Colmap, &described(request)).map_err(Fault::from)? {
        let path = folder.join(&entry.path);
        match entry.content {
            Content::Text(text) => {
                has_pairs |= entry.path == "pairs.txt";
                let parent = path.parent().unwrap_or(folder);
                fs::create_dir_all(parent).and_then(|()| fs::write(&path, text)).map_err(|error| unwritable(&error))?;
            }
            Content::Image(_) | Content::Mask(_) if path.is_file() => {}
            Content::Image(_) | Content::Mask(_) => {
                let detail =
                    format!("the picture {} of the bundle is missing; this is a bug of the service", entry.path);
                return Err(Fault::new(Code::Internal, detail).into());
            }
        }
    }
    Ok(has_pairs)
}

/// The scan as bundles are made from it.
fn described(request: &ReconstructionRequest) -> BundleScan {
    let view = |view: &crate::contract::reconstruction::ReconstructionView| BundleView {
        stem: view.name.clone(),
        extension: view.extension.clone(),
        bit_depth: view.bit_depth,
        has_mask: view.mask.is_some(),
        angles: view.angles,
    };
    let [width, height] = request.image_size_px;
    BundleScan {
        name: request.scan.to_string(),
        width,
        height,
        intrinsics: request.intrinsics,
        canvas_centre_px: request.canvas_centre_px,
        radius_mm: request.radius_mm,
        pan_is_clockwise: request.pan_is_clockwise,
        views: request.views.iter().map(view).collect(),
    }
}

/// Runs the commands of COLMAP, and reads the largest model.
fn reconstruct(run: &Run<'_>) -> Result<Found, JobError> {
    let (folder, phase, views) = (run.place.folder, run.phase, run.plan.request.views.len());
    let mut program = None;
    run.command(&["help".to_owned()], |line| {
        let first = line.split(" -- ").next().unwrap_or(line).trim();
        if program.is_none() && first.starts_with("COLMAP") {
            program = Some(first.chars().take(40).collect());
        }
    })?;
    let mut features = Features::default();
    phase.progress("extracting features", 0, views);
    run.command(&run.plan.extract(), |line| {
        features.read(line);
        if let Some((done, all)) = steps(line, "Processed file") {
            phase.progress("extracting features", done, all);
        }
    })?;
    phase.progress("matching", 0, 1);
    run.command(&run.plan.match_views(), |line| {
        if let Some((done, all)) = steps(line, "Matching block") {
            phase.progress("matching", done, all);
        }
    })?;
    phase.progress("mapping", 0, views);
    fs::create_dir_all(folder.join("model")).map_err(|error| unwritable(&error))?;
    // of several parts the later ones begin again
    let mut most = 0;
    let mapped = run.command(&run.plan.map(), |line| {
        if let Some(done) = registered(line) {
            most = most.max(done);
            phase.progress("mapping", most.min(views), views);
        }
    });
    let parts = parts(&folder.join("model")).map_err(|error| unwritable(&error))?;
    // COLMAP 3.8 fails when it finds no model, and says so before
    match mapped {
        Err(JobError::Failed(_)) if parts.is_empty() && says_no_model(run.place.log) => {}
        mapped => mapped?,
    }
    phase.progress("measuring", 0, 1);
    let program = program.unwrap_or_else(|| "COLMAP".to_owned());
    let sizes = parts.iter().map(|(count, _)| *count).collect();
    let Some((_, largest)) = parts.first() else {
        return Ok(Found { program, features, parts: sizes, model: Model::default(), poses: None });
    };
    let text = folder.join("text");
    fs::create_dir_all(&text).map_err(|error| unwritable(&error))?;
    let largest = largest.strip_prefix(folder).unwrap_or(largest).to_string_lossy().into_owned();
    run.command(&run.plan.as_text(&largest), |_| {})?;
    let model = Model::read(&text).map_err(|error| {
        Fault::new(Code::ReconstructionFailed, format!("the model of COLMAP cannot be read: {error}"))
    })?;
    let poses = poses_of(&text, run.plan.request)?;
    Ok(Found { program, features, parts: sizes, model, poses })
}

/// The models in a folder, each with its number of registered views, the largest first.
fn parts(folder: &Path) -> io::Result<Vec<(u64, PathBuf)>> {
    let mut parts = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        // the file begins with the number
        let mut count = [0; 8];
        if File::open(path.join("images.bin")).and_then(|mut file| file.read_exact(&mut count)).is_ok() {
            parts.push((u64::from_le_bytes(count), path));
        }
    }
    parts.sort_by(|a, b| b.0.cmp(&a.0).then_with(|| a.1.cmp(&b.1)));
    Ok(parts)
}

/// Whether the mapper said that it found nothing to begin with.
fn says_no_model(log: &Path) -> bool {
    let text = fs::read(log).map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).unwrap_or_default();
    ["failed to create sparse model", "No good initial image pair", "Could not find good initial pair"]
        .into_iter()
        .any(|words| text.contains(words))
}

/// The report on the poses of the model; `None` when too little is registered for one.
fn poses_of(text: &Path, request: &ReconstructionRequest) -> Result<Option<poses::PoseReport>, JobError> {
    let zip = zipped(text, &["images.txt", "cameras.txt"]).map_err(|error| unwritable(&error))?;
    let report = poses::read(&zip, None).and_then(|file| poses::report(&file, &pose_options(request)));
    if let Err(error) = &report {
        tracing::info!(%error, "there is no report on the poses of a reconstruction");
    }
    Ok(report.ok())
}

/// A zip of files of a folder.
fn zipped(folder: &Path, names: &[&str]) -> io::Result<Vec<u8>> {
    let mut members = Vec::with_capacity(names.len());
    for name in names {
        members.push(((*name).to_owned(), fs::read(folder.join(name))?));
    }
    let mut zip = io::Cursor::new(Vec::new());
    pack(&mut zip, members.into_iter())?;
    Ok(zip.into_inner())
}

/// Writes the files.
fn write(
    (found, surface, mesh): (&Found, &Surface, Option<&MeshFile>),
    request: &ReconstructionRequest,
    writer: &ArtifactWriter<'_>,
    folder: &Path,
    log: &Path,
) -> Result<Vec<WrittenArtifact>, JobError> {
    let mut written = Vec::new();
    if !found.model.images.is_empty() {
        written.push(writer.file(files::POINTS, FileFormat::Ply, |out| found.write_points(out))?);
        written.push(writer.json(files::CAMERAS, &found.cameras(request))?);
        let model = zipped(&folder.join("text"), &MODEL_FILES).map_err(|error| unwritable(&error))?;
        written.push(writer.file(files::MODEL, FileFormat::Zip, |out| io::Write::write_all(out, &model))?);
    }
    if let Surface::Made(hull, _) = surface {
        written.push(writer.file(files::HULL, FileFormat::Glb, |out| hull::write_glb(&hull.mesh, false, out))?);
    }
    if let Some((path, format)) = mesh {
        let mut file = File::open(path).map_err(|error| unwritable(&error))?;
        written.push(writer.file(files::MESH, *format, |out| io::copy(&mut file, out).map(|_| ()))?);
    }
    if let Some(report) = &found.poses {
        written.push(writer.json(files::POSES, report)?);
    }
    let mut said = File::open(log).map_err(|error| unwritable(&error))?;
    written.push(writer.file(files::LOG, FileFormat::Text, |out| io::copy(&mut said, out).map(|_| ()))?);
    Ok(written)
}

#[cfg(test)]
mod tests;
