//! Input that means harm, or looks as if it did: what the fuzzer found, and bombs of every kind that are known.

mod bombs;
mod forms;
mod members;
mod peak;
mod replay;
mod targets;
mod torn;
mod zips;
