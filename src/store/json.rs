//! JSON in rows. What is written is read back before it is stored: no row may hold what this program cannot read. A number
//! that is not finite is the usual reason; JSON has none, and it is written as `null`.

use std::fmt::Display;

use anyhow::Context;
use serde::{Serialize, de::DeserializeOwned};

use super::{StoreError, StoreResult};

/// Why a value was not stored.
#[derive(Debug, thiserror::Error)]
#[error("{what} cannot be stored, because it could not be read again: {cause}")]
struct NotStorable {
    what: &'static str,
    cause: serde_json::Error,
}

/// A value as the JSON of a row. `Back` is the type that the row is read as; `what` is for the log.
///
/// # Errors
/// When it cannot be written, or what was written cannot be read: see [`is_not_storable`].
pub fn stored<Back: DeserializeOwned>(what: &'static str, value: &(impl Serialize + ?Sized)) -> StoreResult<String> {
    let not_storable = |cause| StoreError::Other(NotStorable { what, cause }.into());
    let text = serde_json::to_string(value).map_err(not_storable)?;
    serde_json::from_str::<Back>(&text).map_err(not_storable)?;
    Ok(text)
}

/// Reads the JSON of a row; `row` says which, for the log.
///
/// # Errors
/// When it is not JSON, or not of this type.
pub fn read<T: DeserializeOwned>(row: impl Display, text: &str) -> StoreResult<T> {
    let read = serde_json::from_str(text);
    Ok(read.with_context(|| format!("{row} holds JSON that this version does not understand"))?)
}

/// True when a value was refused by [`stored`]: to try again is of no use.
pub fn is_not_storable(error: &StoreError) -> bool {
    matches!(error, StoreError::Other(cause) if cause.is::<NotStorable>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_could_not_be_read_again_is_refused() {
        assert_eq!(stored::<Vec<f64>>("numbers", &[1.5, -0.0]).expect("finite"), "[1.5,-0.0]");
        let refused = stored::<Vec<f64>>("numbers", &[f64::INFINITY]).expect_err("not finite");
        assert!(is_not_storable(&refused) && refused.to_string().starts_with("numbers cannot be stored"), "{refused}");
        let unread = read::<Vec<f64>>("row 7", "[null]").expect_err("no number");
        assert!(!is_not_storable(&unread) && unread.to_string().starts_with("row 7 holds"), "{unread}");
    }
}
