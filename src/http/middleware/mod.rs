//! What happens to every request and every answer.

pub mod auth;
pub mod cors;
pub mod observe;
pub mod problems;
pub mod request_id;
pub mod security;
