//! Natural order of names: numbers compare by value, and case is ignored.

use std::cmp::Ordering;

use super::{
    member_names,
    notation::{Notation, Number},
};
use crate::types::text::folded;

/// A part of a name.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Piece<'a> {
    Text(String),
    Number {
        negative: bool,
        /// The digits, those before the decimal point.
        whole: &'a str,
        /// The digits after it.
        fraction: &'a str,
    },
}

/// Splits a name into text and the numbers that the notation reads.
fn pieces<'a>(name: &'a str, notation: &Notation) -> Vec<Piece<'a>> {
    let mut out = Vec::new();
    let mut text_start = 0;
    for Number { range, negative, whole, fraction } in notation.numbers(name) {
        if text_start < range.start {
            out.push(Piece::Text(folded(&name[text_start..range.start])));
        }
        text_start = range.end;
        out.push(Piece::Number { negative, whole, fraction });
    }
    if text_start < name.len() {
        out.push(Piece::Text(folded(&name[text_start..])));
    }
    out
}

/// The piece of each name in which the names differ, without their extensions; `None` unless that is exactly one.
pub(super) fn varying_pieces<'a>(names: &[&'a str], notation: &Notation) -> Option<Vec<Piece<'a>>> {
    let mut cut: Vec<Vec<Piece<'_>>> = names.iter().map(|name| pieces(member_names::stem(name), notation)).collect();
    let first = cut.first()?;
    if cut.iter().any(|other| other.len() != first.len()) {
        return None;
    }
    let mut varying = (0..first.len()).filter(|&i| cut.iter().any(|other| other[i] != first[i]));
    let only = varying.next().filter(|_| varying.next().is_none())?;
    Some(cut.iter_mut().map(|pieces| pieces.swap_remove(only)).collect())
}

/// Compares numbers of any length without their signs.
fn by_magnitude((a, decimals_a): (&str, &str), (b, decimals_b): (&str, &str)) -> Ordering {
    let (a, b) = (a.trim_start_matches('0'), b.trim_start_matches('0'));
    let decimals = decimals_a.trim_end_matches('0').cmp(decimals_b.trim_end_matches('0'));
    a.len().cmp(&b.len()).then_with(|| a.cmp(b)).then(decimals)
}

fn by_piece(a: &Piece<'_>, b: &Piece<'_>) -> Ordering {
    match (a, b) {
        (Piece::Text(a), Piece::Text(b)) => a.cmp(b),
        (Piece::Number { .. }, Piece::Text(_)) => Ordering::Less,
        (Piece::Text(_), Piece::Number { .. }) => Ordering::Greater,
        (
            &Piece::Number { negative: n, whole: a, fraction: c },
            &Piece::Number { negative: m, whole: b, fraction: d },
        ) => match (n, m) {
            (false, false) => by_magnitude((a, c), (b, d)),
            (true, true) => by_magnitude((b, d), (a, c)),
            (true, false) => Ordering::Less,
            (false, true) => Ordering::Greater,
        },
    }
}

/// The indices of `names` in natural order. Numbers of any length compare by value, as `notation` reads them. Case and
/// the normal form of letters are ignored. The extension is compared last. A total order: only identical names are
/// equal.
pub(super) fn order(names: &[&str], notation: &Notation) -> Vec<usize> {
    let cut: Vec<Vec<Piece<'_>>> = names.iter().map(|name| pieces(member_names::stem(name), notation)).collect();
    let by_pieces = |a: &[Piece<'_>], b: &[Piece<'_>]| {
        let differing = a.iter().zip(b).map(|(a, b)| by_piece(a, b)).find(|order| order.is_ne());
        differing.unwrap_or_else(|| a.len().cmp(&b.len()))
    };
    let mut order: Vec<usize> = (0..names.len()).collect();
    order.sort_by(|&a, &b| by_pieces(&cut[a], &cut[b]).then_with(|| names[a].cmp(names[b])));
    order
}

/// Sorts `items` by name, where their names belong to no stack.
pub(super) fn sort<T: Clone>(items: &mut Vec<T>, name_of: impl Fn(&T) -> &str) {
    let names: Vec<&str> = items.iter().map(&name_of).collect();
    let order = order(&names, &Notation::default());
    *items = order.into_iter().map(|at| items[at].clone()).collect();
}
