//! The statements of the metadata store, and the decisions between them: one source for both engines.
//!
//! `sqlite/mod.rs` and `postgres/mod.rs` include this folder with `#[path]`, so it is compiled once for each engine,
//! against the types of its file `engine.rs`. That file has all that differs:
//!
//! | item | SQLite | Postgres |
//! |---|---|---|
//! | `write`, `write_alone`, `take` | `BEGIN IMMEDIATE`: one writer at a time, so nothing is left to lock | advisory locks ([`Lock`](crate::store::rows::transaction::Lock)) |
//! | `now` | the clock of the machine | that of the database |
//! | `freeing`, `reserve_space` | on a full disk with reserved space | nothing: the disk is not that of the files |
//! | `commit` | tells the listeners of this process | those of every process, by `NOTIFY` |
//! | `answered` | waits | waits for a limited time: the network may fail |
//! | `id_list`, `dialect!(IN "$1")` | a JSON list | an array |
//! | `dialect!(FOR UPDATE)` | nothing | locks the rows |
//! | `dialect!(INDEXED BY name)` | names the index: without a statistic of the table, SQLite would sort the whole queue | nothing |
//!
//! Both engines take the other statements as they are. Rules for a new one: parameters are `$1`, flags `true` and
//! `NOT flag`, numbers are bound and read as `i64`, a sum is `CAST(... AS bigint)`, a subquery in `FROM` has a name,
//! and the target of `ON CONFLICT ... DO UPDATE` names its table. Never `$1::text`: SQLite reads that as a name.

mod clock_gaps;
mod expiry;
mod jobs;
mod leases;
mod notes;
mod profiles;
mod quota;
mod scans;
pub(super) mod search;
mod tokens;
pub(super) mod totals;
mod transitions;
mod uploads;

use super::engine;
