//! What the names of files in one folder say: the view and the slice.
//!
//! In a name, all but one number belong to the view. The one is the number of the slice: it follows a word for focus,
//! or it is the last number of the name.

use std::{
    collections::{BTreeMap, HashSet},
    ops::Range,
};

use crate::{archive::notation::Notation, types::text::folded};

/// Words that come before the number of a slice.
const FOCUS: [&str; 14] =
    ["step", "steps", "focus", "foc", "fs", "slice", "z", "zstep", "layer", "plane", "frame", "rail", "depth", "fstep"];

/// Which number is that of the slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Rule {
    /// The number after a word for focus.
    FocusWord,
    /// The last number.
    LastNumber,
}

/// A name taken apart.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Parts {
    /// What names of the same view have in common, in lower case.
    pub key: String,
    /// The same as users see it.
    pub label: String,
    /// The number of the slice, as written.
    pub number: String,
}

/// How the names of one folder are read.
pub(super) struct Reading {
    rule: Rule,
    notation: Notation,
}

impl Reading {
    /// Takes a name without folder and extension apart; `None` when it has no number of that kind.
    pub(super) fn parts(&self, stem: &str) -> Option<Parts> {
        let mut numbers = self.notation.numbers(stem).into_iter().map(|number| number.range);
        let (cut, number) = match self.rule {
            Rule::LastNumber => numbers.next_back().map(|number| (number.start, number))?,
            Rule::FocusWord => numbers.rev().find_map(|number| Some((focus_word(stem, &number)?, number)))?,
        };
        let (before, after) = (&stem[..cut], &stem[number.end..]);
        let is_separator = |c: char| !c.is_alphanumeric();
        let (head, tail) = (before.trim_matches(is_separator), after.trim_matches(is_separator));
        let label = match (head.is_empty(), tail.is_empty()) {
            (false, false) => format!("{head}_{tail}"),
            _ => format!("{head}{tail}"),
        };
        Some(Parts { key: folded(&format!("{before}\0{after}")), label, number: stem[number].to_owned() })
    }
}

/// The start of the word for focus directly before a number.
fn focus_word(stem: &str, number: &Range<usize>) -> Option<usize> {
    let before = &stem[..number.start];
    let word_end = before.strip_suffix(['_', '=', '-', ' ']).unwrap_or(before);
    let start = word_end
        .rfind(|c: char| !c.is_alphabetic())
        .map_or(0, |at| at + word_end[at..].chars().next().map_or(1, char::len_utf8));
    FOCUS.contains(&word_end[start..].to_lowercase().as_str()).then_some(start)
}

/// The rule by which the names of one folder fall into several views; `None` when they are one stack.
///
/// By focus words: at least nine of ten names have one, and there are several views with several slices. By the last
/// number: views with several slices have four of five pictures, and the numbers begin again with each view or most
/// views have equally many. Times (`101500-1`, `101501-2`) have neither.
pub(super) fn several_views(stems: &[&str]) -> Option<Reading> {
    let notation = Notation::of(stems.iter().copied());
    let by_focus = Reading { rule: Rule::FocusWord, notation };
    let views = Views::of(stems, &by_focus);
    if views.pictures * 10 >= stems.len() * 9 && views.are_several() {
        return Some(by_focus);
    }
    let by_last = Reading { rule: Rule::LastNumber, ..by_focus };
    let views = Views::of(stems, &by_last);
    let begin_again = views.distinct_numbers * 4 <= views.pictures * 3;
    (views.are_several() && (begin_again || views.are_equal())).then_some(by_last)
}

/// The views that a rule gives.
struct Views {
    /// Number of pictures of each view.
    counts: Vec<usize>,
    /// Pictures whose name the rule takes apart.
    pictures: usize,
    /// Number of different numbers of slices.
    distinct_numbers: usize,
}

impl Views {
    fn of(stems: &[&str], reading: &Reading) -> Self {
        let mut counts: BTreeMap<String, usize> = BTreeMap::new();
        let mut numbers = HashSet::new();
        for parts in stems.iter().filter_map(|stem| reading.parts(stem)) {
            *counts.entry(parts.key).or_default() += 1;
            numbers.insert(parts.number);
        }
        let counts: Vec<usize> = counts.into_values().collect();
        Self { pictures: counts.iter().sum(), counts, distinct_numbers: numbers.len() }
    }

    /// True when at least two views have several slices, and four of five pictures are in such views.
    fn are_several(&self) -> bool {
        let several: Vec<usize> = self.counts.iter().copied().filter(|&count| count > 1).collect();
        several.len() >= 2 && several.iter().sum::<usize>() * 5 >= self.pictures * 4
    }

    /// True when four of five views have equally many slices.
    fn are_equal(&self) -> bool {
        let mut frequency: BTreeMap<usize, usize> = BTreeMap::new();
        self.counts.iter().for_each(|&count| *frequency.entry(count).or_default() += 1);
        frequency.values().max().is_some_and(|most| most * 5 >= self.counts.len() * 4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parts(name: &str, rule: Rule) -> Option<Parts> {
        Reading { rule, notation: Notation::default() }.parts(name)
    }

    #[test]
    fn the_number_of_the_slice_is_found_in_the_names_of_several_programs() {
        for (name, label, number) in [
            ("_x_00190_y_00000_step_-08000_", "x_00190_y_00000", "-08000"),
            ("scan01_001_fs03", "scan01_001", "03"),
            ("angle_001_focus_001", "angle_001", "001"),
            ("focus=3_view=7", "view=7", "3"),
            ("Käfer 4 slice-12", "Käfer 4", "12"),
        ] {
            let found = parts(name, Rule::FocusWord).expect(name);
            assert_eq!((found.label.as_str(), found.number.as_str()), (label, number), "{name}");
        }
        assert_eq!(parts("image_0001_-70_0_012", Rule::LastNumber).expect("a number").label, "image_0001_-70_0");
        assert_eq!(parts("angle_001_pan_020", Rule::FocusWord), None);
        assert_eq!(parts("overview", Rule::LastNumber), None);
    }

    #[test]
    fn one_stack_is_not_taken_for_several_views() {
        let several_views = |stems: &[&str]| several_views(stems).map(|reading| reading.rule);
        let times = ["101500-1", "101500-2", "101501-3", "101502-4", "101502-5"];
        assert_eq!(several_views(&times), None);
        let counter = ["IMG_0001", "IMG_0002", "IMG_0003"];
        assert_eq!(several_views(&counter), None);
        let counter_and_step = ["1_step_10", "2_step_20", "3_step_30"];
        assert_eq!(several_views(&counter_and_step), None);
        for one in [
            &["z0", "z0.25", "z0.5", "z0.75", "z1.0", "z1.25"][..],
            &["z0.00", "z0.25", "z0.50", "z0.75", "z1.00", "z1.25"],
            &["1,125mm", "1,25mm", "1,5mm", "1,75mm"],
            &["z-2", "z-1", "z0", "z1", "z2"],
            &["z-2", "z-1", "z+0", "z+1", "z+2"],
            &["z_-0.75", "z_-0.5", "z_-0.25", "z_0.0", "z_0.25"],
            &["focus -2", "focus -1", "focus 0", "focus 1"],
        ] {
            assert_eq!(several_views(one), None, "{one:?}");
        }
        let decimals = ["a_z-0.5", "a_z0", "a_z0.5", "b_z-0.5", "b_z0", "b_z0.5"];
        assert_eq!(several_views(&decimals), Some(Rule::FocusWord));
        assert_eq!(several_views(&["a1.01", "a1.02", "a2.01", "a2.02"]), Some(Rule::LastNumber), "view and slice");
        assert_eq!(several_views(&["a_1", "a_2", "b_1", "b_2"]), Some(Rule::LastNumber));
        assert_eq!(several_views(&["a_1", "a_2", "b_3", "b_4"]), Some(Rule::LastNumber));
    }
}
