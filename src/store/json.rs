//! JSON in rows. A value is parsed again before it is stored, so no row contains JSON that this program cannot read.
//! The usual reason is a number that is not finite: JSON cannot represent it, and serde writes `null`.

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

/// Serialises a value for a row. `Back` is the type that the row is read as; `what` names the value in the log.
///
/// # Errors
/// When the value cannot be serialised, or the result cannot be parsed: see [`is_not_storable`].
pub fn stored<Back: DeserializeOwned>(what: &'static str, value: &(impl Serialize + ?Sized)) -> StoreResult<String> {
    let not_storable = |cause| StoreError::Other(NotStorable { what, cause }.into());
    let text = serde_json::to_string(value).map_err(not_storable)?;
    serde_json::from_str::<Back>(&text).map_err(not_storable)?;
    Ok(text)
}

/// Parses the JSON of a row; `row` names it in the log.
///
/// # Errors
/// When it is not JSON, or not of this type.
pub fn read<T: DeserializeOwned>(row: impl Display, text: &str) -> StoreResult<T> {
    let read = serde_json::from_str(text);
    Ok(read.with_context(|| format!("{row} contains JSON that this version cannot read"))?)
}

/// True when [`stored`] refused a value: a retry would fail as well.
pub fn is_not_storable(error: &StoreError) -> bool {
    matches!(error, StoreError::Other(cause) if cause.is::<NotStorable>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_that_could_not_be_read_again_is_refused() {
        assert_eq!(stored::<Vec<f64>>("numbers", &[1.5, -0.0]).expect("finite"), "[1.5,-0.0]");
        let refused = stored::<Vec<f64>>("numbers", &[f64::INFINITY]).expect_err("not finite");
        assert!(is_not_storable(&refused) && refused.to_string().starts_with("numbers cannot be stored"), "{refused}");
        let unread = read::<Vec<f64>>("row 7", "[null]").expect_err("no number");
        assert!(!is_not_storable(&unread) && unread.to_string().starts_with("row 7 contains"), "{unread}");
    }
}
