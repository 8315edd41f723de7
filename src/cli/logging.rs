//! The log goes to stderr: text for a terminal, or one JSON object per line for a collector.

use std::io::{self, IsTerminal, Write};

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
    let log =
        fmt().with_env_filter(filter).with_writer(move || OneLine { to: io::stderr(), colours }).with_ansi(colours);
    // logging that runs already (a second service of one process) goes on as it is
    let _ = match format {
        LogFormat::Text => log.with_target(false).try_init(),
        // there is one span, so a list of all of them says the same twice
        LogFormat::Json => log.json().with_span_list(false).try_init(),
    };
    Ok(())
}

/// Writes each event as one line: a line end inside it (in a cause of several lines, or in what a client sent) is escaped, as
/// are other control characters.
struct OneLine<W> {
    to: W,
    /// Colours begin with the escape character.
    colours: bool,
}

impl<W: Write> Write for OneLine<W> {
    /// `event` is whole: that is how `tracing-subscriber` writes.
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
    fn an_event_is_one_line_whatever_is_in_it() {
        let written = |colours: bool, event: &str| {
            let mut out = OneLine { to: Vec::new(), colours };
            out.write_all(event.as_bytes()).expect("memory can be written");
            String::from_utf8(out.to).expect("UTF-8")
        };
        assert_eq!(written(false, "a Käfer\nERROR b\r\u{1b}[31m\n"), "a Käfer\\nERROR b\\r\\x1b[31m\n");
        assert_eq!(written(true, "\u{1b}[32mINFO\u{1b}[0m a\tb\n"), "\u{1b}[32mINFO\u{1b}[0m a\\tb\n");
    }
}
