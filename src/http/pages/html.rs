//! HTML building blocks: escaped text, formatted numbers, tables.

/// Escapes any text for use between tags and inside quoted attributes. Control and bidirectional characters, which
/// could hide or reorder the text after them, become visible replacement characters.
pub(super) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\n' | '\t' => out.push(' '),
            c if c.is_control() => out.push('\u{fffd}'),
            '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// The text with its first letter in upper case.
pub(super) fn sentence(text: &str) -> String {
    let mut letters = text.chars();
    let first = letters.next().map(|first| first.to_uppercase().to_string()).unwrap_or_default();
    format!("{first}{}", letters.as_str())
}

/// A number with this many decimals and a typographic minus sign; a dash when it is not finite.
pub(super) fn number(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        // no minus sign for a value that rounds to zero
        Some(digits) if digits.chars().all(|c| c == '0' || c == '.') => digits.to_owned(),
        Some(digits) => format!("−{digits}"),
        None => text,
    }
}

/// The same, with a dash for `None`.
pub(super) fn maybe(value: Option<f64>, decimals: usize) -> String {
    value.map_or_else(|| "–".to_owned(), |value| number(value, decimals))
}

/// A number with at most this many significant digits, for values whose magnitude is not known beforehand.
pub(super) fn significant(value: f64, digits: i32) -> String {
    if value == 0.0 || !value.is_finite() {
        return number(value, 0);
    }
    let before = value.abs().log10().floor() as i32 + 1;
    if before < -6 {
        return format!("{value:.*e}", (digits - 1).max(0) as usize).replace('-', "−");
    }
    let text = number(value, (digits - before).clamp(0, 12) as usize);
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

/// An SVG coordinate: at most one decimal, without trailing zeros.
pub(super) fn at(value: f64) -> String {
    let text = format!("{value:.1}");
    match text.strip_suffix(".0") {
        Some("-0") => "0".to_owned(),
        Some(whole) => whole.to_owned(),
        None => text,
    }
}

/// A table in a box that scrolls sideways on a narrow screen. `heads` and cells are HTML; each row has a class, which
/// may be empty. A column in which every row has the dash of [`maybe`] is omitted.
pub(super) fn table(label: &str, heads: &[&str], rows: &[(&str, Vec<String>)]) -> String {
    let is_shown = |column: &usize| rows.iter().any(|(_, cells)| cells.get(*column).is_some_and(|cell| cell != "–"));
    let shown: Vec<usize> = (0..heads.len()).filter(is_shown).collect();
    let head: String = shown.iter().map(|&column| format!("<th scope=\"col\">{}</th>", heads[column])).collect();
    let body: String = rows
        .iter()
        .map(|(class, cells)| {
            let cells: String = shown.iter().map(|&column| format!("<td>{}</td>", cells[column])).collect();
            match class.is_empty() {
                true => format!("<tr>{cells}</tr>\n"),
                false => format!("<tr class=\"{class}\">{cells}</tr>\n"),
            }
        })
        .collect();
    format!(
        "<div class=\"wide\" tabindex=\"0\" role=\"region\" aria-label=\"{}\">\n<table>\n<thead><tr>{head}</tr></thead>\n\
         <tbody>\n{body}</tbody>\n</table>\n</div>\n",
        escape(label)
    )
}
