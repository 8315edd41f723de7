//! `pinstack openapi`: prints the OpenAPI document.

use super::output::say;

/// Prints the OpenAPI document.
///
/// # Errors
/// None at present.
pub fn run() -> anyhow::Result<()> {
    say(crate::http::router::DOCUMENT.text().trim_end());
    Ok(())
}
