//! The database itself: several processes open it, programs of other versions made it, statements change its rows.

use async_trait::async_trait;

use super::*;
use crate::store::{Clock, JobFilter, Retention, StoreResult, SystemClock};

/// A database behind a store.
#[async_trait]
pub trait Database: Send + Sync {
    /// Opens it, as another process does.
    async fn open(&self, clock: Arc<dyn Clock>) -> StoreResult<Arc<dyn MetadataStore>>;
    /// Executes a statement. Returns the texts that it selects.
    async fn execute(&self, sql: &'static str) -> Result<Vec<String>, sqlx::Error>;
}

async fn opened(database: &dyn Database) -> Arc<dyn MetadataStore> {
    database.open(Arc::new(SystemClock)).await.expect("open")
}

pub async fn accepted_jobs_and_profiles_survive_a_reopen(store: Fresh) {
    let job = accept(&*store.metadata, &stack()).await;
    let profile = put(&*store.metadata, "rig", "lens", 1.5).await;
    drop(store.metadata); // not closed, as after a kill
    let metadata = opened(&*store.database).await;
    assert_eq!(metadata.job(job.id).await.unwrap(), Some(job));
    assert_eq!(metadata.profile(&profile.rig, &profile.lens, None).await.unwrap(), Some(profile));
    metadata.close().await;
}

pub async fn two_processes_on_one_database_never_claim_the_same_job(store: Fresh) {
    // two stores share nothing but the database, like two processes
    let (one, two) = tokio::join!(opened(&*store.database), opened(&*store.database));
    for _ in 0..10 {
        accept(&*one, &stack()).await;
    }
    let drain = async |metadata: &dyn MetadataStore| {
        let mut claimed = Vec::new();
        while let Some(job) = claim(metadata).await {
            claimed.push(job.id);
        }
        claimed
    };
    let (mut claimed, others) = tokio::join!(drain(&*one), drain(&*two));
    claimed.extend(others);
    claimed.sort();
    claimed.dedup();
    assert_eq!(claimed.len(), 10);
    assert_eq!(two.counts().await.unwrap().running, 10);
}

pub async fn limits_hold_for_concurrent_requests_of_two_processes(store: Fresh) {
    let (one, two) = (opened(&*store.database).await, opened(&*store.database).await);
    let posts = (0..30).map(|i| {
        let metadata = Arc::clone(if i % 2 == 0 { &one } else { &two });
        tokio::spawn(async move { metadata.enqueue(&stack(), 7).await.unwrap() })
    });
    let answers = futures::future::join_all(posts).await;
    let accepted = answers.iter().filter(|answer| matches!(answer, Ok(Enqueue::Accepted(_)))).count();
    assert_eq!((accepted, one.counts().await.unwrap().queued), (7, 7));
}

pub async fn a_database_of_another_version_is_refused(store: Fresh) {
    for (sql, told) in [
        (
            "UPDATE _sqlx_migrations SET version = 999 WHERE version = (SELECT max(version) FROM _sqlx_migrations)",
            "migrated by a newer version of pinstack (to schema 999)",
        ),
        ("UPDATE _sqlx_migrations SET version = 1 WHERE version = 999", "from before the first release"),
    ] {
        store.database.execute(sql).await.unwrap();
        let refused = store.database.open(store.clock.clone()).await.err().expect("another version").to_string();
        assert!(refused.contains("the database ") && refused.contains(told), "{refused}");
    }
}

pub async fn the_identity_of_a_service_outlives_its_processes(store: Fresh) {
    let id = store.metadata.service_id().await.unwrap();
    // a second process of the service, and one that starts later
    let beside = store.database.open(store.clock.clone()).await.unwrap();
    assert_eq!(beside.service_id().await.unwrap(), id);
    store.metadata.close().await;
    beside.close().await;
    let later = store.database.open(store.clock.clone()).await.unwrap();
    assert_eq!(later.service_id().await.unwrap(), id);
    assert!(!id.is_nil());
}

pub async fn revisions_and_offsets_are_protected_even_from_sql(store: Fresh) {
    let metadata = &*store.metadata;
    let put = put(metadata, "rig", "lens", 1.5).await;
    let id = uploads::begun(metadata, 100).await;
    assert!(metadata.advance_upload(id, &uploads::advance(0, 60)).await.unwrap());
    for wrong in [
        "UPDATE revisions SET body = '{}'",
        "DELETE FROM revisions",
        "UPDATE revision_heads SET head = '{}'",
        "DELETE FROM revision_heads",
        "UPDATE uploads SET received = 59",
        "UPDATE uploads SET received = 101",
    ] {
        assert!(store.database.execute(wrong).await.is_err(), "{wrong}");
    }
    assert_eq!(metadata.profile(&put.rig, &put.lens, None).await.unwrap(), Some(put));
    assert_eq!(metadata.upload(id).await.unwrap().unwrap().offset, 60);
}

pub async fn a_clock_that_jumped_while_no_server_ran_expires_nothing_until_it_is_confirmed(store: Fresh) {
    let metadata = &*store.metadata;
    accept(metadata, &stack_with(|request| request.options.keep_days = Some(1))).await;
    let job = claim(metadata).await.unwrap();
    assert!(metadata.finish(job.id, job.lease_token, &success()).await.unwrap());
    assert!(metadata.delete_expired_jobs(&Retention::default()).await.unwrap().is_empty());
    metadata.close().await;

    let later = ManualClock::default();
    later.set_wall_by(10 * 24 * 60 * 60 * 1000);
    let metadata = store.database.open(Arc::new(later)).await.unwrap();
    for _ in 0..2 {
        assert!(metadata.delete_expired_jobs(&Retention::default()).await.unwrap().is_empty());
    }
    metadata.confirm_clock().await.unwrap();
    assert_eq!(metadata.delete_expired_jobs(&Retention::default()).await.unwrap(), [job.id]);
}

pub async fn a_job_with_an_unreadable_row_is_listed_as_skipped_and_fails_when_it_is_claimed(store: Fresh) {
    let metadata = &*store.metadata;
    let broken = accept(metadata, &stack()).await;
    let next = accept(metadata, &stack()).await;
    let damage = "UPDATE jobs SET request = replace(request, '\"width\":64', '\"width\":\"wide\"')
                  WHERE seq = (SELECT min(seq) FROM jobs)";
    store.database.execute(damage).await.unwrap();
    let listed = metadata.jobs(&JobFilter::default(), &page(10, None)).await.unwrap();
    let skipped: Vec<String> = listed.skipped.into_iter().map(|row| row.id).collect();
    assert_eq!((listed.items, skipped), (vec![next.clone()], vec![broken.id.to_string()]));
    assert_eq!(metadata.blob_keys(broken.id).await.unwrap(), [broken.request.upload().key.as_str()]);
    assert_eq!(claim(metadata).await.map(|claimed| claimed.id), Some(next.id), "the queue continues");
    let ended = "SELECT state || ' ' || error FROM jobs WHERE seq = (SELECT min(seq) FROM jobs)";
    let ended = store.database.execute(ended).await.unwrap().concat();
    assert!(ended.starts_with("failed ") && ended.contains("cannot be read any more"), "{ended}");
}
