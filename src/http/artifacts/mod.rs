//! Downloads of the files that jobs made: format, name, range, entity tag.

pub mod accept;
pub mod download;
pub mod name;
pub mod outcome;
pub mod picture;
pub mod range;
pub mod redirect;
