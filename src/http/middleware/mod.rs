//! What happens to every request and every answer.

pub mod auth;
pub mod browser;
pub mod cors;
pub mod method;
pub mod observe;
pub mod prefix;
pub mod problems;
pub mod request_id;
pub mod security;
pub mod slot;
pub mod trace;
pub mod whole;
