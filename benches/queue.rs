//! The queue by itself: how long accepting, claiming and ending a job take with 10 to 100,000 jobs waiting, how many
//! jobs per second 1, 2 and 4 processes with workers get through when the jobs are no work, and how many transactions
//! per second hundreds of waiting clients cost; and how long finding stacks takes among 1,000 and 100,000.
//!
//! ```text
//! cargo bench --features testing --bench queue                 # all tables, minutes
//! cargo bench --features testing --bench queue -- depth        # or: workers, streams, search
//! ```
//!
//! Postgres is that of `PINSTACK_TEST_POSTGRES_URL`, or a private one from Debian's package, without `fsync`: its
//! figures are those of the statements, and a real disk adds its own time to each commit.

#[path = "queue/depth.rs"]
mod depth;
#[path = "queue/search.rs"]
mod search;
#[path = "queue/store.rs"]
mod store;
#[path = "queue/streams.rs"]
mod streams;
#[path = "../src/store/postgres/test_server.rs"]
mod test_server;
#[path = "queue/workers.rs"]
mod workers;

fn main() {
    let runtime = tokio::runtime::Runtime::new().expect("a runtime");
    if let Some(worker) = workers::Worker::of_environment() {
        return runtime.block_on(worker.run());
    }
    let wanted: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let is_wanted = |name: &str| wanted.is_empty() || wanted.iter().any(|one| one == name);
    if is_wanted("depth") {
        runtime.block_on(depth::run());
    }
    if is_wanted("workers") {
        runtime.block_on(workers::run());
    }
    if is_wanted("streams") {
        runtime.block_on(streams::run());
    }
    if is_wanted("search") {
        runtime.block_on(search::run());
    }
}
