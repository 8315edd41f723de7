//! Reconstructions of scans: jobs whose input are results of stacks.

pub mod auto;
pub mod create;
pub mod files;
pub mod list;
pub mod plan;
pub mod poses;
