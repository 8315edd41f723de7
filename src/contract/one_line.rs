//! Makes text from a client safe for one line of the log.

/// Most characters kept.
const MOST: usize = 400;

/// Escapes line ends and other control characters in `text` and cuts it after 400 characters. So a client can neither
/// forge log lines nor flood the log.
pub fn one_line(text: &str) -> String {
    let mut line = String::with_capacity(text.len().min(MOST));
    for (i, c) in text.chars().enumerate() {
        if i == MOST {
            line.push('…');
            break;
        }
        // U+2028 and U+2029 are line ends for some readers; U+202A to U+202E and U+2066 to U+2069 change the text
        // direction
        let is_odd = c.is_control() || matches!(c, '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
        if is_odd { line.extend(c.escape_default()) } else { line.push(c) }
    }
    line
}

#[cfg(test)]
mod tests {
    use super::one_line;

    #[test]
    fn text_becomes_one_line_of_bounded_length() {
        assert_eq!(one_line("front/Käfer 1.jpg"), "front/Käfer 1.jpg");
        assert_eq!(one_line("a\r\nERROR b\u{1b}[31m\u{2028}c"), "a\\r\\nERROR b\\u{1b}[31m\\u{2028}c");
        let long = one_line(&"ä".repeat(1000));
        assert_eq!((long.chars().count(), long.ends_with('…')), (401, true));
    }
}
