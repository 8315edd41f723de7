//! The list of stacks, with thumbnails, its rows and its search.

pub mod list;
pub mod row;
pub mod search;
pub mod thumbnail;
