//! The order in which slices were taken, inferred from their names.

use std::{cmp::Ordering, ops::Range};

use super::{
    member_names,
    messages::{listed, one_or_more},
};
use crate::types::{Warning, WarningCode};

/// A part of a name.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Piece<'a> {
    Text(String),
    /// Digits, and whether a minus sign precedes them.
    Number {
        negative: bool,
        digits: &'a str,
    },
}

/// The numbers in a name, with their signs. A minus or plus is a sign at the start of the name and after `_`, `=` or
/// `/` (`_step_-08000_`), not after a letter or digit (`IMG-0001`, `2024-01-02`).
pub(super) fn numbers(name: &str) -> Vec<Range<usize>> {
    let bytes = name.as_bytes();
    let is_digit = |at: usize| bytes.get(at).is_some_and(u8::is_ascii_digit);
    let mut out = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        let signed = matches!(bytes[at], b'-' | b'+')
            && is_digit(at + 1)
            && (at == 0 || matches!(bytes[at - 1], b'_' | b'=' | b'/'));
        if !signed && !is_digit(at) {
            at += 1;
            continue;
        }
        let start = at;
        at += usize::from(signed);
        while is_digit(at) {
            at += 1;
        }
        out.push(start..at);
    }
    out
}

/// Splits a name into text and [`numbers`].
pub(super) fn pieces(name: &str) -> Vec<Piece<'_>> {
    let mut out = Vec::new();
    let mut text_start = 0;
    for number in numbers(name) {
        if text_start < number.start {
            out.push(Piece::Text(name[text_start..number.start].to_lowercase()));
        }
        text_start = number.end;
        let signed = &name[number];
        let digits = signed.strip_prefix(['-', '+']).unwrap_or(signed);
        out.push(Piece::Number { negative: signed.starts_with('-'), digits });
    }
    if text_start < name.len() {
        out.push(Piece::Text(name[text_start..].to_lowercase()));
    }
    out
}

/// The piece of each name in which the names differ, without their extensions; `None` unless that is exactly one.
pub(super) fn varying_pieces<'a>(names: impl Iterator<Item = &'a str>) -> Option<Vec<Piece<'a>>> {
    let mut cut: Vec<Vec<Piece<'_>>> = names.map(|name| pieces(member_names::stem(name))).collect();
    let first = cut.first()?;
    if cut.iter().any(|other| other.len() != first.len()) {
        return None;
    }
    let mut varying = (0..first.len()).filter(|&i| cut.iter().any(|other| other[i] != first[i]));
    let only = varying.next().filter(|_| varying.next().is_none())?;
    Some(cut.iter_mut().map(|pieces| pieces.swap_remove(only)).collect())
}

/// Compares digits as numbers of any length.
fn by_magnitude(a: &str, b: &str) -> Ordering {
    let (a, b) = (a.trim_start_matches('0'), b.trim_start_matches('0'));
    a.len().cmp(&b.len()).then_with(|| a.cmp(b))
}

fn by_piece(a: &Piece<'_>, b: &Piece<'_>) -> Ordering {
    match (a, b) {
        (Piece::Text(a), Piece::Text(b)) => a.cmp(b),
        (Piece::Number { .. }, Piece::Text(_)) => Ordering::Less,
        (Piece::Text(_), Piece::Number { .. }) => Ordering::Greater,
        (Piece::Number { negative: n, digits: a }, Piece::Number { negative: m, digits: b }) => match (n, m) {
            (false, false) => by_magnitude(a, b),
            (true, true) => by_magnitude(b, a),
            (true, false) => Ordering::Less,
            (false, true) => Ordering::Greater,
        },
    }
}

/// Natural order of file names. Numbers of any length compare by value, with their sign. Case is ignored. The extension
/// is compared last. A total order: only identical names are equal.
pub fn natural_order(a: &str, b: &str) -> Ordering {
    let (pieces_a, pieces_b) = (pieces(member_names::stem(a)), pieces(member_names::stem(b)));
    for (a, b) in pieces_a.iter().zip(&pieces_b) {
        let order = by_piece(a, b);
        if order != Ordering::Equal {
            return order;
        }
    }
    pieces_a.len().cmp(&pieces_b.len()).then_with(|| a.cmp(b))
}

/// Cameras count from 0001 to 9999 and start again.
const COUNTER_DIGITS: usize = 4;

/// Smallest gap between the low and the high numbers of a stack whose counter rolled over.
const ROLLOVER_GAP: u32 = 5_000;

/// The index at which the stack begins, in naturally ordered `names` whose camera counter rolled over; `None` when it
/// did not.
///
/// It rolled over when the names differ only in one four-digit number, the numbers form a low run that begins near 1
/// and a high run that ends near 9999, and the gap between the runs is at least [`ROLLOVER_GAP`]. No other numbering
/// leaves such a gap.
fn rollover(names: &[&str]) -> Option<usize> {
    let numbers: Vec<u32> = varying_pieces(names.iter().copied())?
        .iter()
        .map(|piece| match piece {
            Piece::Number { negative: false, digits } if digits.len() == COUNTER_DIGITS => digits.parse().ok(),
            _ => None,
        })
        .collect::<Option<_>>()?;
    // the pictures in between may belong to another light or another stack
    let near = (numbers.len() as u32 * 4).min(1_000);
    let (low, high) = (*numbers.first()?, *numbers.last()?);
    if low > near || high < 9_999 - near {
        return None;
    }
    let at = (1..numbers.len()).find(|&i| numbers[i] - numbers[i - 1] >= ROLLOVER_GAP)?;
    Some(at)
}

/// True for names that file managers give to copies of a file.
fn looks_like_a_copy(name: &str) -> bool {
    let stem = member_names::base(member_names::stem(name)).to_lowercase();
    let numbered = stem
        .strip_suffix(')')
        .and_then(|rest| rest.rsplit_once(" ("))
        .is_some_and(|(_, number)| !number.is_empty() && number.bytes().all(|b| b.is_ascii_digit()));
    numbered || stem.ends_with(" - copy") || stem.ends_with(" - kopie") || stem.ends_with(" copy")
}

/// Orders `items` by name as they were taken. Warns of a counter that rolled over and of copied files.
pub(super) fn sort<T>(items: &mut [T], name_of: impl Fn(&T) -> &str, warnings: &mut Vec<Warning>) {
    items.sort_by(|a, b| natural_order(name_of(a), name_of(b)));
    let names: Vec<&str> = items.iter().map(&name_of).collect();
    if let Some(start) = rollover(&names) {
        warnings.push(Warning::new(
            WarningCode::CounterRollover,
            format!(
                "the camera's counter rolled over within the stack: {} is taken to follow {}",
                names[0],
                names[names.len() - 1]
            ),
        ));
        items.rotate_left(start);
    }
    let copies: Vec<&str> = items.iter().map(name_of).filter(|name| looks_like_a_copy(name)).collect();
    if !copies.is_empty() {
        let clause = one_or_more(
            copies.len(),
            "seems to be a copy of another file; it is used as a slice",
            "seem to be copies of other files; they are used as slices",
        );
        warnings.push(Warning::new(WarningCode::CopiedFileName, format!("{} {clause}", listed(copies))));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ordered(names: &[&str]) -> (Vec<String>, Vec<Warning>) {
        let mut names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
        names.reverse();
        let mut warnings = Vec::new();
        sort(&mut names, |name| name, &mut warnings);
        (names, warnings)
    }

    #[test]
    fn numbers_count_as_numbers_and_signs_as_signs() {
        for names in [
            &["img_1.jpg", "img_2.jpg", "img_10.jpg"][..],
            &["_x_1_step_-08000_.jpg", "_x_1_step_-00400_.jpg", "_x_1_step_00000_.jpg", "_x_1_step_00400_.jpg"],
            &["IMG-0001.jpg", "img-0002.JPG", "IMG-0010.jpg"],
            &["f99999999999999999999.png", "f100000000000000000000.png"],
            &["2024-01-02_5.jpg", "2024-01-10_1.jpg"],
            &["angle_001_focus_001.tiff", "angle_001_focus_002.tiff", "angle_002_focus_001.tiff"],
            &["a.jpg", "a1.jpg", "b.jpg"],
            &["-2.jpg", "-1.jpg", "0.jpg", "1.jpg"],
        ] {
            let (sorted, warnings) = ordered(names);
            assert_eq!(sorted, names);
            assert_eq!(warnings, []);
        }
    }

    #[test]
    fn a_counter_that_rolled_over_is_corrected() {
        let names = ["IMG_9998.JPG", "IMG_9999.JPG", "IMG_0001.JPG", "IMG_0002.JPG"];
        let (sorted, warnings) = ordered(&names);
        assert_eq!(sorted, names);
        assert_eq!(warnings[0].code, "counter_rollover");
    }

    #[test]
    fn numbers_without_the_gap_of_a_rollover_keep_their_order() {
        for names in [
            &["s_0001.jpg", "s_4000.jpg", "s_8000.jpg", "s_9999.jpg"][..],
            &["IMG_0001.JPG", "IMG_0002.JPG", "IMG_5300.JPG"],
            &["z_00001.jpg", "z_99999.jpg"],
            &["a_0001.jpg", "b_9999.jpg"],
        ] {
            let (sorted, warnings) = ordered(names);
            assert_eq!(sorted, names);
            assert_eq!(warnings, []);
        }
    }

    #[test]
    fn copied_files_cause_a_warning() {
        let (_, warnings) = ordered(&["IMG_0001.JPG", "IMG_0001 (2).JPG", "IMG_0002.JPG"]);
        assert_eq!(warnings[0].code, "copied_file_name");
        assert!(warnings[0].detail.starts_with("IMG_0001 (2).JPG seems to be a copy of another file;"));
        let (_, warnings) = ordered(&["1.jpg", "1 copy.jpg", "2.jpg", "2 copy.jpg"]);
        assert!(warnings[0].detail.contains(" seem to be copies of other files;"), "{}", warnings[0].detail);
    }

    proptest::proptest! {
        #[test]
        fn natural_order_is_a_total_order(names in proptest::collection::vec("[-_a1B0 .]{0,8}", 3)) {
            let [a, b, c] = names.as_slice() else { unreachable!() };
            assert_eq!(natural_order(a, b), natural_order(b, a).reverse());
            assert_eq!(natural_order(a, b) == Ordering::Equal, a == b);
            if natural_order(a, b).is_le() && natural_order(b, c).is_le() {
                assert!(natural_order(a, c).is_le());
            }
        }
    }
}
