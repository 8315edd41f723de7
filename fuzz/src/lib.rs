//! The bodies of the targets lie with the tests that replay their corpus.

#[path = "../../tests/hostile/targets/mod.rs"]
pub mod targets;
