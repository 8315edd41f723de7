//! Input that means harm, or looks as if it did: what the fuzzer found.

mod replay;
mod targets;
