//! Workers with the job runner of the service.

use sha2::{Digest, Sha256};
use uuid::Uuid;

use super::*;
use crate::{
    contract::{
        outcome::JobOutcome,
        request::{CalibrationRequest, JobRequest, StackRequest, Upload},
    },
    jobs::{ScienceRunner, testkit},
    store::{
        NewJob,
        blobs::upload_key,
        conformance::{
            accept,
            blobs::{bytes_of_blob, put_blob},
        },
        digest::hex,
    },
};
use pinstack_science::{
    archive::{self, ArchiveLimits},
    types::stack_layout::StackLayout,
};

/// Stores an archive as the upload of a new job and accepts the job.
async fn accept_archive(deps: &Deps, archive: &[u8], request: impl FnOnce(Upload, StackLayout) -> JobRequest) -> Uuid {
    let id = Uuid::now_v7();
    let key = upload_key(id);
    put_blob(&deps.store, &key, archive).await;
    let stored = deps.store.blobs.fetch(&key, &deps.store.workspace).await.unwrap().expect("it is stored");
    let layout = archive::open(stored.path(), &ArchiveLimits::default()).unwrap().layout().clone();
    let upload = Upload { key, bytes: archive.len() as u64, sha256: String::new(), filename: None };
    let job = NewJob { id, request: request(upload, layout), ..conformance::stack() };
    accept(&*deps.store.metadata, &job).await.id
}

worker_test! {
    async fn a_target_becomes_the_profile_that_the_next_stack_is_fused_with() {
        let mut stage = stage().await;
        stage.deps.runner = Arc::new(ScienceRunner::default());
        let _pool = Pool::start(stage.deps.clone(), Config { workers: 2, ..Config::default() });
        let calibration = accept_archive(&stage.deps, &testkit::target_zip(), |upload, layout| {
            JobRequest::Calibration(CalibrationRequest { options: Default::default(), upload, layout, stacks: vec![] })
        })
        .await;
        let ended = stage.ended(calibration).await;
        let Some(JobOutcome::Calibration(outcome)) = ended.outcome else { panic!("{:?}", ended.error) };
        // the stage put revision 1
        // five overlays and the report
        assert_eq!((outcome.profile_revision, outcome.artifacts.len()), (Some(2), 6));
        let profile = stage.deps.store.metadata.profile(&ended.rig, &ended.lens, None).await.unwrap().unwrap();
        assert_eq!((Some(&profile.digest), profile.calibration_id), (outcome.profile_digest.as_ref(), Some(ended.id)));

        let stack = accept_archive(&stage.deps, &testkit::both_zip(), |upload, layout| {
            let (profile_revision, profile_digest) = (profile.revision, profile.digest.clone());
            JobRequest::Stack(StackRequest {
                options: Default::default(),
                profile_revision,
                profile_digest,
                profile_optics_digest: Some(profile.optics_digest.clone()),
                upload,
                layout,
                rerun_of: None,
            })
        })
        .await;
        let ended = stage.ended(stack).await;
        let Some(JobOutcome::Stack(outcome)) = ended.outcome else { panic!("{:?}", ended.error) };
        assert_eq!(outcome.artifacts.len(), 5);
        for artifact in outcome.artifacts {
            let bytes = bytes_of_blob(&stage.deps.store, &artifact.key).await.expect("it is published");
            assert_eq!((hex(&Sha256::digest(&bytes)), bytes.len() as u64), (artifact.sha256, artifact.bytes));
        }
    }
}
