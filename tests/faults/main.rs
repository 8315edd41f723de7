//! The service broken on purpose: killed, with a full disk, or stopped, at each step of durability that the source names
//! (`pinstack::store::failpoint`). Afterwards it must have kept what it told its clients, and nothing else.
//!
//! The steps are there in builds of `cargo test` only.

mod copies;
mod elsewhere;
mod matrix;
mod service;
mod small_disk;
mod soak;
mod steps;
mod story;
mod workers;
