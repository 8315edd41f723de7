//! Sentences for JSON of a wrong structure: the messages of serde name types of Rust, places by line and column, and
//! quote what was sent at any length.

use crate::contract::one_line;

/// Most characters that are quoted of a value or a name.
const QUOTED: usize = 80;

/// The sentence for serde's `message` about the place `pointer`, with the JSON pointer of what is wrong: of a missing
/// member, its own.
pub(super) fn sentence(message: &str, pointer: &str) -> (String, String) {
    let message = without_position(message);
    if let Some(member) = message.strip_prefix("missing field ").map(unquoted) {
        return (format!("{}'{member}' is missing; add it", prefix(pointer)), format!("{pointer}/{member}"));
    }
    let subject = if pointer.is_empty() { "the body" } else { pointer };
    let refused = |kind: &str| message.strip_prefix(kind)?.split_once(", expected ");
    if let Some((member, known)) = refused("unknown field ") {
        let member = shortened(unquoted(member));
        // serde has counted the member to the place already
        let of = pointer.strip_suffix(&format!("/{member}")).unwrap_or(pointer);
        let detail = format!("{}unknown member '{member}'; known members: {}", prefix(of), listed(known));
        return (detail, pointer.to_owned());
    }
    if let Some((value, known)) = refused("unknown variant ") {
        let detail = format!("{subject} is '{}'; it must be one of: {}", shortened(unquoted(value)), listed(known));
        return (detail, pointer.to_owned());
    }
    let wrong = ["invalid type: ", "invalid value: "].iter().find_map(|kind| message.strip_prefix(kind));
    if let Some((given, expected)) = wrong.and_then(|rest| rest.rsplit_once(", expected ")) {
        return (format!("{subject} is {}; it must be {}", found(given), needed(expected)), pointer.to_owned());
    }
    if let Some((length, expected)) =
        message.strip_prefix("invalid length ").and_then(|rest| rest.split_once(", expected "))
    {
        return (
            format!("{}it has {length} values; it must be {}", prefix(pointer), needed(expected)),
            pointer.to_owned(),
        );
    }
    (format!("{}{}", prefix(pointer), one_line(message)), pointer.to_owned())
}

/// The beginning of a text from a client.
pub(super) fn shortened(text: &str) -> String {
    match text.char_indices().nth(QUOTED) {
        Some((end, _)) => format!("{}…", text.get(..end).unwrap_or_default()),
        None => text.to_owned(),
    }
}

fn prefix(pointer: &str) -> String {
    if pointer.is_empty() { String::new() } else { format!("{pointer}: ") }
}

fn without_position(message: &str) -> &str {
    message.rfind(" at line ").map_or(message, |end| message.get(..end).unwrap_or(message))
}

fn unquoted(name: &str) -> &str {
    name.trim_matches('`')
}

/// serde's list of names: `a`, `a` or `b`, one of `a`, `b`, `c`.
fn listed(names: &str) -> String {
    names.trim_start_matches("one of ").replace("` or `", ", ").replace('`', "")
}

/// What was sent, in terms of JSON.
fn found(given: &str) -> String {
    match given {
        "sequence" => "a list".to_owned(),
        "map" => "an object".to_owned(),
        _ => match given.strip_prefix("string ") {
            Some(text) => format!("the text {}", shortened(text)),
            None => shortened(given.split_once('`').map_or(given, |(_, value)| value.trim_end_matches('`'))),
        },
    }
}

/// What is needed, in terms of JSON.
fn needed(expected: &str) -> String {
    match expected {
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number, not negative".to_owned(),
        "i8" | "i16" | "i32" | "i64" => "a whole number".to_owned(),
        "f32" | "f64" => "a number".to_owned(),
        "a string" | "string" => "a text".to_owned(),
        "a boolean" => "true or false".to_owned(),
        "a sequence" => "a list".to_owned(),
        "a map" => "an object".to_owned(),
        other if other.starts_with("struct ") => "an object".to_owned(),
        other => other.replace("an array of length", "a list of").replace('`', "'"),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use serde::Deserialize;

    use super::*;
    use crate::contract::Code;
    use crate::http::extract::json::parse;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[allow(dead_code)]
    struct Sent {
        width: u32,
        #[serde(default)]
        shift: Option<[f64; 2]>,
        #[serde(default)]
        note: String,
        #[serde(default)]
        more: BTreeMap<String, i64>,
        #[serde(default)]
        parts: Vec<Self>,
        #[serde(default)]
        mode: Mode,
    }

    #[derive(Debug, Default, Deserialize)]
    #[serde(rename_all = "snake_case")]
    enum Mode {
        #[default]
        Fast,
        Exact,
    }

    #[test]
    fn sentences_name_the_place_what_was_sent_and_what_is_needed() {
        for (text, detail, pointer) in [
            ("{}", "'width' is missing; add it", "/width"),
            (r#"{"width": "x"}"#, r#"/width is the text "x"; it must be a whole number, not negative"#, "/width"),
            (r#"{"width": -1}"#, "/width is -1; it must be a whole number, not negative", "/width"),
            (r#"{"width": 1.5}"#, "/width is 1.5; it must be a whole number, not negative", "/width"),
            (r#"{"width": 1, "shift": [1]}"#, "/shift: it has 1 values; it must be a list of 2", "/shift"),
            (r#"{"width": 1, "shift": {}}"#, "/shift is an object; it must be a list of 2", "/shift"),
            (r#"{"width": 1, "note": null}"#, "/note is null; it must be a text", "/note"),
            (r#"{"width": 1, "note": true}"#, "/note is true; it must be a text", "/note"),
            (r#"{"width": 1, "more": {"a": []}}"#, "/more/a is a list; it must be a whole number", "/more/a"),
            (r#"{"width": 1, "parts": [{}]}"#, "/parts/0: 'width' is missing; add it", "/parts/0/width"),
            (
                r#"{"width": 1, "wide": 2}"#,
                "unknown member 'wide'; known members: width, shift, note, more, parts, mode",
                "/wide",
            ),
            (r#"{"width": 1, "mode": "slow"}"#, "/mode is 'slow'; it must be one of: fast, exact", "/mode"),
            ("7", "the body is 7; it must be an object", ""),
        ] {
            let fault = parse::<Sent>(text.as_bytes(), Code::InvalidRequest).expect_err(text);
            let place = fault.locations.first().expect(text);
            assert_eq!((fault.detail.as_str(), place.pointer.as_deref()), (detail, Some(pointer)), "{text}");
        }
        let long = "x".repeat(1000);
        for sent in [
            format!(r#"{{"width": "{long}"}}"#),
            format!(r#"{{"width": 1, "{long}": 2}}"#),
            format!(r#"{{"width": 1, "more": {{"{long}": []}}}}"#),
        ] {
            let fault = parse::<Sent>(sent.as_bytes(), Code::InvalidRequest).expect_err("it is wrong");
            let pointer = fault.locations.first().and_then(|place| place.pointer.clone()).unwrap_or_default();
            assert!(fault.detail.len() < 300 && pointer.len() < 150, "{fault:?}");
        }
        let other = sentence("crop is 'x'; it must be 'none'", "/crop");
        assert_eq!(other, ("/crop: crop is 'x'; it must be 'none'".to_owned(), "/crop".to_owned()));
    }
}
