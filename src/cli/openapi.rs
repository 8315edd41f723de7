//! `pinstack openapi`: prints the OpenAPI document.

use std::io::Write;

/// Prints the OpenAPI document.
///
/// # Errors
/// When the output is closed.
pub fn run() -> anyhow::Result<()> {
    std::io::stdout().write_all(crate::http::router::DOCUMENT.text().as_bytes())?;
    Ok(())
}
