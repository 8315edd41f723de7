//! Fault injection: the service is killed, stopped, or given a full disk at each failpoint that the sources name
//! (`pinstack::store::failpoint`). Afterwards it must have kept everything that it acknowledged to its clients, and
//! nothing else.
//!
//! | file | faults |
//! |---|---|
//! | `matrix` | every failpoint of a server, killed and with a full disk |
//! | `elsewhere` | failpoints of commands, garbage collection and calibrations |
//! | `copies` | backups that are interrupted |
//! | `database` | a Postgres server without free connections; its restart while the files are in a bucket |
//! | `machines` | several processes on one Postgres database and one folder; a restart of Postgres |
//! | `bucket` | several processes on one Postgres database and one bucket; failpoints, a bucket that fails or lies, a cut network |
//! | `redirects` | downloads from the bucket itself, by signed URLs |
//! | `moving` | a data folder that moves to Postgres and back |
//! | `traces` | traces through two processes; a collector that is away, or hangs |
//! | `workers` | a stopped worker that continues after another process has its job |
//! | `log` | a log that cannot be written |
//! | `small_disk` | a file system that is really full |
//! | `random` | faults of disk, log, database and bucket in random order, under load |
//! | `soak` | many clients and random kills |
//!
//! The failpoints exist only in builds of `cargo test`.

mod bucket;
mod collector;
mod copies;
mod database;
mod elsewhere;
mod input;
mod log;
mod machines;
mod matrix;
mod moving;
mod random;
mod reconstruction;
mod redirects;
mod relay;
mod service;
mod site;
mod small_disk;
mod soak;
mod steps;
mod story;
#[path = "../../src/store/s3/test_server.rs"]
mod test_bucket;
#[path = "../../src/store/postgres/test_server.rs"]
mod test_server;
mod traces;
mod workers;
