//! Blobs, and the sweep over rows and blobs.

use std::{fs, path::PathBuf};

use super::*;
use crate::{
    contract::JobState,
    store::{
        Retention,
        blobs::{Blobs, result_key, upload_key},
        gc::{GRACE, collect, gc_job},
    },
};

/// For ever, where the job itself says nothing.
const KEEP: Retention = Retention { stacks: None, failed: None, uploads: None };

fn spooled(blobs: &dyn Blobs, bytes: &[u8]) -> PathBuf {
    let path = blobs.spool_dir().join(Uuid::now_v7().to_string());
    fs::write(&path, bytes).expect("write into the spool");
    path
}

async fn publish(blobs: &dyn Blobs, key: &str) {
    blobs.publish(&spooled(blobs, key.as_bytes()), key).await.expect("publish");
}

async fn is_there(blobs: &dyn Blobs, key: &str) -> bool {
    blobs.local_path(key).await.expect("look").is_some()
}

pub(crate) async fn a_published_file_is_the_blob_and_leaves_the_spool(blobs: &dyn Blobs) {
    let (job, path) = (Uuid::now_v7(), spooled(blobs, b"zip"));
    assert_eq!(blobs.local_path(&upload_key(job)).await.unwrap(), None);
    blobs.publish(&path, &upload_key(job)).await.unwrap();
    assert!(!path.exists());
    let found = blobs.local_path(&upload_key(job)).await.unwrap().expect("it is there");
    assert_eq!(fs::read(found).unwrap(), b"zip");
    let room = blobs.room().await.unwrap();
    assert!(room.free > 0 && room.free <= room.total);
}

pub(crate) async fn a_shared_blob_stays_until_the_last_of_its_jobs_is_deleted(blobs: &dyn Blobs) {
    let (first, again) = (Uuid::now_v7(), Uuid::now_v7());
    let path = blobs.spool_dir().join("shared");
    assert!(!blobs.share(&upload_key(first), &path).await.unwrap(), "there is no such blob");
    assert!(!path.exists());
    publish(blobs, &upload_key(first)).await;
    assert!(blobs.share(&upload_key(first), &path).await.unwrap());
    blobs.publish(&path, &upload_key(again)).await.unwrap();
    assert!(!path.exists());
    blobs.delete_job(first).await.unwrap();
    assert!(!is_there(blobs, &upload_key(first)).await);
    let found = blobs.local_path(&upload_key(again)).await.unwrap().expect("it is there");
    assert_eq!(fs::read(found).unwrap(), upload_key(first).as_bytes(), "the bytes of the first");
}

pub(crate) async fn no_key_leads_out_of_the_store(blobs: &dyn Blobs) {
    let path = spooled(blobs, b"x");
    for key in ["../x", "/etc/x", "uploads/../../x", "uploads//x", "", "a/.", "a\\b", "results/.hidden"] {
        assert!(blobs.publish(&path, key).await.is_err(), "{key}");
        assert!(blobs.local_path(key).await.is_err(), "{key}");
    }
    assert!(path.exists());
}

pub(crate) async fn deleting_a_job_removes_its_blobs_and_no_others(blobs: &dyn Blobs) {
    let (gone, kept) = (Uuid::now_v7(), Uuid::now_v7());
    for job in [gone, kept] {
        publish(blobs, &upload_key(job)).await;
        publish(blobs, &result_key(job, 1, "image.png")).await;
    }
    blobs.delete_job(gone).await.unwrap();
    blobs.delete_job(gone).await.unwrap();
    for (job, there) in [(gone, false), (kept, true)] {
        assert_eq!(is_there(blobs, &upload_key(job)).await, there);
        assert_eq!(is_there(blobs, &result_key(job, 1, "image.png")).await, there);
    }
    let listed: Vec<Uuid> = blobs.jobs_with_blobs().await.unwrap().into_iter().map(|job| job.id).collect();
    assert_eq!(listed, [kept]);
}

pub(crate) async fn only_results_of_older_leases_are_stale(blobs: &dyn Blobs) {
    let job = Uuid::now_v7();
    for lease in [1, 2, 3, 10] {
        publish(blobs, &result_key(job, lease, "image.png")).await;
    }
    blobs.delete_stale_results(job, 3).await.unwrap();
    for (lease, there) in [(1, false), (2, false), (3, true), (10, true)] {
        assert_eq!(is_there(blobs, &result_key(job, lease, "image.png")).await, there, "lease {lease}");
    }
    blobs.delete_stale_results(job, 11).await.unwrap();
    assert!(blobs.jobs_with_blobs().await.unwrap().is_empty());
    blobs.delete_stale_results(job, 11).await.unwrap();
}

pub(crate) async fn the_sweep_keeps_what_a_row_names_and_removes_the_rest(store: Fresh, blobs: &dyn Blobs) {
    let rows = &*store.rows;
    let accept_with_upload = async || {
        let job = stack();
        publish(blobs, &upload_key(job.id)).await;
        accept(rows, &job).await.id
    };
    let succeeded = accept_with_upload().await;
    let failed = accept_with_upload().await;
    let running = accept_with_upload().await;
    for id in [succeeded, failed, running] {
        assert_eq!(claim(rows).await.unwrap().id, id);
        publish(blobs, &result_key(id, 0, "image.png")).await; // of a lease before
        publish(blobs, &result_key(id, 1, "image.png")).await;
    }
    assert!(rows.finish(succeeded, 1, &success()).await.unwrap());
    let fault = crate::contract::Fault::new(crate::contract::Code::Internal, "no");
    assert!(rows.finish(failed, 1, &super::super::Finish::Failed(fault)).await.unwrap());
    let waiting = accept_with_upload().await;
    let orphan = Uuid::now_v7();
    publish(blobs, &upload_key(orphan)).await;
    publish(blobs, &result_key(orphan, 1, "image.png")).await;

    let swept = collect(rows, blobs, GRACE, &KEEP).await.unwrap();
    assert_eq!(swept.orphans, 0, "a row may be on its way");
    assert!(is_there(blobs, &upload_key(orphan)).await);
    let swept = collect(rows, blobs, Duration::ZERO, &KEEP).await.unwrap();
    assert_eq!(swept.orphans, 1);
    for (id, upload, result) in [
        (succeeded, true, true),
        (failed, true, false),
        (running, true, true),
        (waiting, true, false),
        (orphan, false, false),
    ] {
        assert_eq!(is_there(blobs, &upload_key(id)).await, upload);
        assert_eq!(is_there(blobs, &result_key(id, 1, "image.png")).await, result);
        assert!(!is_there(blobs, &result_key(id, 0, "image.png")).await);
    }
}

pub(crate) async fn the_blobs_of_expired_and_deleted_jobs_go(store: Fresh, blobs: &dyn Blobs) {
    let rows = &*store.rows;
    let mut ids = Vec::new();
    for _ in 0..2 {
        let job = stack_with(|request| request.options.keep_days = Some(1));
        publish(blobs, &upload_key(job.id)).await;
        accept(rows, &job).await;
        assert!(rows.finish(claim(rows).await.unwrap().id, 1, &success()).await.unwrap());
        publish(blobs, &result_key(job.id, 1, "image.png")).await;
        ids.push(job.id);
    }
    assert!(rows.delete_job(ids[0]).await.unwrap());
    gc_job(rows, blobs, ids[0]).await.unwrap();
    assert!(!is_there(blobs, &upload_key(ids[0])).await);
    assert!(is_there(blobs, &upload_key(ids[1])).await);
    store.clock.advance(Duration::from_secs(24 * 60 * 60));
    assert_eq!(collect(rows, blobs, GRACE, &KEEP).await.unwrap().expired, 1);
    assert!(blobs.jobs_with_blobs().await.unwrap().is_empty());
}

pub(crate) async fn what_is_over_its_time_goes_by_its_class(store: Fresh, blobs: &dyn Blobs) {
    const DAY: Duration = Duration::from_secs(24 * 60 * 60);
    let rows = &*store.rows;
    let mut ids = Vec::new();
    for keep_days in [None, Some(30), None, None] {
        let job = stack_with(|request| request.options.keep_days = keep_days);
        publish(blobs, &upload_key(job.id)).await;
        accept(rows, &job).await;
        assert_eq!(claim(rows).await.unwrap().id, job.id);
        publish(blobs, &result_key(job.id, 1, "image.png")).await;
        ids.push(job.id);
    }
    let [plain, own, failed, running] = ids[..] else { panic!("four jobs") };
    for id in [plain, own] {
        assert!(rows.finish(id, 1, &success()).await.unwrap());
    }
    let fault = crate::contract::Fault::new(crate::contract::Code::Internal, "no");
    assert!(rows.finish(failed, 1, &super::super::Finish::Failed(fault)).await.unwrap());
    let keep = Retention { stacks: Some(DAY * 10), failed: Some(DAY * 2), uploads: Some(DAY) };
    let there = async |id| {
        let upload = is_there(blobs, &upload_key(id)).await;
        (upload, is_there(blobs, &result_key(id, 1, "image.png")).await)
    };

    store.clock.advance(DAY);
    let swept = collect(rows, blobs, GRACE, &keep).await.unwrap();
    assert_eq!((swept.uploads, swept.expired), (2, 0));
    assert_eq!((there(plain).await, there(own).await), ((false, true), (false, true)), "results stay");
    assert!(job(rows, plain).await.upload_removed && !job(rows, failed).await.upload_removed);
    assert_eq!((there(failed).await, there(running).await), ((true, false), (true, true)));
    assert_eq!(collect(rows, blobs, GRACE, &keep).await.unwrap().uploads, 0, "once");

    store.clock.advance(DAY);
    assert_eq!(collect(rows, blobs, GRACE, &keep).await.unwrap().expired, 1);
    assert_eq!((there(failed).await, rows.job(failed).await.unwrap()), ((false, false), None));

    store.clock.advance(DAY * 8);
    assert_eq!(collect(rows, blobs, GRACE, &keep).await.unwrap().expired, 1);
    assert_eq!((there(plain).await, there(own).await), ((false, false), (false, true)), "its own days come first");
    assert_eq!(job(rows, running).await.state, JobState::Running);
    store.clock.advance(DAY * 20);
    assert_eq!(collect(rows, blobs, GRACE, &keep).await.unwrap().expired, 1);
    assert_eq!(there(own).await, (false, false));
}

pub(crate) async fn an_upload_in_pieces_is_held_by_one_at_a_time(blobs: &dyn Blobs) {
    let (id, other) = (Uuid::now_v7(), Uuid::now_v7());
    let held = blobs.hold_partial(id).await.unwrap().expect("nobody has it");
    assert!(blobs.hold_partial(id).await.unwrap().is_none());
    assert!(blobs.hold_partial(other).await.unwrap().is_some(), "another upload is free");
    drop(held);
    assert!(blobs.hold_partial(id).await.unwrap().is_some(), "let go of, it is free again");
    let mut listed = blobs.partials().await.unwrap();
    listed.sort();
    assert_eq!(listed, [id, other]);
    for id in [id, other] {
        blobs.remove_partial(id).await.unwrap();
        blobs.remove_partial(id).await.unwrap();
    }
    assert!(blobs.partials().await.unwrap().is_empty());
}

pub(crate) async fn what_lies_behind_the_offset_goes_and_what_is_missing_is_told(blobs: &dyn Blobs) {
    let id = Uuid::now_v7();
    let mut partial = blobs.hold_partial(id).await.unwrap().expect("nobody has it");
    assert!(partial.write("x".into()).await.is_err(), "it is not known where to begin");
    assert!(!partial.start_at(4).await.unwrap(), "there are no 4 bytes");
    assert!(partial.start_at(0).await.unwrap());
    for piece in ["0123", "4567"] {
        partial.write(piece.into()).await.unwrap();
    }
    partial.sync().await.unwrap();
    assert!(!partial.start_at(9).await.unwrap(), "there are 8 bytes");
    assert!(partial.start_at(6).await.unwrap());
    partial.write("ab".into()).await.unwrap();
    partial.sync().await.unwrap();
    assert!(partial.start_at(7).await.unwrap());
    blobs.publish(partial.path(), &upload_key(id)).await.unwrap();
    let published = blobs.local_path(&upload_key(id)).await.unwrap().expect("it is published");
    assert_eq!(std::fs::read(published).unwrap(), b"012345a");
    assert!(!partial.start_at(7).await.unwrap(), "it is elsewhere now");
}
