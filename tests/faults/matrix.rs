//! Every failpoint, with every fault, at its first and at later calls.

use std::{sync::Arc, time::Duration};

use tokio::{sync::Semaphore, task::JoinSet};

use crate::{
    elsewhere, steps,
    story::{Broken, Story},
};

/// Number of calls at which a failpoint fires: the first, the second, ... as far as the story gets.
const TIMES: usize = 8;
/// Deaths in one story: a job has three attempts.
pub const DEATHS: usize = 2;
/// Calls at which the disk is full, story by story: each of the first eight. A job that finds the disk full three times
/// fails.
const FULL: [[usize; 2]; 4] = [[1, 3], [2, 5], [4, 7], [6, 8]];
/// Failpoints that are called often, depending on the speed of the machine; more calls test nothing new.
const FEW: [&str; 2] = ["rows.heartbeat", "rows.claim"];
/// Stories in which a failpoint may be missed before it counts as out of reach. A cancel does nothing when its job has
/// ended already, which happens on a busy machine.
const MISSES: usize = 5;
/// Stories that run at a time: most of their time they wait for leases.
const SIDE_BY_SIDE: usize = 6;
/// Faults that must happen first so that the story reaches a failpoint: a job with a full disk returns to the queue.
const BEFORE: [(&str, &str); 2] = [
    ("rows.release", "artifact.make=1*return(full)->off;"),
    // a job takes less than the time between two heartbeats
    ("rows.heartbeat", "artifact.make=1*sleep(600)->off;"),
];

/// Repeats a request until it is acknowledged.
macro_rules! insist {
    ($story:ident . $call:ident ( $($argument:expr),* )) => {{
        let mut tries = 0;
        loop {
            match $story.$call($($argument),*).await {
                Ok(told) => break told,
                Err(Broken::Died | Broken::Refused) if tries < 3 => tries += 1,
                Err(broken) => panic!("it never succeeds: {broken:?}"),
            }
        }
    }};
}

/// A day of the service, with every kind of request. Returns the faults that requests observed.
pub async fn day(mut story: Story) -> Vec<String> {
    insist!(story.profile());

    insist!(story.scan());
    insist!(story.note("note"));
    let views = insist!(story.archive("scan"));
    assert_eq!(views.len(), 2, "both views became stacks");
    assert_eq!(insist!(story.archive("scan")), views, "a repeat is answered with the first stacks");
    let scan = insist!(story.begin_scan());
    while !insist!(story.rest_of_scan(&scan)) {}
    assert_eq!(insist!(story.count()), 4, "each zip became two stacks");
    insist!(story.delete("/v1/scans/bee?stacks=delete"));
    assert_eq!(insist!(story.count()), 0, "the stacks are deleted with their scan");

    let whole = insist!(story.post("first"));
    assert_eq!(insist!(story.post("first")), whole, "a repeat is answered with the first stack");
    assert_eq!(insist!(story.count()), 1, "however often it was asked for");
    let image = insist!(story.image(&whole));

    let again = insist!(story.rerun(&whole, "again"));
    assert_eq!(insist!(story.rerun(&whole, "again")), again, "a repeat is answered with the first rerun");
    assert_eq!(insist!(story.count()), 2, "however often it was asked for");
    assert_eq!(insist!(story.image(&again)), image, "the same options and zip give the same bytes");

    insist!(story.converted(&whole));
    insist!(story.garbage());

    let upload = insist!(story.begin_upload());
    let (length, mut told) = (story.length(), 0);
    insist!(story.piece(&upload, &mut told, length / 2));
    let in_pieces = loop {
        if let Some(job) = insist!(story.piece(&upload, &mut told, length)) {
            break job;
        }
    };
    assert_eq!(insist!(story.image(&in_pieces)), image, "the same stack gives the same bytes");
    assert_eq!(insist!(story.count()), 3, "an upload in pieces becomes one stack");

    let third = insist!(story.post("third"));
    let promised = insist!(story.cancel(&third));
    let ended = insist!(story.ended(&third));
    assert!(!promised || ended["state"] == "cancelled", "a cancel that was promised wins: {ended}");

    let given_up = insist!(story.begin_upload());
    insist!(story.delete(&given_up));
    insist!(story.delete(&whole));
    insist!(story.delete("/v1/profiles/rig/lens"));
    assert_eq!(insist!(story.image(&in_pieces)), image, "an image that was not deleted is still there");
    insist!(story.upload(&again));
    assert_eq!(insist!(story.count()), 3);
    story.end().await
}

/// Faults for the processes of one story in which the service is killed at the call `from` of a failpoint, and again at
/// the call after that one, which is repeated.
pub fn deaths(name: &str, from: usize) -> Vec<String> {
    [from, 1].map(|passed| format!("{name}={passed}*off->1*return(kill)->off")).to_vec()
}

/// The fault of a story in which the disk is full at these calls of a failpoint.
fn full(name: &str, calls: &[usize]) -> String {
    let mut before = 0;
    let steps: String = calls
        .iter()
        .map(|call| {
            let passed = call - before - 1;
            before = *call;
            format!("{passed}*off->1*return(full)->")
        })
        .collect();
    format!("{name}={steps}off")
}

/// A day with these faults: what broke.
async fn day_with(faults: Vec<String>) -> Vec<String> {
    let day =
        tokio::time::timeout(Duration::from_secs(300), async { day(Story::begin_with(&faults, None).await).await });
    day.await.unwrap_or_else(|_| panic!("{faults:?}: it hangs"))
}

/// The failpoints of the matrix, each with the faults that must happen before it.
fn matrix() -> Vec<(String, String)> {
    let elsewhere = elsewhere::steps();
    let names = steps::names().into_iter().filter(|name| !elsewhere.contains(&name.as_str()));
    let with_before = names.map(|name| {
        let before = BEFORE.iter().find(|(step, _)| *step == name).map(|(_, fault)| *fault).unwrap_or_default();
        (name, before.to_owned())
    });
    with_before.collect()
}

/// Runs stories of every failpoint of the matrix. `stories` returns how often the failpoint broke a request or a job.
async fn every_step<Stories>(stories: impl Fn(String, String, Arc<Semaphore>) -> Stories)
where
    Stories: Future<Output = usize> + Send + 'static,
{
    side_by_side(matrix(), |(name, before), turns| (name.clone(), stories(name, before, turns))).await;
}

/// Runs the stories of all parts of the matrix side by side. `stories` returns the name of its part too.
async fn side_by_side<Part, Stories>(
    parts: impl IntoIterator<Item = Part>,
    stories: impl Fn(Part, Arc<Semaphore>) -> (String, Stories),
) where
    Stories: Future<Output = usize> + Send + 'static,
{
    let turns = Arc::new(Semaphore::new(SIDE_BY_SIDE));
    let mut running = JoinSet::new();
    for part in parts {
        let (told, stories) = stories(part, Arc::clone(&turns));
        running.spawn(async move {
            println!("{told}: {} times", stories.await);
        });
    }
    let mut failed = Vec::new();
    while let Some(ended) = running.join_next().await {
        failed.extend(ended.err().map(|error| error.to_string()));
    }
    assert!(failed.is_empty(), "{} of the failpoints: {failed:#?}", failed.len());
}

/// Kills the service at the calls `from`, `from + 1` of each failpoint, `from + 2`, ... below `end`.
async fn killed(from: usize, end: usize) {
    every_step(move |name, before, turns| async move {
        let times = if FEW.contains(&name.as_str()) { DEATHS } else { end };
        let (mut broke, mut missed) = (0, 0);
        for from in (from..times).step_by(DEATHS) {
            // a cancel that comes after the end of its job reaches no failpoint
            let in_story = loop {
                let _turn = turns.acquire().await.expect("open");
                let faults = deaths(&name, from).into_iter().map(|fault| format!("{before}{fault}")).collect();
                let in_story = day_with(faults).await.len();
                missed += usize::from(in_story == 0);
                // that a later call is reached is not expected
                if in_story > 0 || from > 0 || missed == MISSES {
                    break in_story;
                }
            };
            broke += in_story;
            // the failpoint is passed less often than this
            if in_story < DEATHS {
                break;
            }
        }
        assert!(
            broke > 0 || from > 0,
            "the story never reaches the failpoint {name}: extend it, or test the failpoint elsewhere"
        );
        broke
    })
    .await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nothing_acknowledged_is_lost_wherever_the_service_is_killed() {
    killed(0, DEATHS).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "more cases of a test"]
async fn more_deaths_at_later_calls_lose_nothing_acknowledged() {
    killed(DEATHS, TIMES).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nothing_is_corrupted_wherever_the_disk_becomes_full() {
    // the first call of two failpoints in one story: a job that finds the disk full three times fails
    let (alone, paired): (Vec<_>, Vec<_>) = matrix().into_iter().partition(|(_, before)| !before.is_empty());
    let pairs = paired.chunks(2).map(<[_]>::to_vec).chain(alone.into_iter().map(|step| vec![step]));
    side_by_side(pairs, |steps, turns| {
        let names: Vec<&str> = steps.iter().map(|(name, _)| name.as_str()).collect();
        let faults: Vec<String> = steps.iter().map(|(name, before)| format!("{before}{}", full(name, &[1]))).collect();
        let story = async move {
            let _turn = turns.acquire().await.expect("open");
            day_with(vec![faults.join(";")]).await;
            faults.len()
        };
        (names.join(", "), story)
    })
    .await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "more cases of a test"]
async fn more_full_disks_at_later_calls_corrupt_nothing() {
    every_step(|name, before, turns| async move {
        let few = FULL.iter().filter(|calls| !FEW.contains(&name.as_str()) || **calls == FULL[0]);
        let mut times = 0;
        for calls in few {
            let _turn = turns.acquire().await.expect("open");
            day_with(vec![format!("{before}{}", full(&name, calls))]).await;
            times += calls.len();
        }
        times
    })
    .await;
}
