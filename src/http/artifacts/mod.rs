//! Files that jobs made, on their way to the client.

pub mod accept;
pub mod conversions;
mod convert;
pub mod download;
pub mod name;
pub mod outcome;
pub mod picture;
pub mod range;
