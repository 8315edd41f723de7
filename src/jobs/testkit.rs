//! What tests of jobs share: a small synthetic stack in a zip, its true profile, and a progress sink that records.

use std::{
    fs::File,
    io::Cursor,
    sync::{Arc, Mutex, OnceLock},
    time::Instant,
};

use jiff::Timestamp;
use tempfile::TempDir;

use super::{JobContext, JobOutput, ProgressSink};
use crate::{
    contract::{
        Name, Progress,
        options::StackOptions,
        outcome::Artifact,
        profile::{Profile, ProfileSource},
        request::{CalibrationRequest, JobRequest, StackRequest, Upload},
    },
    store::{
        Job,
        digest::{optics_digest, profile_digest},
    },
};
use pinstack_science::{
    archive::{self, ArchiveLimits, pack},
    imaging::{
        Raster, Samples,
        codec::{self, Limits, Metadata, encode_png},
    },
    synth::{DotTarget, Light, Rig, Scene, Stage, Truth, target_stack},
    types::{
        Cancelled,
        calibration_options::CalibrationOptions,
        profile::{HomographyModel, ProfileInput, ProfileSlice},
    },
};

/// A small rig, so that tests are fast.
pub(crate) fn rig() -> Rig {
    Rig::sized(240, 180, 5)
}

/// A stack and its truth.
pub(crate) struct Stack {
    pub(crate) front: Vec<Raster>,
    pub(crate) back: Vec<Raster>,
    pub(crate) truth: Truth,
}

/// The stack of the tests, rendered once.
pub(crate) fn stack() -> &'static Stack {
    static STACK: OnceLock<Stack> = OnceLock::new();
    STACK.get_or_init(|| {
        let stage = Stage::new(&rig(), &Scene::insect(3));
        let all = |light| (0..rig().slices()).map(|i| stage.render(light, i)).collect();
        Stack { front: all(Light::Front), back: all(Light::Back), truth: stage.truth() }
    })
}

pub(crate) fn png(picture: &Raster) -> Vec<u8> {
    let mut out = Vec::new();
    encode_png(&mut out, picture, &Metadata::default()).expect("encode");
    out
}

pub(crate) fn members(folder: &str, slices: &[Raster]) -> Vec<(String, Vec<u8>)> {
    slices.iter().enumerate().map(|(i, slice)| (format!("{folder}/img_{i}.png"), png(slice))).collect()
}

pub(crate) fn zip(members: Vec<(String, Vec<u8>)>) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    pack(&mut out, members.into_iter()).expect("pack");
    out.into_inner()
}

/// The zip of the front light alone.
pub(crate) fn front_zip() -> Vec<u8> {
    zip(members("front", &stack().front))
}

/// The zip of front and back light.
pub(crate) fn both_zip() -> Vec<u8> {
    let mut all = members("front", &stack().front);
    all.extend(members("back", &stack().back));
    zip(all)
}

/// The zip of a dot target on the same rig.
pub(crate) fn target_zip() -> Vec<u8> {
    let target = DotTarget { code: Some([0, 0]), ..DotTarget::for_rig(&rig(), 12) };
    zip(members("front", &target_stack(&rig(), &target)))
}

/// The true profile of the rig.
pub(crate) fn true_profile() -> Profile {
    let rig = rig();
    let (width, height) = (rig.width as u32, rig.height as u32);
    let input = ProfileInput {
        image_width: width,
        image_height: height,
        reference_index: rig.reference as u32,
        homographies: (0..rig.slices()).map(|i| rig.homography(i)).collect(),
        gains: Some((0..rig.slices()).map(|i| rig.gain(i)).collect()),
        ..ProfileInput::default()
    };
    let slice = |i: usize| ProfileSlice::given(i as u32, rig.homography(i), rig.gain(i), width, height);
    Profile {
        rig: Name::new("rig").expect("a name"),
        lens: Name::new("lens").expect("a name"),
        revision: 1,
        digest: profile_digest(&input),
        optics_digest: optics_digest(&input),
        created_at: Timestamp::UNIX_EPOCH,
        source: ProfileSource::Upload,
        calibration_id: None,
        origin: None,
        model: HomographyModel::Given,
        warnings: Vec::new(),
        principal_distance_px: None,
        slice_count: rig.slices() as u32,
        slices: (0..rig.slices()).map(slice).collect(),
        input,
    }
}

/// A job context on a temporary folder, which is removed with it.
pub(crate) struct TestJob {
    pub(crate) context: JobContext,
    _folder: TempDir,
}

impl TestJob {
    pub(crate) fn stack(archive: &[u8], options: StackOptions) -> Self {
        let profile = true_profile();
        Self::prepared(archive, Some(profile.clone()), |upload, layout| {
            let (profile_revision, profile_digest) = (profile.revision, profile.digest.clone());
            let profile_optics_digest = Some(profile.optics_digest.clone());
            JobRequest::Stack(StackRequest {
                options,
                profile_revision,
                profile_digest,
                profile_optics_digest,
                upload,
                layout,
                rerun_of: None,
            })
        })
    }

    pub(crate) fn calibration(archive: &[u8], options: CalibrationOptions) -> Self {
        Self::prepared(archive, None, |upload, layout| {
            JobRequest::Calibration(CalibrationRequest { options, upload, layout, stacks: Vec::new() })
        })
    }

    fn prepared(
        archive: &[u8],
        profile: Option<Profile>,
        request: impl FnOnce(Upload, pinstack_science::types::stack_layout::StackLayout) -> JobRequest,
    ) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let (path, scratch) = (folder.path().join("upload.zip"), folder.path().join("scratch"));
        std::fs::write(&path, archive).expect("write the zip");
        std::fs::create_dir(&scratch).expect("a scratch folder");
        let layout = archive::open(&path, &ArchiveLimits::default()).expect("a sound zip").layout().clone();
        let upload = Upload { key: String::new(), bytes: archive.len() as u64, sha256: String::new(), filename: None };
        let [rig, lens] = ["rig", "lens"].map(|name| Name::new(name).expect("a name"));
        let job = Job::unqueued(rig, lens, request(upload, layout), Timestamp::UNIX_EPOCH);
        let archive = Arc::new(File::open(path).expect("the zip"));
        let context = JobContext { job, profile, archive, others: Vec::new(), scratch, started: Instant::now() };
        Self { context, _folder: folder }
    }
}

/// The artifact of this name and the picture in its file.
pub(crate) fn picture<'a>(output: &'a JobOutput, name: &str) -> (&'a Artifact, Raster) {
    let (artifact, bytes) = file(output, name);
    (artifact, pixels(&bytes))
}

/// The pixels of a result, without alpha.
pub(crate) fn pixels(bytes: &[u8]) -> Raster {
    let rgba = codec::decode_rgba(bytes, &Limits::default()).expect("a picture");
    if rgba.channels != 4 {
        return codec::decode(bytes, &Limits::default()).expect("a picture");
    }
    let samples = match &rgba.samples {
        Samples::Eight(s) => Samples::Eight(s.chunks_exact(4).flat_map(|pixel| pixel[..3].to_vec()).collect()),
        Samples::Sixteen(s) => Samples::Sixteen(s.chunks_exact(4).flat_map(|pixel| pixel[..3].to_vec()).collect()),
    };
    Raster { channels: 3, samples, ..rgba }
}

/// The artifact of this name and the bytes of its file.
pub(crate) fn file<'a>(output: &'a JobOutput, name: &str) -> (&'a Artifact, Vec<u8>) {
    let artifact = output.outcome.artifacts().iter().find(|a| a.name == name).expect("the artifact");
    let output_file = output.files.iter().find(|file| file.key == artifact.key).expect("its file");
    (artifact, std::fs::read(&output_file.path).expect("read the file"))
}

/// Records the reports; cancels the job once the fraction has reached `stop_at`.
#[derive(Default)]
pub(crate) struct Recorder {
    pub(crate) reports: Mutex<Vec<Progress>>,
    pub(crate) stop_at: Option<f64>,
}

impl ProgressSink for Recorder {
    fn report(&self, progress: Progress) {
        self.reports.lock().expect("no test panics with it").push(progress);
    }

    fn check(&self) -> Result<(), Cancelled> {
        let reports = self.reports.lock().expect("no test panics with it");
        let reached = reports.last().map_or(0.0, |progress| progress.fraction);
        if self.stop_at.is_some_and(|stop| reached >= stop) { Err(Cancelled) } else { Ok(()) }
    }
}
