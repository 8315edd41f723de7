//! The list of stacks, with thumbnails, and its rows.

pub mod list;
pub mod row;
pub mod thumbnail;
