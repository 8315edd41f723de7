//! Uploads that arrive in pieces.

use std::time::Duration;

use uuid::Uuid;

use super::{Fresh, stack};
use crate::{
    model::{Code, Fault, JobKind},
    store::{
        Enqueue, NewJob, UploadRows,
        uploads::{Advance, NewUpload, UploadState},
    },
};

const KEEP: Duration = Duration::from_secs(3600);

pub(crate) async fn begun(rows: &dyn UploadRows, length: u64) -> Uuid {
    let new =
        NewUpload { id: Uuid::now_v7(), length, digest: vec![0], metadata: "rig cmln".into(), keep: KEEP, owner: None };
    let upload = rows.create_upload(&new, 1000).await.unwrap().expect("there is room for it");
    assert_eq!((upload.id, upload.length, upload.offset, upload.state), (new.id, length, 0, UploadState::Receiving));
    assert_eq!((upload.digest, upload.metadata.as_str()), (vec![0], "rig cmln"));
    new.id
}

pub(crate) fn advance(from: u64, to: u64) -> Advance {
    Advance { from, to, digest: to.to_le_bytes().to_vec(), keep: KEEP }
}

fn job(id: Uuid) -> NewJob {
    NewJob { id, ..stack() }
}

pub(crate) async fn an_upload_grows_only_from_where_it_is(store: Fresh) {
    let rows = &*store.rows;
    let id = begun(rows, 100).await;
    assert!(rows.advance_upload(id, &advance(0, 60)).await.unwrap());
    assert!(!rows.advance_upload(id, &advance(0, 70)).await.unwrap(), "it is at 60");
    assert!(!rows.advance_upload(Uuid::now_v7(), &advance(0, 70)).await.unwrap());
    assert!(rows.advance_upload(id, &advance(60, 101)).await.is_err(), "it has 100 bytes");
    let upload = rows.upload(id).await.unwrap().unwrap();
    assert_eq!((upload.offset, upload.digest), (60, 60_u64.to_le_bytes().to_vec()));
}

pub(crate) async fn a_newer_wish_has_a_larger_number_and_is_announced(store: Fresh) {
    let rows = &*store.rows;
    let id = begun(rows, 100).await;
    let mut changes = rows.changes();
    let first = rows.want_upload(id).await.unwrap().unwrap();
    assert_eq!(changes.recv().await.unwrap(), id);
    let second = rows.want_upload(id).await.unwrap().unwrap();
    assert!(second > first);
    assert_eq!(rows.upload(id).await.unwrap().unwrap().wanted, second);
    assert_eq!(rows.want_upload(Uuid::now_v7()).await.unwrap(), None);
}

pub(crate) async fn a_whole_upload_becomes_one_job_and_a_torn_one_none(store: Fresh) {
    let rows = &*store.rows;
    let id = begun(rows, 100).await;
    rows.advance_upload(id, &advance(0, 99)).await.unwrap();
    assert_eq!(rows.complete_upload(&job(id), 10).await.unwrap(), None);
    rows.advance_upload(id, &advance(99, 100)).await.unwrap();
    assert_eq!(rows.complete_upload(&job(id), 0).await.unwrap(), Some(Enqueue::QueueFull { waiting: 0 }));
    assert!(rows.upload_is_open(id).await.unwrap());
    let made = rows.complete_upload(&job(id), 10).await.unwrap();
    let Some(Enqueue::Accepted(first)) = made else { panic!("{made:?}") };
    assert_eq!(rows.complete_upload(&job(id), 10).await.unwrap(), Some(Enqueue::Repeated(first.clone())));
    assert_eq!(rows.job(id).await.unwrap(), Some(*first));
    assert_eq!(rows.upload(id).await.unwrap().unwrap().state, UploadState::Complete(JobKind::Stack));
    assert!(!rows.upload_is_open(id).await.unwrap());
    assert!(!rows.refuse_upload(id, &Fault::new(Code::InvalidArchive, "no")).await.unwrap());
    assert!(rows.delete_upload(id).await.unwrap());
    assert!(rows.job(id).await.unwrap().is_some(), "the job stays");
}

pub(crate) async fn a_refused_upload_becomes_no_job(store: Fresh) {
    let rows = &*store.rows;
    let id = begun(rows, 100).await;
    rows.advance_upload(id, &advance(0, 100)).await.unwrap();
    let fault = Fault::new(Code::InvalidArchive, "no zip");
    assert!(rows.refuse_upload(id, &fault).await.unwrap());
    assert_eq!(rows.upload(id).await.unwrap().unwrap().state, UploadState::Refused(Box::new(fault)));
    assert_eq!(rows.complete_upload(&job(id), 10).await.unwrap(), None);
    assert!(!rows.upload_is_open(id).await.unwrap());
    assert_eq!(rows.job(id).await.unwrap(), None);
}

pub(crate) async fn an_upload_goes_when_its_time_is_over_and_each_piece_gives_it_more(store: Fresh) {
    let rows = &*store.rows;
    let (kept, left) = (begun(rows, 100).await, begun(rows, 100).await);
    store.clock.advance(KEEP - Duration::from_secs(1));
    assert!(rows.delete_expired_uploads().await.unwrap().is_empty());
    assert!(rows.advance_upload(kept, &advance(0, 1)).await.unwrap());
    store.clock.advance(Duration::from_secs(1));
    assert_eq!(rows.upload(left).await.unwrap(), None, "it is gone before anybody swept");
    assert_eq!(rows.want_upload(left).await.unwrap(), None);
    assert_eq!(rows.delete_expired_uploads().await.unwrap(), [left]);
    assert!(rows.upload(kept).await.unwrap().is_some());
}

pub(crate) async fn only_open_uploads_are_counted(store: Fresh) {
    let rows = &*store.rows;
    let (open, whole, refused) = (begun(rows, 100).await, begun(rows, 10).await, begun(rows, 1000).await);
    rows.advance_upload(open, &advance(0, 30)).await.unwrap();
    assert_eq!(rows.awaited_bytes().await.unwrap(), 70 + 10 + 1000);
    rows.advance_upload(whole, &advance(0, 10)).await.unwrap();
    rows.complete_upload(&job(whole), 10).await.unwrap();
    rows.refuse_upload(refused, &Fault::new(Code::InvalidArchive, "no zip")).await.unwrap();
    assert_eq!(rows.awaited_bytes().await.unwrap(), 70);
    let new =
        NewUpload { id: Uuid::now_v7(), length: 1, digest: vec![0], metadata: String::new(), keep: KEEP, owner: None };
    assert_eq!(rows.create_upload(&new, 1).await.unwrap(), None, "one is open");
    assert!(rows.create_upload(&new, 2).await.unwrap().is_some());
    store.clock.advance(KEEP);
    assert_eq!(rows.awaited_bytes().await.unwrap(), 0);
}
