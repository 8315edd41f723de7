//! Values as people read them. Every function returns plain text or escaped markup.

use std::time::Duration;

use jiff::Timestamp;
use maud::{Markup, PreEscaped, html};

use super::html::escape;
use crate::{
    contract::{JobState, Verdict, verdict::Explanation},
    store::search::FoundStacks,
};

/// Text that a client chose. Control and bidirectional characters become visible replacement characters.
pub fn text(text: &str) -> PreEscaped<String> {
    PreEscaped(escape(text))
}

/// A sentence of the service, with a capital letter.
pub fn sentence(detail: &str) -> PreEscaped<String> {
    text(&super::html::sentence(detail))
}

/// A size, such as `1.7 GB`.
pub fn bytes(bytes: u64) -> String {
    const UNITS: [&str; 5] = ["bytes", "kB", "MB", "GB", "TB"];
    let mut value = bytes as f64;
    let mut unit = 0;
    while value >= 999.5 && unit + 1 < UNITS.len() {
        value /= 1000.0;
        unit += 1;
    }
    let decimals = usize::from(unit > 0 && value < 9.95);
    format!("{value:.decimals$} {}", UNITS[unit])
}

/// A duration, such as `0.4 s`, `85 s`, `12 min` or `3 h 5 min`.
pub fn duration(time: Duration) -> String {
    let exact = time.as_secs_f64();
    let seconds = exact.round() as u64;
    match seconds {
        _ if exact < 0.95 => format!("{:.1} s", exact.max(0.1)),
        0..=99 => format!("{seconds} s"),
        100..=5_999 => format!("{} min", (seconds + 30) / 60),
        6_000..=359_999 => format!("{} h {} min", seconds / 3600, seconds % 3600 / 60),
        _ => format!("{} days", (seconds + 43_200) / 86_400),
    }
}

/// How long ago a time is, with the exact time for pointers and machines.
pub fn ago(time: Timestamp, now: Timestamp) -> Markup {
    let passed = Duration::try_from(now.duration_since(time)).unwrap_or_default();
    let exact = time.strftime("%Y-%m-%d %H:%M:%S UTC").to_string();
    let words = match passed.as_secs() {
        0..=59 => "just now".to_owned(),
        _ => format!("{} ago", duration(passed)),
    };
    html! { time datetime=(time.to_string()) title=(exact) { (words) } }
}

/// A date.
pub fn date(time: Timestamp) -> String {
    time.strftime("%Y-%m-%d %H:%M").to_string()
}

/// A state in a word and a sign; the colour only repeats it.
pub fn state(state: JobState) -> Markup {
    let (class, sign, word) = match state {
        JobState::Queued => ("soft", "…", "Waiting"),
        JobState::Running => ("busy", "▶", "Running"),
        JobState::Succeeded => ("good", "✓", "Done"),
        JobState::Failed => ("poor", "✕", "Failed"),
        JobState::Cancelled => ("soft", "–", "Cancelled"),
    };
    marked(class, sign, word)
}

/// A verdict in words and a sign; the colour only repeats it.
pub fn verdict(verdict: Verdict) -> Markup {
    let (class, sign) = match verdict {
        Verdict::Use => ("good", "✓"),
        Verdict::Look => ("usable", "!"),
        Verdict::DoNotUse => ("poor", "✕"),
    };
    marked(class, sign, verdict.words())
}

fn marked(class: &str, sign: &str, words: &str) -> Markup {
    html! { span class={ "state " (class) } { span aria-hidden="true" { (sign) } " " (words) } }
}

/// What a finding says at first sight: the phrase, in the colour of its verdict.
pub fn phrase(explanation: &Explanation) -> Markup {
    let class = match explanation.verdict {
        Verdict::Use => "soft",
        Verdict::Look => "warn",
        Verdict::DoNotUse => "bad",
    };
    html! { span class=(class) { (explanation.title) } }
}

/// A number with its word in singular or plural.
pub fn count(number: usize, one: &str, many: &str) -> String {
    format!("{number} {}", if number == 1 { one } else { many })
}

/// A number of stacks that are counted up to a limit.
pub fn up_to(number: u64) -> String {
    if number == FoundStacks::MOST { "10,000 or more".to_owned() } else { number.to_string() }
}

/// `1st`, `2nd`, `3rd`, `4th`.
pub fn ordinal(number: usize) -> String {
    let ending = match (number % 10, number % 100) {
        (_, 11..=13) => "th",
        (1, _) => "st",
        (2, _) => "nd",
        (3, _) => "rd",
        _ => "th",
    };
    format!("{number}{ending}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_read_as_people_write_them() {
        assert_eq!(
            [bytes(0), bytes(999), bytes(1_700_000_000), bytes(999_600)],
            ["0 bytes", "999 bytes", "1.7 GB", "1.0 MB"]
        );
        let of = |seconds| duration(Duration::from_secs(seconds));
        assert_eq!([0, 40, 449, 950].map(|ms| duration(Duration::from_millis(ms))), ["0.1 s", "0.1 s", "0.4 s", "1 s"]);
        assert_eq!([of(5), of(125), of(7_300), of(400_000)], ["5 s", "2 min", "2 h 1 min", "5 days"]);
        assert_eq!(
            [1, 2, 3, 4, 11, 12, 21, 112].map(ordinal),
            ["1st", "2nd", "3rd", "4th", "11th", "12th", "21st", "112th"]
        );
        assert_eq!(text("<b>\u{202e}x").into_string(), "&lt;b&gt;\u{fffd}x");
    }
}
