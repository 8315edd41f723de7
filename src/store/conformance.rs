//! What every engine must do, written once: each function takes a fresh store and panics with what it did wrong.
//! The tests of an engine call them one by one.

pub(crate) mod blobs;
pub(crate) mod disk;
pub(crate) mod expiry;
pub(crate) mod jobs;
pub(crate) mod leases;
pub(crate) mod profiles;
pub(crate) mod tokens;
pub(crate) mod totals;
pub(crate) mod uploads;

use std::{sync::Arc, time::Duration};

use uuid::Uuid;

use super::{Enqueue, Job, ManualClock, MetadataStore, NewJob, PageRequest, Precondition, ProfileDraft, PutProfile};
use crate::contract::{
    Name,
    outcome::{Artifact, CalibrationOutcome, ImageInfo, JobOutcome, StackOutcome},
    profile::{Profile, ProfileSource},
    request::{CalibrationRequest, JobRequest, StackRequest, Upload},
};
use pinstack_science::types::{
    Homography,
    calibration_options::CalibrationOptions,
    profile::{HomographyModel, ProfileInput, ProfileSlice},
    stack_layout::StackLayout,
};

/// A fresh, empty store and the clock that it goes by.
pub(crate) struct Fresh {
    pub(crate) rows: Arc<dyn MetadataStore>,
    pub(crate) clock: Arc<ManualClock>,
}

pub(crate) const LEASE: Duration = Duration::from_secs(15);
pub(crate) const ATTEMPTS: u32 = 3;

pub(crate) fn name(text: &str) -> Name {
    Name::new(text).expect("a test uses good names")
}

pub(crate) fn page(limit: u32, cursor: Option<String>) -> PageRequest {
    PageRequest { limit, cursor }
}

pub(crate) fn draft(scale: f64) -> ProfileDraft {
    let homographies = vec![Homography::IDENTITY, Homography::similarity(scale, [0.25, -0.5])];
    let slices = homographies.iter().enumerate().map(|(i, h)| ProfileSlice::given(i as u32, *h, 1.0, 64, 48)).collect();
    let input = ProfileInput {
        image_width: 64,
        image_height: 48,
        reference_index: 0,
        homographies,
        gains: None,
        note: Some("made by a test".into()),
        ..ProfileInput::default()
    };
    let (source, model) = (ProfileSource::Upload, HomographyModel::Given);
    ProfileDraft { input, source, calibration_id: None, model, slices, origin: None, warnings: vec![] }
}

pub(crate) async fn put(rows: &dyn MetadataStore, rig: &str, lens: &str, scale: f64) -> Profile {
    let put = rows.put_profile(&name(rig), &name(lens), &draft(scale), Precondition::Any).await.expect("put");
    match put {
        PutProfile::Created(profile) | PutProfile::Updated(profile) => profile,
        PutProfile::PreconditionFailed(_) => panic!("no precondition was made"),
    }
}

fn layout() -> StackLayout {
    StackLayout {
        front: vec!["front/1.png".into(), "front/2.png".into()],
        back: vec![],
        width: 64,
        height: 48,
        bit_depth: 8,
        channels: 3,
        orientation: 1,
        largest_file_bytes: 5_000,
    }
}

fn upload() -> Upload {
    Upload { key: "uploads/x.zip".into(), bytes: 12, sha256: "00".into(), filename: None }
}

pub(crate) fn stack() -> NewJob {
    NewJob {
        id: Uuid::now_v7(),
        rig: name("rig"),
        lens: name("lens"),
        request: JobRequest::Stack(StackRequest {
            options: Default::default(),
            profile_revision: 1,
            profile_digest: "d".into(),
            profile_optics_digest: Some("o".into()),
            upload: upload(),
            layout: layout(),
            rerun_of: None,
        }),
        warnings: vec![],
        idempotency: None,
        owner: None,
    }
}

pub(crate) fn calibration() -> NewJob {
    let options = CalibrationOptions::default();
    let request = JobRequest::Calibration(CalibrationRequest { options, upload: upload(), layout: layout() });
    NewJob { request, ..stack() }
}

pub(crate) fn stack_with(change: impl FnOnce(&mut StackRequest)) -> NewJob {
    let mut job = stack();
    if let JobRequest::Stack(request) = &mut job.request {
        change(request);
    }
    job
}

pub(crate) async fn accept(rows: &dyn MetadataStore, job: &NewJob) -> Job {
    match rows.enqueue(job, 1000).await.expect("enqueue") {
        Enqueue::Accepted(job) => *job,
        other => panic!("the job was not accepted: {other:?}"),
    }
}

pub(crate) async fn claim(rows: &dyn MetadataStore) -> Option<Job> {
    rows.claim(LEASE, ATTEMPTS).await.expect("claim")
}

/// A job whose worker was not heard of for a whole lease, as a process claims it that did not know of it before.
pub(crate) async fn claim_from_the_dead(rows: &dyn MetadataStore, clock: &ManualClock) -> Job {
    assert_eq!(claim(rows).await, None, "its worker may be alive");
    clock.advance(LEASE);
    claim(rows).await.expect("its worker is dead")
}

pub(crate) async fn job(rows: &dyn MetadataStore, id: Uuid) -> Job {
    rows.job(id).await.expect("read the job").expect("the job is there")
}

pub(crate) fn stack_outcome() -> JobOutcome {
    let artifact = Artifact {
        name: "image".into(),
        key: "results/x/1/image.png".into(),
        media_type: "image/png".into(),
        bytes: 3,
        sha256: "ab".into(),
    };
    let image = ImageInfo { width: 64, height: 48, bit_depth: 8, crop_offset_px: [0, 0], intrinsics: None };
    JobOutcome::Stack(StackOutcome { artifacts: vec![artifact], image, metrics: Default::default(), software: None })
}

pub(crate) fn calibration_outcome() -> JobOutcome {
    JobOutcome::Calibration(CalibrationOutcome {
        artifacts: vec![],
        profile_revision: 0,
        profile_digest: String::new(),
        profile_optics_digest: None,
        reference_index: 0,
        slices: vec![],
        dot_pitch_px: None,
        magnification: None,
        verdict: "good".into(),
    })
}

pub(crate) fn success() -> super::Finish {
    super::Finish::Succeeded { outcome: Box::new(stack_outcome()), warnings: vec![], profile: None }
}
