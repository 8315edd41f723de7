//! Planning a capture: depth of focus and of field, rail positions, printable dot targets.
//!
//! - [`plan`]: lens, sensor and object -> number of slices and the rail position of each.
//! - [`advice`]: that plan -> the pitch of the dot target for the calibration.
//! - [`page`]: pitch and number of dots -> the target as SVG or PDF, at true scale.

pub mod advice;
pub mod page;
mod pdf;
pub mod plan;
mod sheet;
mod svg;

use crate::types::{Error, ErrorKind};

/// The error for a parameter that breaks a rule.
fn refused(name: &str, detail: String) -> Error {
    Error::new(ErrorKind::InvalidParameter, detail).in_field(name, None)
}

/// Checks that a number is in its range.
fn require(name: &str, value: f64, least: f64, most: f64) -> Result<(), Error> {
    if (least..=most).contains(&value) {
        return Ok(());
    }
    Err(refused(name, format!("{name} is {value}; it must be {least} to {most}")))
}
