//! How the numbers in the names of one stack are written: which have decimals, and which minus is a sign.
//!
//! One name does not tell: `1.10` may be a length or the tenth part of a version, and the minus of `IMG-0001` is none.
//! All names together do. Names belong together when they differ in numbers, their signs and decimals alone; numbers at
//! the same place in such names are a column.
//!
//! | in a column | is read as | example |
//! |---|---|---|
//! | some names have a minus, and others none or a plus | sign | `z-4`, `z0`; `z-2`, `z+2`; `z--1`, `z-0` |
//! | all names have a minus | sign at the start of the name and after `_`, `=` or `/`, otherwise separator | `_step_-08000_`; `IMG-0001` |
//! | a point, a comma or `p` between digits | decimals, unless values would be equal or the parts count more evenly | `z0.5`, `z0.25`; not `1.9`, `1.10` |
//! | more than one point in a row | separators | `2024.01.02` |

use std::{
    collections::{BTreeMap, BTreeSet},
    ops::Range,
};

use crate::types::text::folded;

/// Most digits of a number that may have decimals, before and after the point.
const MOST_DIGITS: usize = 12;

/// A number in a name, as a notation reads it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Number<'a> {
    /// Where it is in the name, with its sign.
    pub range: Range<usize>,
    /// A minus precedes it.
    pub negative: bool,
    /// The digits, those before the point.
    pub whole: &'a str,
    /// The digits after the point; empty without.
    pub fraction: &'a str,
}

/// How numbers are written, column by column. The default reads no decimals, and signs where no other names are needed.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Notation {
    columns: Vec<Column>,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Column {
    /// The characters `-` and `+` before a number that separate; one more is a sign. `None`: the other names do not
    /// tell.
    separators: Option<usize>,
    has_points: bool,
    has_decimals: bool,
}

/// A number with all that may belong to it.
struct Written {
    /// Where `-` and `+` before it begin.
    signs: usize,
    start: usize,
    point: Option<usize>,
    end: usize,
}

impl Notation {
    /// The notation that `names`, without extensions, have in common. Their order plays no part.
    pub(super) fn of<'a>(names: impl Iterator<Item = &'a str>) -> Self {
        let mut alike: BTreeMap<String, Vec<(&str, Vec<Written>)>> = BTreeMap::new();
        for name in names {
            let numbers = written(name);
            alike.entry(template(name, &numbers)).or_default().push((name, numbers));
        }
        let mut columns: Vec<Column> = Vec::new();
        for names in alike.values() {
            let count = names.first().map_or(0, |(_, numbers)| numbers.len());
            columns.resize(columns.len().max(count), Column::default());
            for (i, column) in columns.iter_mut().enumerate().take(count) {
                let numbers = || names.iter().map(move |(name, numbers)| (*name, &numbers[i]));
                let found = separators(numbers().map(|(name, number)| &name[number.signs..number.start]));
                column.separators = [column.separators, found].into_iter().flatten().min();
                if numbers().any(|(_, number)| number.point.is_some()) {
                    let is_first = !column.has_points;
                    column.has_points = true;
                    column.has_decimals = (is_first || column.has_decimals) && are_decimals(numbers());
                }
            }
        }
        Self { columns }
    }

    /// The same with points that separate where they are read as decimal points, and the reverse.
    pub(super) fn with_other_points(&self) -> Self {
        let other = |column: &Column| Column { has_decimals: column.has_points && !column.has_decimals, ..*column };
        Self { columns: self.columns.iter().map(other).collect() }
    }

    /// The numbers in a name.
    pub(super) fn numbers<'a>(&self, name: &'a str) -> Vec<Number<'a>> {
        let mut out = Vec::new();
        for (i, Written { signs, start, point, end }) in written(name).into_iter().enumerate() {
            let column = self.columns.get(i).copied().unwrap_or_default();
            let (before, run) = (&name[..signs], &name[signs..start]);
            let is_signed = match (column.separators, run.chars().count()) {
                (Some(separators), signs) => signs > separators,
                (None, signs) => signs == 1 && (before.is_empty() || before.ends_with(['_', '=', '/'])),
            };
            let sign = run.chars().next_back().filter(|_| is_signed);
            let from = start - sign.map_or(0, char::len_utf8);
            let negative = sign.is_some_and(|sign| sign != '+');
            let number = |range: Range<usize>, negative, whole: Range<usize>, fraction| Number {
                range,
                negative,
                whole: &name[whole],
                fraction,
            };
            match point {
                Some(point) if column.has_decimals => {
                    out.push(number(from..end, negative, start..point, &name[point + 1..end]));
                }
                Some(point) => {
                    out.push(number(from..point, negative, start..point, ""));
                    out.push(number(point + 1..end, false, point + 1..end, ""));
                }
                None => out.push(number(from..end, negative, start..end, "")),
            }
        }
        out
    }
}

/// A name with `\0` in place of each number, its sign and its decimals.
pub(super) fn without_numbers(name: &str) -> String {
    template(name, &written(name))
}

fn template(name: &str, numbers: &[Written]) -> String {
    let (mut template, mut at) = (String::new(), 0);
    for number in numbers {
        template.push_str(&name[at..number.signs]);
        template.push('\0');
        at = number.end;
    }
    template.push_str(&name[at..]);
    folded(&template)
}

/// The numbers in a name with all that may belong to them.
fn written(name: &str) -> Vec<Written> {
    let bytes = name.as_bytes();
    let digits = |from: usize| bytes.iter().skip(from).take_while(|byte| byte.is_ascii_digit()).count();
    let (mut out, mut at, mut free) = (Vec::new(), 0, 0);
    while at < bytes.len() {
        let length = digits(at);
        if length == 0 {
            at += 1;
            continue;
        }
        let signs = free + name[free..at].trim_end_matches(['-', '+', '\u{2212}', '\u{2013}']).len();
        let (start, mut runs) = (at, vec![at + length]);
        at += length;
        while matches!(bytes.get(at), Some(b'.' | b',' | b'p')) && digits(at + 1) > 0 {
            at += 1 + digits(at + 1);
            runs.push(at);
        }
        free = at;
        if let &[point, end] = &runs[..] {
            out.push(Written { signs, start, point: Some(point), end });
            continue;
        }
        let (mut signs, mut start) = (signs, start);
        for end in runs {
            out.push(Written { signs, start, point: None, end });
            (signs, start) = (end + 1, end + 1);
        }
    }
    out
}

/// The number of characters `-` and `+` in `runs`, which precede the numbers of a column, that separate: where some
/// runs are longer, or end in another sign, their last character is a sign.
fn separators<'a>(runs: impl Iterator<Item = &'a str> + Clone) -> Option<usize> {
    let lengths = || runs.clone().map(|run| run.chars().count());
    let (least, most) = (lengths().min()?, lengths().max()?);
    let plus = runs.clone().filter(|run| run.ends_with('+')).count();
    match (most > least, plus > 0 && plus < runs.count()) {
        (true, _) => Some(least),
        (false, true) => Some(least - 1),
        (false, false) => None,
    }
}

/// True when the points of a column are decimal points.
fn are_decimals<'a>(numbers: impl Iterator<Item = (&'a str, &'a Written)>) -> bool {
    let parts = |(name, number): (&'a str, &'a Written)| {
        let point = number.point.unwrap_or(number.end);
        (&name[number.start..point], name.get(point + 1..number.end).unwrap_or(""))
    };
    let numbers: Vec<(&str, &Written)> = numbers.collect();
    let is_p = numbers.iter().any(|(name, number)| number.point.is_some_and(|at| name[at..].starts_with('p')));
    let parts: BTreeSet<(&str, &str)> = numbers.into_iter().map(parts).collect();
    if parts.iter().any(|(whole, fraction)| whole.len().max(fraction.len()) > MOST_DIGITS) {
        return false;
    }
    let value = |digits: &str| digits.parse::<i128>().unwrap_or(0);
    let scaled = |(whole, fraction): &(&str, &str)| value(&format!("{whole}{fraction:0<MOST_DIGITS$}"));
    let mut values: Vec<i128> = parts.iter().map(scaled).collect();
    values.sort_unstable();
    if values.windows(2).any(|pair| pair[0] == pair[1]) {
        return false;
    }
    let by_value = evenness(values.windows(2).map(|pair| pair[1] - pair[0]).collect());
    // the parts count for themselves, and again from each whole number on
    let mut counters: Vec<(i128, Option<i128>)> =
        parts.iter().map(|(whole, part)| (value(whole), (!part.is_empty()).then(|| value(part)))).collect();
    counters.sort_unstable();
    let step = |pair: &[(i128, Option<i128>)]| Some(pair[1].1? - pair[0].1?).filter(|_| pair[0].0 == pair[1].0);
    let by_part = evenness(counters.windows(2).filter_map(step).collect());
    let length = parts.first().map_or(0, |(_, part)| part.len());
    // a value in decimals has no zeros at its end, unless all have equally many digits
    let is_padded = |(_, part): &(&str, &str)| part.len() > 1 && part.ends_with('0');
    let is_unlikely = is_p || (parts.iter().any(|(_, part)| part.len() != length) && parts.iter().any(is_padded));
    by_value > by_part || (by_value == by_part && !is_unlikely)
}

/// The share of the most frequent step, in thousandths; 0 when no step occurs twice.
fn evenness(mut steps: Vec<i128>) -> usize {
    steps.sort_unstable();
    let most = steps.chunk_by(|a, b| a == b).map(<[i128]>::len).max().unwrap_or(0);
    if most < 2 { 0 } else { most * 1_000 / steps.len() }
}
