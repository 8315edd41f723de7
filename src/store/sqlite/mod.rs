//! The metadata store in one SQLite file: WAL, `synchronous=FULL`, one writing connection per process, a pool of
//! reading connections.
//!
//! Several processes may share the file. A transaction that writes starts with `BEGIN IMMEDIATE`, so no other process
//! writes between what it reads and what it writes.

mod database;
mod engine;
mod reserve;
#[path = "../sql/mod.rs"]
#[allow(clippy::duplicate_mod, reason = "the statements are compiled for each engine")]
mod sql;
#[cfg(test)]
mod tests;

pub(in crate::store) use database::SCHEMA;
pub use engine::SqliteMetadata;
