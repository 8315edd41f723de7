//! The metadata store in a Postgres database, which the processes of several machines share.
//!
//! | question | answer |
//! |---|---|
//! | whose clock | that of the database. The clocks of the machines that run pinstack are not compared; only how long a lease has not changed is measured by the monotonic clock of the process that looks |
//! | isolation | `READ COMMITTED`. A transaction first locks what it decides on: the row that it changes (`FOR UPDATE`), or one of a few advisory locks ([`Lock`](super::rows::transaction::Lock)) where the decision is over many rows |
//! | why not `SERIALIZABLE` | the limit of the queue and a quota are sums over all rows, so any two acceptances conflict; they would fail and be retried under load, where a lock lets them pass one after the other, in a few milliseconds each |
//! | who is told of a change | every process that listens, by `NOTIFY` within the transaction. A notification that is lost delays only: every listener polls as well |
//!
//! Needs Postgres 13 or later, and connections of its own: a pooler that gives each transaction another connection
//! (PgBouncer in transaction mode) loses the notifications.

mod backup;
mod database;
mod engine;
mod notifications;
mod options;
#[path = "../sql/mod.rs"]
#[allow(clippy::duplicate_mod, reason = "the statements are compiled for each engine")]
mod sql;
mod storage;
#[cfg(test)]
mod test_server;
#[cfg(test)]
mod tests;

pub(in crate::store) use database::SCHEMA;
pub(in crate::store) use engine::NOW;
pub use engine::PostgresMetadata;
pub use options::DatabaseUrl;
