//! `?limit=&cursor=` of every list.

use crate::{contract::Code, http::problem::ApiError, store::PageRequest};

use super::params;

/// Default number of items on a page.
const DEFAULT_LIMIT: u32 = 50;
/// Largest number of items on a page.
const MAX_LIMIT: u32 = 500;

/// Takes `limit` and `cursor` out of the parameters.
#[derive(Debug)]
pub struct PageQuery;

impl PageQuery {
    /// The requested page.
    ///
    /// # Errors
    /// `invalid_request` for a limit that is not 1 to 500.
    pub fn take(pairs: &mut Vec<(String, String)>) -> Result<PageRequest, ApiError> {
        let limit = match params::take(pairs, "limit") {
            None => DEFAULT_LIMIT,
            Some(text) => match text.parse() {
                Ok(limit) if (1..=MAX_LIMIT).contains(&limit) => limit,
                _ => {
                    let detail = format!("limit is '{text}'; it must be 1 to {MAX_LIMIT}");
                    return Err(ApiError::new(Code::InvalidRequest, detail));
                }
            },
        };
        Ok(PageRequest { limit, cursor: params::take(pairs, "cursor") })
    }
}
