//! Watching a job: until it ends, or as server-sent events. Both look at the row: a change of this process
//! wakes them at once, a change of another process is seen at the next poll.

pub mod events;
pub mod load;
pub mod wait;
