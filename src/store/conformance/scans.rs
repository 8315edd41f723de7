//! Scans, and the stacks that join them.

use uuid::Uuid;

use super::*;
use crate::{
    contract::{JobKind, JobState, ScanInput, UploadPurpose, reconstruction::ReconstructionRequest, scan::Reconstruct},
    store::{
        EnqueueAll, Finish,
        scans::{DeleteScan, PutScan, ScanFilter, SettledScan},
        uploads::{Advance, CreateUpload, NewUpload, OpenUploadLimits, UploadState},
    },
};

fn input(lens: &str) -> ScanInput {
    serde_json::from_value(serde_json::json!({ "rig": "rig", "lens": lens, "taxon": "Apis" })).expect("a scan")
}

/// Creates the scan `scan` of `rig` and `lens`.
pub async fn with_scan(metadata: &dyn MetadataStore, scan: &str) {
    let put = metadata.put_scan(&name(scan), &input("lens"), None, Precondition::Any).await.expect("put");
    assert!(matches!(put, PutScan::Created(_) | PutScan::Updated(_)), "{put:?}");
}

fn view(scan: &str) -> NewJob {
    stack_with(|request| request.options.scan = Some(name(scan)))
}

pub async fn a_scan_comes_back_as_it_was_put_and_counts_its_versions(store: Fresh) {
    let metadata = &*store.metadata;
    let bee = name("bee");
    let put = async |input: &ScanInput, condition| metadata.put_scan(&bee, input, None, condition).await.unwrap();
    assert_eq!(put(&input("lens"), Precondition::Present).await, PutScan::PreconditionFailed(None));
    let PutScan::Created(first) = put(&input("lens"), Precondition::Absent).await else { panic!("it is new") };
    assert_eq!((first.version, &first.input), (1, &input("lens")));
    assert_eq!(metadata.scan(&bee).await.unwrap(), Some(first.clone()));
    store.clock.advance(Duration::from_secs(60));
    assert_eq!(put(&input("lens"), Precondition::Revision(2)).await, PutScan::PreconditionFailed(Some(1)));
    let changed = ScanInput { note: Some("again".into()), ..input("other") };
    let PutScan::Updated(second) = put(&changed, Precondition::Revision(1)).await else { panic!("it exists") };
    assert_eq!((second.version, second.created_at, &second.input), (2, first.created_at, &changed));
    assert!(second.updated_at > first.updated_at);
    assert_eq!(metadata.scan(&name("other")).await.unwrap(), None);
}

pub async fn scans_are_listed_newest_first_filtered_and_by_owner(store: Fresh) {
    let metadata = &*store.metadata;
    let (mine, other) = (Uuid::now_v7(), Uuid::now_v7());
    for (scan, lens, owner) in [("a", "l1", Some(mine)), ("b", "l2", Some(other)), ("c", "l1", None)] {
        metadata.put_scan(&name(scan), &input(lens), owner, Precondition::Any).await.unwrap();
    }
    // the owner is that of the first write
    metadata.put_scan(&name("a"), &input("l1"), Some(other), Precondition::Any).await.unwrap();
    assert_eq!(metadata.scan_owner(&name("a")).await.unwrap(), Some(mine));
    let found = async |filter: ScanFilter| -> Vec<String> {
        let page = metadata.scans(&filter, &page(10, None)).await.unwrap();
        page.items.iter().map(|scan| scan.name.to_string()).collect()
    };
    assert_eq!(found(ScanFilter::default()).await, ["c", "b", "a"]);
    assert_eq!(found(ScanFilter { lens: Some(name("l1")), ..ScanFilter::default() }).await, ["c", "a"]);
    assert_eq!(found(ScanFilter { owner: Some(mine), ..ScanFilter::default() }).await, ["c", "a"]);
    assert_eq!(metadata.scan_names(Some(mine), 10).await.unwrap(), [name("c"), name("a")]);
    let first = metadata.scans(&ScanFilter::default(), &page(2, None)).await.unwrap();
    let rest = metadata.scans(&ScanFilter::default(), &page(2, first.next_cursor)).await.unwrap();
    assert_eq!((rest.items.len(), rest.next_cursor), (1, None));
}

pub async fn a_stack_joins_only_a_scan_of_its_rig_and_lens(store: Fresh) {
    let metadata = &*store.metadata;
    let refused = metadata.enqueue(&view("bee"), 1000).await.unwrap();
    assert_eq!(refused, Enqueue::NoSuchScan(name("bee")));
    metadata.put_scan(&name("wasp"), &input("other"), None, Precondition::Any).await.unwrap();
    assert_eq!(metadata.enqueue(&view("wasp"), 1000).await.unwrap(), Enqueue::NoSuchScan(name("wasp")));
    with_scan(metadata, "bee").await;
    accept(metadata, &view("bee")).await;
}

pub async fn a_scan_with_stacks_keeps_its_camera_and_is_not_deleted(store: Fresh) {
    let metadata = &*store.metadata;
    let bee = name("bee");
    assert_eq!(metadata.delete_scan(&bee, Precondition::Any).await.unwrap(), DeleteScan::NotFound);
    with_scan(metadata, "bee").await;
    let job = accept(metadata, &view("bee")).await;
    let moved = metadata.put_scan(&bee, &input("other"), None, Precondition::Any).await.unwrap();
    assert_eq!(moved, PutScan::HasStacks(1));
    let noted = ScanInput { note: Some("x".into()), ..input("lens") };
    assert!(matches!(metadata.put_scan(&bee, &noted, None, Precondition::Any).await.unwrap(), PutScan::Updated(_)));
    assert_eq!(metadata.delete_scan(&bee, Precondition::Any).await.unwrap(), DeleteScan::HasStacks(1));
    metadata.delete_job(job.id).await.unwrap();
    let stale = metadata.delete_scan(&bee, Precondition::Revision(1)).await.unwrap();
    assert_eq!(stale, DeleteScan::PreconditionFailed(Some(2)));
    assert_eq!(metadata.delete_scan(&bee, Precondition::Any).await.unwrap(), DeleteScan::Deleted);
    assert_eq!(metadata.scan(&bee).await.unwrap(), None);
}

fn reconstruction(scan: &str) -> NewJob {
    let request = ReconstructionRequest {
        scan: name(scan),
        options: Default::default(),
        upload: Upload { key: String::new(), ..upload() },
        expected: 1,
        image_size_px: [64, 48],
        intrinsics: None,
        canvas_centre_px: [31.5, 23.5],
        radius_mm: None,
        pan_is_clockwise: false,
        views: vec![],
    };
    NewJob { request: JobRequest::Reconstruction(request), ..stack() }
}

pub async fn a_reconstruction_is_left_to_workers_that_can_run_it_and_keeps_no_scan(store: Fresh) {
    let metadata = &*store.metadata;
    let bee = name("bee");
    assert_eq!(metadata.enqueue(&reconstruction("bee"), 1000).await.unwrap(), Enqueue::NoSuchScan(bee.clone()));
    with_scan(metadata, "bee").await;
    let waiting = accept(metadata, &reconstruction("bee")).await;
    assert_eq!(metadata.blob_keys(waiting.id).await.unwrap(), Vec::<String>::new(), "its pictures are those of stacks");
    let later = accept(metadata, &stack()).await;
    let without = async || metadata.claim(LEASE, ATTEMPTS, Some(JobKind::Reconstruction)).await.unwrap();
    assert_eq!(without().await.map(|job| job.id), Some(later.id), "a later job passes it");
    assert_eq!(without().await, None);
    assert_eq!(claim(metadata).await.map(|job| job.id), Some(waiting.id));
    assert_eq!(claim(metadata).await, None, "both are held");
    store.clock.advance(LEASE);
    let lost = [without().await, without().await].map(|job| job.map(|job| job.id));
    assert_eq!(lost, [Some(later.id), None], "nor is it taken from a dead worker");
    assert_eq!(job(metadata, waiting.id).await.state, JobState::Running);
    assert_eq!(metadata.delete_scan(&bee, Precondition::Any).await.unwrap(), DeleteScan::Deleted);
}

pub async fn a_scan_is_settled_when_its_stacks_changed_and_ended(store: Fresh) {
    let metadata = &*store.metadata;
    let (bee, owner) = (name("bee"), Some(Uuid::now_v7()));
    with_scan(metadata, "wasp").await;
    let auto = ScanInput { reconstruct: Reconstruct::Auto, expected_views: Some(2), ..input("lens") };
    metadata.put_scan(&bee, &auto, owner, Precondition::Any).await.unwrap();
    let settled = async || metadata.settled_scans().await.unwrap();
    let examine = async || {
        let [one]: [SettledScan; 1] = settled().await.try_into().expect("one is settled");
        assert_eq!((&one.name, one.owner), (&bee, owner));
        metadata.scan_examined(&one).await.unwrap();
        assert_eq!(settled().await, []);
    };
    examine().await;
    let end = async |finish: Finish| {
        let job = claim(metadata).await.expect("it waits");
        assert_eq!(settled().await, [], "it runs");
        assert!(metadata.finish(job.id, job.lease_token, &finish).await.unwrap());
        job.id
    };
    accept(metadata, &view("bee")).await;
    assert_eq!(settled().await, [], "it waits");
    let first = end(success()).await;
    examine().await;
    accept(metadata, &view("bee")).await;
    end(Finish::Cancelled).await;
    assert_eq!(settled().await, [], "its results are those of before");
    accept(metadata, &view("bee")).await;
    end(success()).await;
    examine().await;
    metadata.delete_job(first).await.unwrap();
    examine().await;
    accept(metadata, &reconstruction("bee")).await;
    assert_eq!(settled().await, [], "a reconstruction is no view");
    metadata.put_scan(&bee, &auto, None, Precondition::Any).await.unwrap();
    examine().await;
    metadata.put_scan(&bee, &input("lens"), None, Precondition::Any).await.unwrap();
    assert_eq!(settled().await, []);
}

pub async fn several_jobs_are_accepted_together_or_not_at_all(store: Fresh) {
    let metadata = &*store.metadata;
    with_scan(metadata, "bee").await;
    let three = [view("bee"), view("bee"), view("bee")];
    let refused = metadata.enqueue_all(&three, 2).await.unwrap();
    assert_eq!(refused, EnqueueAll::Refused(Enqueue::QueueFull { waiting: 2 }));
    assert_eq!(metadata.counts().await.unwrap().queued, 0, "none of them is stored");
    let EnqueueAll::Accepted(jobs) = metadata.enqueue_all(&three, 3).await.unwrap() else { panic!("they fit") };
    assert_eq!(jobs.iter().map(|job| job.id).collect::<Vec<_>>(), three.map(|job| job.id));
    let mixed = [view("bee"), view("wasp")];
    let refused = metadata.enqueue_all(&mixed, 1000).await.unwrap();
    assert_eq!(refused, EnqueueAll::Refused(Enqueue::NoSuchScan(name("wasp"))));
    assert_eq!(metadata.counts().await.unwrap().queued, 3);
}

pub async fn an_upload_becomes_the_stacks_of_a_scan_once(store: Fresh) {
    let metadata = &*store.metadata;
    with_scan(metadata, "bee").await;
    let id = Uuid::now_v7();
    let owner = Some(Uuid::now_v7());
    let keep = Duration::from_secs(3600);
    let upload = NewUpload { id, length: 5, digest: vec![], metadata: String::new(), keep, owner };
    let limits = OpenUploadLimits { all: 10, of_owner: 10 };
    assert!(matches!(metadata.create_upload(&upload, limits).await.unwrap(), CreateUpload::Created(_)));
    let jobs = [view("bee"), view("bee")];
    assert_eq!(metadata.complete_scan_upload(id, &jobs, 10).await.unwrap(), None, "bytes are missing");
    let all = Advance { from: 0, to: 5, digest: vec![], keep, generation: None };
    assert!(metadata.advance_upload(id, &all).await.unwrap());
    let full = metadata.complete_scan_upload(id, &jobs, 1).await.unwrap();
    assert_eq!(full, Some(EnqueueAll::Refused(Enqueue::QueueFull { waiting: 1 })));
    assert_eq!(metadata.upload(id).await.unwrap().unwrap().state, UploadState::Receiving);
    let Some(EnqueueAll::Accepted(made)) = metadata.complete_scan_upload(id, &jobs, 10).await.unwrap() else {
        panic!("they fit")
    };
    assert_eq!(made.len(), 2);
    for job in &made {
        assert_eq!(metadata.owner(job.id).await.unwrap(), owner, "the owner of the upload");
    }
    assert_eq!(metadata.upload(id).await.unwrap().unwrap().state, UploadState::Complete(UploadPurpose::Scan));
    let again = metadata.complete_scan_upload(id, &[view("bee")], 10).await.unwrap();
    assert_eq!(again, Some(EnqueueAll::Accepted(Vec::new())));
    assert_eq!(metadata.counts().await.unwrap().queued, 2);
}
