//! Hostile input: the corpus that the fuzzer found, and known decompression bombs.

mod bombs;
mod forms;
mod members;
mod peak;
mod pictures;
mod replay;
mod targets;
mod truncated;
mod zips;
