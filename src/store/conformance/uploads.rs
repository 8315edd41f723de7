//! Resumable uploads.

use std::time::Duration;

use uuid::Uuid;

use super::{Fresh, name, page, stack};
use crate::{
    contract::{Code, Fault, UploadPurpose},
    store::{
        Enqueue, NewJob, OverQuota, StoreError, UploadRecords,
        tokens::NewToken,
        uploads::{Advance, CreateUpload, ExpiredUpload, NewUpload, OpenUpload, OpenUploadLimits, UploadState},
    },
};

const KEEP: Duration = Duration::from_secs(3600);
/// More than any test needs.
pub const MANY: OpenUploadLimits = OpenUploadLimits { all: 1000, of_owner: 1000 };

pub async fn begun(metadata: &dyn UploadRecords, length: u64) -> Uuid {
    let new =
        NewUpload { id: Uuid::now_v7(), length, digest: vec![0], metadata: "rig cmln".into(), keep: KEEP, owner: None };
    let CreateUpload::Created(upload) = metadata.create_upload(&new, MANY).await.unwrap() else {
        panic!("it is within the limits")
    };
    assert_eq!((upload.id, upload.length, upload.offset, upload.state), (new.id, length, 0, UploadState::Receiving));
    assert_eq!((upload.digest, upload.metadata.as_str()), (vec![0], "rig cmln"));
    new.id
}

pub fn advance(from: u64, to: u64) -> Advance {
    Advance { from, to, digest: to.to_le_bytes().to_vec(), keep: KEEP, generation: None }
}

fn job(id: Uuid) -> NewJob {
    NewJob { id, ..stack() }
}

pub async fn an_upload_advances_only_from_its_offset(store: Fresh) {
    let metadata = &*store.metadata;
    let id = begun(metadata, 100).await;
    assert!(metadata.advance_upload(id, &advance(0, 60)).await.unwrap());
    assert!(!metadata.advance_upload(id, &advance(0, 70)).await.unwrap(), "it is at 60");
    assert!(!metadata.advance_upload(Uuid::now_v7(), &advance(0, 70)).await.unwrap());
    assert!(metadata.advance_upload(id, &advance(60, 101)).await.is_err(), "it has 100 bytes");
    let upload = metadata.upload(id).await.unwrap().unwrap();
    assert_eq!((upload.offset, upload.digest), (60, 60_u64.to_le_bytes().to_vec()));
}

pub async fn an_upload_that_several_may_write_advances_only_for_the_newest_generation(store: Fresh) {
    let metadata = &*store.metadata;
    let id = begun(metadata, 100).await;
    let older = metadata.take_over_upload(id).await.unwrap();
    let by = |generation, from, to| Advance { generation, ..advance(from, to) };
    assert!(metadata.advance_upload(id, &by(older, 0, 10)).await.unwrap());
    let newer = metadata.take_over_upload(id).await.unwrap();
    assert!(!metadata.advance_upload(id, &by(older, 10, 20)).await.unwrap(), "a newer request writes it");
    assert_eq!(metadata.upload(id).await.unwrap().unwrap().offset, 10);
    assert!(metadata.advance_upload(id, &by(newer, 10, 30)).await.unwrap());
}

pub async fn a_takeover_increments_the_generation_and_is_announced(store: Fresh) {
    let metadata = &*store.metadata;
    let id = begun(metadata, 100).await;
    let mut changes = metadata.changes();
    let first = metadata.take_over_upload(id).await.unwrap().unwrap();
    assert_eq!(changes.recv().await.unwrap(), id);
    let second = metadata.take_over_upload(id).await.unwrap().unwrap();
    assert!(second > first);
    assert_eq!(metadata.upload(id).await.unwrap().unwrap().generation, second);
    assert_eq!(metadata.take_over_upload(Uuid::now_v7()).await.unwrap(), None);
}

pub async fn a_complete_upload_becomes_one_job_and_an_incomplete_one_none(store: Fresh) {
    let metadata = &*store.metadata;
    let id = begun(metadata, 100).await;
    metadata.advance_upload(id, &advance(0, 99)).await.unwrap();
    assert_eq!(metadata.complete_upload(&job(id), 10).await.unwrap(), None);
    metadata.advance_upload(id, &advance(99, 100)).await.unwrap();
    assert_eq!(metadata.complete_upload(&job(id), 0).await.unwrap(), Some(Enqueue::QueueFull { waiting: 0 }));
    assert!(metadata.upload_is_open(id).await.unwrap());
    let made = metadata.complete_upload(&job(id), 10).await.unwrap();
    let Some(Enqueue::Accepted(first)) = made else { panic!("{made:?}") };
    assert_eq!(metadata.complete_upload(&job(id), 10).await.unwrap(), Some(Enqueue::Repeated(first.clone())));
    assert_eq!(metadata.job(id).await.unwrap(), Some(*first));
    assert_eq!(metadata.upload(id).await.unwrap().unwrap().state, UploadState::Complete(UploadPurpose::Stack));
    assert!(!metadata.upload_is_open(id).await.unwrap());
    assert!(!metadata.refuse_upload(id, &Fault::new(Code::InvalidArchive, "no")).await.unwrap());
    assert!(metadata.delete_upload(id).await.unwrap());
    assert!(metadata.job(id).await.unwrap().is_some(), "the job is kept");
}

pub async fn a_refused_upload_becomes_no_job(store: Fresh) {
    let metadata = &*store.metadata;
    let id = begun(metadata, 100).await;
    metadata.advance_upload(id, &advance(0, 100)).await.unwrap();
    let fault = Fault::new(Code::InvalidArchive, "no zip");
    assert!(metadata.refuse_upload(id, &fault).await.unwrap());
    assert_eq!(metadata.upload(id).await.unwrap().unwrap().state, UploadState::Refused(Box::new(fault)));
    assert_eq!(metadata.complete_upload(&job(id), 10).await.unwrap(), None);
    assert!(!metadata.upload_is_open(id).await.unwrap());
    assert_eq!(metadata.job(id).await.unwrap(), None);
}

pub async fn an_upload_expires_unless_more_bytes_arrive(store: Fresh) {
    let metadata = &*store.metadata;
    let (kept, left) = (begun(metadata, 100).await, begun(metadata, 100).await);
    store.clock.advance(KEEP - Duration::from_secs(1));
    assert!(metadata.delete_expired_uploads().await.unwrap().is_empty());
    assert!(metadata.advance_upload(kept, &advance(0, 1)).await.unwrap());
    store.clock.advance(Duration::from_secs(1));
    assert_eq!(metadata.upload(left).await.unwrap(), None, "it has expired before garbage collection");
    assert_eq!(metadata.take_over_upload(left).await.unwrap(), None);
    let expired = metadata.delete_expired_uploads().await.unwrap();
    assert_eq!(expired, [ExpiredUpload { id: left, was_open: true }]);
    assert!(metadata.upload(kept).await.unwrap().is_some());
}

pub async fn only_open_uploads_are_counted(store: Fresh) {
    let metadata = &*store.metadata;
    let (open, whole, refused) = (begun(metadata, 100).await, begun(metadata, 10).await, begun(metadata, 1000).await);
    metadata.advance_upload(open, &advance(0, 30)).await.unwrap();
    assert_eq!(metadata.reserved_bytes().await.unwrap(), 70 + 10 + 1000);
    metadata.advance_upload(whole, &advance(0, 10)).await.unwrap();
    metadata.complete_upload(&job(whole), 10).await.unwrap();
    metadata.refuse_upload(refused, &Fault::new(Code::InvalidArchive, "no zip")).await.unwrap();
    assert_eq!(metadata.reserved_bytes().await.unwrap(), 70);
    let new =
        NewUpload { id: Uuid::now_v7(), length: 1, digest: vec![0], metadata: String::new(), keep: KEEP, owner: None };
    let at_most = |all| OpenUploadLimits { all, of_owner: 1000 };
    assert_eq!(metadata.create_upload(&new, at_most(1)).await.unwrap(), CreateUpload::TooMany { of_owner: false });
    assert!(matches!(metadata.create_upload(&new, at_most(2)).await.unwrap(), CreateUpload::Created(_)));
    let few = OpenUploadLimits { all: 1000, of_owner: 1 };
    let by = |owner| NewUpload { id: Uuid::now_v7(), owner, ..new.clone() };
    let (ann, ben) = (Some(Uuid::now_v7()), Some(Uuid::now_v7()));
    for owner in [None, ann, ben] {
        assert!(
            matches!(metadata.create_upload(&by(owner), few).await.unwrap(), CreateUpload::Created(_)),
            "{owner:?}"
        );
    }
    assert_eq!(metadata.create_upload(&by(ann), few).await.unwrap(), CreateUpload::TooMany { of_owner: true });
    assert!(matches!(metadata.create_upload(&by(None), few).await.unwrap(), CreateUpload::Created(_)));
    store.clock.advance(KEEP);
    assert_eq!(metadata.reserved_bytes().await.unwrap(), 0);
}

pub async fn open_uploads_are_listed_newest_first_with_their_tokens(store: Fresh) {
    let metadata = &*store.metadata;
    let ann = Uuid::now_v7();
    assert!(metadata.add_token(&token(ann, None)).await.unwrap());
    let of_ann = NewUpload { id: Uuid::now_v7(), owner: Some(ann), ..new(7) };
    assert!(matches!(metadata.create_upload(&of_ann, MANY).await.unwrap(), CreateUpload::Created(_)));
    let (second, whole, third) = (begun(metadata, 100).await, begun(metadata, 10).await, begun(metadata, 1000).await);
    metadata.refuse_upload(whole, &Fault::new(Code::InvalidArchive, "no zip")).await.unwrap();
    metadata.advance_upload(second, &advance(0, 30)).await.unwrap();
    let first = metadata.list_open_uploads(&page(2, None)).await.unwrap();
    let shown =
        |open: &OpenUpload| (open.upload.id, open.token.clone(), open.upload.offset, open.last_byte_at.is_some());
    assert_eq!(first.items.iter().map(shown).collect::<Vec<_>>(), [(third, None, 0, false), (second, None, 30, true)]);
    let last = metadata.list_open_uploads(&page(2, first.next_cursor)).await.unwrap();
    assert_eq!(last.items.iter().map(shown).collect::<Vec<_>>(), [(of_ann.id, Some("ann".into()), 0, false)]);
    assert_eq!(last.next_cursor, None);
    let foreign = metadata.list_open_uploads(&page(2, Some("x".into()))).await;
    assert!(matches!(foreign, Err(StoreError::InvalidCursor)), "{foreign:?}");
    store.clock.advance(KEEP);
    assert!(metadata.list_open_uploads(&page(2, None)).await.unwrap().items.is_empty());
}

pub async fn a_quota_holds_under_concurrent_requests(store: Fresh) {
    let ann = Uuid::now_v7();
    // in these tests, the upload of a stack has 12 bytes
    assert!(store.metadata.add_token(&token(ann, Some(100))).await.unwrap());
    let mut asking = tokio::task::JoinSet::new();
    for i in 0..30 {
        let metadata = std::sync::Arc::clone(&store.metadata);
        asking.spawn(async move {
            if i % 2 == 0 {
                let upload = NewUpload { owner: Some(ann), ..new(40) };
                matches!(metadata.create_upload(&upload, MANY).await.unwrap(), CreateUpload::Created(_))
            } else {
                let job = NewJob { owner: Some(ann), ..stack() };
                matches!(metadata.enqueue(&job, 1000).await.unwrap(), Enqueue::Accepted(_))
            }
        });
    }
    let mut accepted = 0;
    while let Some(ended) = asking.join_next().await {
        accepted += u32::from(ended.unwrap());
    }
    let used = store.metadata.used_bytes(ann).await.unwrap();
    assert!(accepted > 0 && (100 - 11..=100).contains(&used), "{accepted} were accepted, {used} bytes are used");
    let over = OverQuota { token: "ann".into(), used, quota: 100 };
    let refused = store.metadata.create_upload(&NewUpload { owner: Some(ann), ..new(u64::MAX) }, MANY).await.unwrap();
    assert_eq!(refused, CreateUpload::OverQuota(over.clone()));
    let job = NewJob { owner: Some(ann), ..stack() };
    assert_eq!(store.metadata.enqueue(&job, 1000).await.unwrap(), Enqueue::OverQuota(over));
    let others = NewJob { owner: Some(Uuid::now_v7()), ..stack() };
    assert!(matches!(store.metadata.enqueue(&others, 1000).await.unwrap(), Enqueue::Accepted(_)));
}

pub async fn concurrent_repeats_of_a_key_make_one_job_within_a_quota_for_one(store: Fresh) {
    let ann = Uuid::now_v7();
    assert!(store.metadata.add_token(&token(ann, Some(12))).await.unwrap());
    let mut asking = tokio::task::JoinSet::new();
    for _ in 0..30 {
        let metadata = std::sync::Arc::clone(&store.metadata);
        let job = NewJob { owner: Some(ann), idempotency: Some(("key".into(), "same".into())), ..stack() };
        asking.spawn(async move { metadata.enqueue(&job, 1000).await.unwrap() });
    }
    let mut ids = std::collections::BTreeSet::new();
    while let Some(ended) = asking.join_next().await {
        match ended.unwrap() {
            Enqueue::Accepted(job) | Enqueue::Repeated(job) => ids.insert(job.id),
            other => panic!("{other:?}"),
        };
    }
    assert_eq!(ids.len(), 1);
}

fn new(length: u64) -> NewUpload {
    NewUpload { id: Uuid::now_v7(), length, digest: vec![0], metadata: String::new(), keep: KEEP, owner: None }
}

fn token(id: Uuid, quota_bytes: Option<u64>) -> NewToken {
    NewToken { id, name: name("ann"), digest: [0; 32], scopes: vec![], quota_bytes }
}
