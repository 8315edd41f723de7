//! Time to accept, claim, keep and end a job while many wait.

use std::time::{Duration, Instant};

use pinstack::{
    contract::Progress,
    store::{
        Enqueue, MetadataStore,
        conformance::{LEASE, success},
    },
};

use crate::store::{fill, job, open, put_profiles, schema};

const DEPTHS: [usize; 3] = [10, 1_000, 100_000];
/// Jobs measured at each depth.
const MEASURED: usize = 200;

/// Prints the table for both engines.
pub async fn run() {
    println!("milliseconds, median and 95 %");
    println!("engine    waiting         accept          claim      heartbeat            end");
    for (engine, database) in [("SQLite", None), ("Postgres", Some(schema().await))] {
        let folder = tempfile::tempdir().expect("a folder");
        let store = open(folder.path(), database.as_deref()).await;
        put_profiles(&*store.metadata).await;
        for depth in DEPTHS {
            fill(&*store.metadata, depth).await;
            let [accept, claim, beat, end] = measure(&*store.metadata).await.map(told);
            println!("{engine:<9} {depth:>7} {accept:>14} {claim:>14} {beat:>14} {end:>14}");
        }
        store.metadata.close().await;
    }
}

async fn measure(metadata: &dyn MetadataStore) -> [Vec<Duration>; 4] {
    let mut times: [Vec<Duration>; 4] = Default::default();
    for number in 0..MEASURED {
        let new = job(number);
        let begun = Instant::now();
        let accepted = metadata.enqueue(&new, u64::MAX).await.expect("enqueue");
        times[0].push(begun.elapsed());
        assert!(matches!(accepted, Enqueue::Accepted(_)));
        let begun = Instant::now();
        let claimed = metadata.claim(LEASE, 3, None).await.expect("claim").expect("jobs wait");
        times[1].push(begun.elapsed());
        let progress = Progress { stage: "fusing".into(), completed: 1, total: 2, fraction: 0.5 };
        let begun = Instant::now();
        metadata.heartbeat(claimed.id, claimed.lease_token, LEASE, &progress).await.expect("heartbeat");
        times[2].push(begun.elapsed());
        let begun = Instant::now();
        assert!(metadata.finish(claimed.id, claimed.lease_token, &success()).await.expect("finish"));
        times[3].push(begun.elapsed());
    }
    times
}

fn told(mut times: Vec<Duration>) -> String {
    times.sort_unstable();
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize].as_secs_f64() * 1e3;
    format!("{:.2}, {:.2}", at(0.5), at(0.95))
}
