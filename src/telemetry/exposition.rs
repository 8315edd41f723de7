//! The text format of Prometheus, version 0.0.4, for gauges that are measured at each scrape.

use std::fmt::Write;

use super::Series;

/// Series in the text format.
#[derive(Debug, Default)]
pub struct Exposition(String);

impl Exposition {
    /// Adds a series without labels.
    pub fn value(&mut self, series: &Series, value: f64) {
        self.values(series, [([], value)]);
    }

    /// Adds a series with a value per combination of its labels, in the order of [`Series::labels`].
    pub fn values<'a, const N: usize>(
        &mut self,
        series: &Series,
        values: impl IntoIterator<Item = ([&'a str; N], f64)>,
    ) {
        debug_assert_eq!(series.labels.len(), N, "{}", series.name);
        let Series { name, kind, help, .. } = series;
        // writing to a string cannot fail
        let _ = writeln!(self.0, "# HELP {name} {help}\n# TYPE {name} {}", kind.as_str());
        for (labels, value) in values {
            let pairs: Vec<String> = series
                .labels
                .iter()
                .zip(labels)
                .map(|(label, text)| format!("{label}=\"{}\"", escaped(text)))
                .collect();
            let braces = if pairs.is_empty() { String::new() } else { format!("{{{}}}", pairs.join(",")) };
            let _ = writeln!(self.0, "{name}{braces} {value}");
        }
    }

    /// The text.
    pub fn into_text(self) -> String {
        self.0
    }
}

fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::telemetry::series::{BUILD_INFO, UPTIME_SECONDS};

    #[test]
    fn a_series_has_help_type_and_escaped_labels() {
        let mut text = Exposition::default();
        text.value(&UPTIME_SECONDS, 1.5);
        text.values(&BUILD_INFO, [(["a\"b\\c\n"], 1.0)]);
        let text = text.into_text();
        assert!(text.starts_with("# HELP pinstack_uptime_seconds Time since"), "{text}");
        assert!(text.contains("# TYPE pinstack_uptime_seconds gauge\npinstack_uptime_seconds 1.5\n"), "{text}");
        assert!(text.ends_with("pinstack_build_info{version=\"a\\\"b\\\\c\\n\"} 1\n"), "{text}");
    }
}
