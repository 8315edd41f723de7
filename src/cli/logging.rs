//! The log, written to stderr: text for a terminal, or one JSON object per line for a collector.

use std::io::{self, IsTerminal, Write};

use anyhow::anyhow;
use tracing_subscriber::{
    filter::{LevelFilter, Targets},
    fmt,
    layer::SubscriberExt,
    util::SubscriberInitExt,
};

use crate::settings::LogFormat;

/// Starts logging. `filter` is a level, or levels by crate or module: `info`, `info,pinstack=debug`, ...
///
/// # Errors
/// When the filter is not valid.
pub fn start(filter: &str, format: LogFormat) -> anyhow::Result<()> {
    let filter = filter_of(filter)?;
    // colours only on a terminal, not in a file or a collector
    let colours = std::io::stderr().is_terminal();
    let log = fmt()
        .with_max_level(LevelFilter::TRACE)
        .with_writer(move || OneLine { to: io::stderr(), colours })
        .with_ansi(colours);
    // fails if logging was started before (by another service in this process), which then stays as it is
    let _ = match format {
        LogFormat::Text => log.with_target(false).finish().with(filter).try_init(),
        // an event is within one span at most (`request` or `job`), so the list of spans would repeat it
        LogFormat::Json => log.json().with_span_list(false).finish().with(filter).try_init(),
    };
    Ok(())
}

/// The filter that the setting `log` describes.
fn filter_of(setting: &str) -> anyhow::Result<Targets> {
    setting.parse().map_err(|error| {
        anyhow!(
            "log: '{setting}' is not a log filter ({error}); use a level (error, warn, info, debug, trace, off), or \
             levels by module such as info,pinstack=debug"
        )
    })
}

/// Writes each event as one line: line ends inside it (for example in text from a client) and other control characters
/// are escaped.
struct OneLine<W> {
    to: W,
    /// Keep escape characters, which begin colour codes.
    colours: bool,
}

impl<W: Write> Write for OneLine<W> {
    /// `event` is a whole event: `tracing-subscriber` writes each with one call.
    fn write(&mut self, event: &[u8]) -> io::Result<usize> {
        let (text, end) = match event.strip_suffix(b"\n") {
            Some(text) => (text, &b"\n"[..]),
            None => (event, &b""[..]),
        };
        let is_kept = |byte: u8| !byte.is_ascii_control() || (byte == 0x1b && self.colours);
        let mut line = Vec::with_capacity(event.len());
        for &byte in text {
            if is_kept(byte) { line.push(byte) } else { line.extend(byte.escape_ascii()) }
        }
        line.extend(end);
        self.to.write_all(&line)?;
        Ok(event.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.to.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_filter_is_a_level_or_levels_by_module() {
        let enabled = |setting: &str, target: &str, level: tracing::Level| {
            filter_of(setting).expect("a filter").would_enable(target, &level)
        };
        assert!(enabled("info", "pinstack::http", tracing::Level::INFO));
        assert!(!enabled("info", "pinstack::http", tracing::Level::DEBUG));
        assert!(enabled("info,pinstack=debug", "pinstack::http", tracing::Level::DEBUG));
        assert!(!enabled("info,pinstack=debug", "sqlx", tracing::Level::DEBUG));
        assert!(!enabled("off", "pinstack", tracing::Level::ERROR));
        let refused = filter_of("pinstack=loud").expect_err("no such level").to_string();
        assert!(refused.contains("pinstack=loud") && refused.contains("info,pinstack=debug"), "{refused}");
    }

    #[test]
    fn an_event_is_one_line_whatever_it_contains() {
        let written = |colours: bool, event: &str| {
            let mut out = OneLine { to: Vec::new(), colours };
            out.write_all(event.as_bytes()).expect("memory can be written");
            String::from_utf8(out.to).expect("UTF-8")
        };
        assert_eq!(written(false, "a Käfer\nERROR b\r\u{1b}[31m\n"), "a Käfer\\nERROR b\\r\\x1b[31m\n");
        assert_eq!(written(true, "\u{1b}[32mINFO\u{1b}[0m a\tb\n"), "\u{1b}[32mINFO\u{1b}[0m a\\tb\n");
    }
}
