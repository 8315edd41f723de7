//! Garbage collection over metadata and blobs.

use super::{
    blobs::{is_stored, put_blob},
    uploads::{advance, begun},
    *,
};
use crate::{
    contract::JobState,
    store::{
        EnqueueAll, Retention,
        blobs::{result_key, upload_key},
        gc::{GRACE, collect, gc_job, jobs_with_blobs},
    },
};

/// For ever, unless the job itself specifies it.
const KEEP: Retention = Retention { stacks: None, failed: None, uploads: None };

pub async fn garbage_collection_keeps_what_rows_refer_to_and_removes_the_rest(fresh: FreshStore) {
    let FreshStore { store, .. } = &fresh;
    let metadata = &*store.metadata;
    let accept_with_upload = async || {
        let job = stack();
        put_blob(store, &upload_key(job.id), b"bytes").await;
        accept(metadata, &job).await.id
    };
    let succeeded = accept_with_upload().await;
    let failed = accept_with_upload().await;
    let running = accept_with_upload().await;
    for id in [succeeded, failed, running] {
        assert_eq!(claim(metadata).await.unwrap().id, id);
        put_blob(store, &result_key(id, 0, "image.png"), b"bytes").await; // of an older lease
        put_blob(store, &result_key(id, 1, "image.png"), b"bytes").await;
    }
    assert!(metadata.finish(succeeded, 1, &success()).await.unwrap());
    let fault = crate::contract::Fault::new(crate::contract::Code::Internal, "no");
    assert!(metadata.finish(failed, 1, &super::super::Finish::Failed(fault)).await.unwrap());
    let waiting = accept_with_upload().await;
    let orphan = Uuid::now_v7();
    put_blob(store, &upload_key(orphan), b"bytes").await;
    put_blob(store, &result_key(orphan, 1, "image.png"), b"bytes").await;

    let collected = collect(store, GRACE, &KEEP).await.unwrap();
    assert_eq!(collected.orphans, 0, "its row may still be written");
    assert!(is_stored(store, &upload_key(orphan)).await);
    let collected = collect(store, Duration::ZERO, &KEEP).await.unwrap();
    assert_eq!(collected.orphans, 1);
    for (id, upload, result) in [
        (succeeded, true, true),
        (failed, true, false),
        (running, true, true),
        (waiting, true, false),
        (orphan, false, false),
    ] {
        assert_eq!(is_stored(store, &upload_key(id)).await, upload);
        assert_eq!(is_stored(store, &result_key(id, 1, "image.png")).await, result);
        assert!(!is_stored(store, &result_key(id, 0, "image.png")).await);
    }
}

pub async fn the_blobs_of_expired_and_deleted_jobs_are_removed(fresh: FreshStore) {
    let FreshStore { store, clock } = &fresh;
    let metadata = &*store.metadata;
    let mut ids = Vec::new();
    for _ in 0..2 {
        let job = stack_with(|request| request.options.keep_days = Some(1));
        put_blob(store, &upload_key(job.id), b"bytes").await;
        accept(metadata, &job).await;
        assert!(metadata.finish(claim(metadata).await.unwrap().id, 1, &success()).await.unwrap());
        put_blob(store, &result_key(job.id, 1, "image.png"), b"bytes").await;
        ids.push(job.id);
    }
    assert!(metadata.delete_job(ids[0]).await.unwrap());
    gc_job(store, ids[0]).await.unwrap();
    assert!(!is_stored(store, &upload_key(ids[0])).await);
    assert!(is_stored(store, &upload_key(ids[1])).await);
    clock.advance(Duration::from_secs(24 * 60 * 60));
    assert_eq!(collect(store, GRACE, &KEEP).await.unwrap().expired, 1);
    assert!(jobs_with_blobs(&*store.blobs).await.unwrap().is_empty());
}

pub async fn zips_of_a_scan_are_kept_while_its_upload_is_open_however_long_they_take_to_store(fresh: FreshStore) {
    let FreshStore { store, .. } = &fresh;
    let metadata = &*store.metadata;
    let upload = begun(metadata, 100).await;
    let first_view = Uuid::now_v7();
    put_blob(store, &upload_key(first_view), b"bytes").await;
    let collect = async || collect(store, Duration::ZERO, &KEEP).await.unwrap();
    metadata.advance_upload(upload, &advance(0, 99)).await.unwrap();
    assert_eq!(collect().await.orphans, 1, "nothing of an incomplete upload is stored");
    metadata.advance_upload(upload, &advance(99, 100)).await.unwrap();
    put_blob(store, &upload_key(first_view), b"bytes").await;
    assert_eq!(collect().await.orphans, 0);
    assert!(is_stored(store, &upload_key(first_view)).await);
    let view = NewJob { id: first_view, ..stack() };
    let made = metadata.complete_scan_upload(upload, &[view], 10).await.unwrap();
    assert!(matches!(made, Some(EnqueueAll::Accepted(_))), "{made:?}");
    let orphan = Uuid::now_v7();
    put_blob(store, &upload_key(orphan), b"bytes").await;
    assert_eq!(collect().await.orphans, 1, "the upload is not open any more");
    assert!(is_stored(store, &upload_key(first_view)).await && !is_stored(store, &upload_key(orphan)).await);
}

pub async fn only_uploads_that_waited_count_as_given_up(fresh: FreshStore) {
    let FreshStore { store, clock } = &fresh;
    let metadata = &*store.metadata;
    let (waiting, complete) = (begun(metadata, 100).await, begun(metadata, 100).await);
    metadata.advance_upload(complete, &advance(0, 100)).await.unwrap();
    put_blob(store, &upload_key(complete), b"bytes").await;
    metadata.complete_upload(&NewJob { id: complete, ..stack() }, 10).await.unwrap();
    clock.advance(Duration::from_secs(2 * 3600));
    assert_eq!(collect(store, GRACE, &KEEP).await.unwrap().given_up, 1);
    assert!(metadata.upload(waiting).await.unwrap().is_none());
    assert!(is_stored(store, &upload_key(complete)).await, "its stack is kept");
}

pub async fn jobs_and_zips_expire_by_their_retention_times(fresh: FreshStore) {
    const DAY: Duration = Duration::from_secs(24 * 60 * 60);
    let FreshStore { store, clock } = &fresh;
    let metadata = &*store.metadata;
    let mut ids = Vec::new();
    for keep_days in [None, Some(30), None, None] {
        let job = stack_with(|request| request.options.keep_days = keep_days);
        put_blob(store, &upload_key(job.id), b"bytes").await;
        accept(metadata, &job).await;
        assert_eq!(claim(metadata).await.unwrap().id, job.id);
        put_blob(store, &result_key(job.id, 1, "image.png"), b"bytes").await;
        ids.push(job.id);
    }
    let [plain, own, failed, running] = ids[..] else { panic!("four jobs") };
    for id in [plain, own] {
        assert!(metadata.finish(id, 1, &success()).await.unwrap());
    }
    let fault = crate::contract::Fault::new(crate::contract::Code::Internal, "no");
    assert!(metadata.finish(failed, 1, &super::super::Finish::Failed(fault)).await.unwrap());
    let keep = Retention { stacks: Some(DAY * 10), failed: Some(DAY * 2), uploads: Some(DAY) };
    let there = async |id| {
        let upload = is_stored(store, &upload_key(id)).await;
        (upload, is_stored(store, &result_key(id, 1, "image.png")).await)
    };

    clock.advance(DAY);
    let collected = collect(store, GRACE, &keep).await.unwrap();
    assert_eq!((collected.uploads, collected.expired), (2, 0));
    assert_eq!((there(plain).await, there(own).await), ((false, true), (false, true)), "results stay");
    assert!(job(metadata, plain).await.upload_removed && !job(metadata, failed).await.upload_removed);
    assert_eq!((there(failed).await, there(running).await), ((true, false), (true, true)));
    assert_eq!(collect(store, GRACE, &keep).await.unwrap().uploads, 0, "once");

    clock.advance(DAY);
    assert_eq!(collect(store, GRACE, &keep).await.unwrap().expired, 1);
    assert_eq!((there(failed).await, metadata.job(failed).await.unwrap()), ((false, false), None));

    clock.advance(DAY * 8);
    assert_eq!(collect(store, GRACE, &keep).await.unwrap().expired, 1);
    assert_eq!(
        (there(plain).await, there(own).await),
        ((false, false), (false, true)),
        "keep_days of the job comes first"
    );
    assert_eq!(job(metadata, running).await.state, JobState::Running);
    clock.advance(DAY * 20);
    assert_eq!(collect(store, GRACE, &keep).await.unwrap().expired, 1);
    assert_eq!(there(own).await, (false, false));
}
