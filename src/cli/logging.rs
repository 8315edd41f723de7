//! The log goes to stderr: text for a terminal, or one JSON object per line for a collector.

use std::io::IsTerminal;

use anyhow::anyhow;
use tracing_subscriber::{EnvFilter, fmt};

use super::config::LogFormat;

/// Starts logging. `filter` as `tracing` has it: `info`, `pinstack=debug,info`, ...
///
/// # Errors
/// When the filter is not valid.
pub fn start(filter: &str, format: LogFormat) -> anyhow::Result<()> {
    let filter = EnvFilter::try_new(filter).map_err(|error| anyhow!("log: '{filter}' is no filter: {error}"))?;
    // colours are for a terminal, not for a file or a collector
    let colours = std::io::stderr().is_terminal();
    let log = fmt().with_env_filter(filter).with_writer(std::io::stderr).with_ansi(colours);
    // logging that runs already (a second service of one process) goes on as it is
    let _ = match format {
        LogFormat::Text => log.with_target(false).try_init(),
        LogFormat::Json => log.json().try_init(),
    };
    Ok(())
}
