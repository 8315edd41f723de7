//! The order in which jobs are claimed.
//!
//! *Shares* take turns. A share is a rig; where tokens are required, a rig and a token. So a scan of 400 views from one
//! rig does not block the stacks of another. Jobs of high priority have a turn of their own: they pass the other jobs
//! of their rig, but a rig never has more than these two turns, however many of its jobs are urgent. Jobs of low
//! priority wait until no other job does, and take turns among themselves.
//!
//! The scheme is start-time fair queueing (Goyal, Vin and Cheng 1996). The work of a job is the size of its zip. A job
//! is given a number at acceptance, its `turn`: the work that its share had sent before. A share that sent less than
//! others starts where they are now, so it neither waits for what they did in the past nor overtakes all of it:
//!
//! ```text
//! turn     = max(turn of the latest job that started, turn_end of the latest job of the share)
//! turn_end = turn + work
//! ```
//!
//! The job with the lowest turn is next; of equal ones, the one that was accepted first. A job that returns to the
//! queue keeps its turn. Both numbers on the right are the ends of indexes, and so is the next job: a long queue costs
//! no more than a short one.

use uuid::Uuid;

use crate::{contract::Priority, store::NewJob};

/// Bytes of a zip per unit of work.
const BYTES_PER_UNIT: u64 = 1024;

/// What the turn of a job is computed from.
pub(in crate::store) struct TurnInput {
    /// Column `background`.
    pub(in crate::store) background: i64,
    /// Column `share`.
    pub(in crate::store) share: String,
    /// Subtracted from the turn of the latest job that started: 1 for an urgent job, which so comes before a job of its
    /// rig that would start at the same place.
    pub(in crate::store) lead: i64,
    /// `turn_end - turn`; at least 1.
    pub(in crate::store) work: i64,
}

impl TurnInput {
    /// Of a job that is to be accepted, sent with the token `sender`. That of a resumable upload is in the row of the
    /// upload, not in the job.
    pub(in crate::store) fn of(job: &NewJob, sender: Option<Uuid>) -> Self {
        let (name, background, lead) = match job.request.priority() {
            Priority::High => ("high", 0, 1),
            Priority::Normal => ("normal", 0, 0),
            Priority::Low => ("low", 1, 0),
        };
        let token = sender.map(|token| token.to_string()).unwrap_or_default();
        let share = format!("{token}/{}/{name}", job.rig);
        let work = super::signed(job.request.upload().bytes / BYTES_PER_UNIT).max(1);
        Self { background, share, lead, work }
    }
}

/// The queue that a job joins.
pub(in crate::store) struct Queue {
    /// Number of queued jobs.
    pub(in crate::store) waiting: u64,
    /// Largest number of them.
    pub(in crate::store) limit: u64,
}
