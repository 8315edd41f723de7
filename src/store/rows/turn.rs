//! The order in which jobs are claimed.
//!
//! Jobs of a higher priority come first. Within a priority, *shares* take turns. A share is a rig; where tokens are
//! required, a rig and a token. So a scan of 400 views from one rig does not block the stacks of another.
//!
//! The scheme is start-time fair queueing (Goyal, Vin and Cheng 1996). The work of a job is the size of its zip. Each
//! job is given a number at acceptance, its `turn`: the work that its share had sent before. A share that sent less
//! than others starts where they are now, so it neither waits for what they did in the past nor overtakes all of it:
//!
//! ```text
//! turn     = max(turn of the latest job that started, turn_end of the latest job of the share)
//! turn_end = turn + work
//! ```
//!
//! The job with the lowest turn is next; of equal ones, the one that was accepted first. A job that failed to end keeps
//! its turn. All three values are read from indexes, so a long queue costs no more than a short one.

use uuid::Uuid;

use crate::{contract::Priority, store::NewJob};

/// Bytes of a zip per unit of work.
const BYTES_PER_UNIT: u64 = 1024;

/// What a job takes its turn by.
pub(in crate::store) struct Turn {
    /// Column `priority`: lower numbers are claimed first.
    pub(in crate::store) priority: i64,
    /// Column `share`.
    pub(in crate::store) share: String,
    /// `turn_end - turn`; at least 1.
    pub(in crate::store) work: i64,
}

impl Turn {
    /// Of a job that is to be accepted, sent with the token `sender`. That of a resumable upload is in the row of the
    /// upload, not in the job.
    pub(in crate::store) fn of(job: &NewJob, sender: Option<Uuid>) -> Self {
        let share = match sender {
            Some(token) => format!("{token}/{}", job.rig),
            None => job.rig.as_str().to_owned(),
        };
        let work = super::signed(job.request.upload().bytes / BYTES_PER_UNIT).max(1);
        Self { priority: number(job.request.priority()), share, work }
    }
}

/// A priority as its column stores it.
fn number(priority: Priority) -> i64 {
    match priority {
        Priority::High => 0,
        Priority::Normal => 1,
        Priority::Low => 2,
    }
}
