//! Time to find stacks among many: a page of the list, and the numbers by verdict.

use std::time::{Duration, Instant};

use jiff::Timestamp;
use pinstack::{
    contract::{JobKind, JobState, Verdict},
    store::{
        EnqueueAll, JobFilter, MetadataStore, NewJob, PageRequest,
        conformance::{LEASE, name, stack_with, success},
    },
};

use crate::store::{RIGS, open, put_profiles, schema};

const SIZES: [usize; 2] = [1_000, 100_000];
/// Stacks that have ended, and so have a verdict.
const ENDED: usize = 500;
const MEASURED: usize = 50;

/// Prints the table for both engines.
pub async fn run() {
    println!("milliseconds, median and 95 %: a page of 24, and the numbers by verdict");
    println!("engine     stacks  search                            page        numbers");
    for (engine, database) in [("SQLite", None), ("Postgres", Some(schema().await))] {
        let folder = tempfile::tempdir().expect("a folder");
        let store = open(folder.path(), database.as_deref()).await;
        let metadata = &*store.metadata;
        put_profiles(metadata).await;
        let mut stored = 0;
        for size in SIZES {
            fill(metadata, stored, size).await;
            stored = size;
            for _ in 0..ENDED {
                let claimed = metadata.claim(LEASE, 3, None).await.expect("claim").expect("jobs wait");
                assert!(metadata.finish(claimed.id, claimed.lease_token, &success()).await.expect("finish"));
            }
            for (what, filter) in searches(size) {
                let filter = JobFilter { kind: Some(JobKind::Stack), ..filter };
                let page = measured(async || drop(metadata.jobs(&filter, &first()).await.expect("a page"))).await;
                let numbers = measured(async || {
                    metadata.found(&filter).await.expect("numbers");
                })
                .await;
                println!("{engine:<9} {size:>7}  {what:<24} {page:>14} {numbers:>14}");
            }
        }
        store.metadata.close().await;
    }
}

fn searches(size: usize) -> Vec<(&'static str, JobFilter)> {
    let q = |text: String| JobFilter { q: Some(text), ..JobFilter::default() };
    vec![
        ("all", JobFilter::default()),
        ("word of one, the oldest", q("specimen-0000017".into())),
        ("word of all", q("beet".into())),
        ("two words of all", q("beetle rig".into())),
        ("rig", JobFilter { rig: Some(name("rig-7")), ..JobFilter::default() }),
        ("rig and a word of all", JobFilter { rig: Some(name("rig-7")), ..q("beetle".into()) }),
        ("verdict", JobFilter { verdict: Some(Verdict::Use), ..JobFilter::default() }),
        ("verdict of none", JobFilter { verdict: Some(Verdict::DoNotUse), ..q("beetle".into()) }),
        ("running, a word of all", JobFilter { state: Some(JobState::Running), ..q("beetle".into()) }),
        ("word of none", q(format!("specimen-{size}9"))),
        ("since now", JobFilter { since: Some(Timestamp::now()), ..JobFilter::default() }),
    ]
}

fn first() -> PageRequest {
    PageRequest { limit: 24, cursor: None }
}

/// Accepts stacks with labels until there are `size`.
async fn fill(metadata: &dyn MetadataStore, stored: usize, size: usize) {
    let job = |number: usize| {
        let labelled = stack_with(|request| request.options.label = Some(format!("beetle specimen-{number:07}")));
        NewJob { rig: name(&format!("rig-{}", number % RIGS)), lens: name("lens"), ..labelled }
    };
    let numbers: Vec<usize> = (stored..size).collect();
    for batch in numbers.chunks(1000) {
        let jobs: Vec<NewJob> = batch.iter().map(|number| job(*number)).collect();
        let accepted = metadata.enqueue_all(&jobs, u64::MAX).await.expect("enqueue_all");
        assert!(matches!(accepted, EnqueueAll::Accepted(_)), "{accepted:?}");
    }
}

async fn measured(work: impl AsyncFn()) -> String {
    let mut times: Vec<Duration> = Vec::with_capacity(MEASURED);
    for _ in 0..MEASURED {
        let begun = Instant::now();
        work().await;
        times.push(begun.elapsed());
    }
    times.sort_unstable();
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize].as_secs_f64() * 1e3;
    format!("{:.2}, {:.2}", at(0.5), at(0.95))
}
