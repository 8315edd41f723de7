//! Names of copies: what file managers, sync programs and editors put beside their originals; and of what a stacking
//! program wrote into the folder of its slices.

use std::collections::{HashMap, HashSet};

use super::{
    member_names,
    messages::{listed, one_or_more},
    notation::without_numbers,
};
use crate::types::text::folded;

/// Parts of a word in the names that sync programs give to the second version of a file: Syncthing, Nextcloud, Dropbox,
/// Seafile, Synology Drive, in several languages.
const CONFLICT: [&str; 5] = ["conflict", "konflikt", "conflit", "conflitto", "case clash"];

/// Ends of names that file managers give to copies.
const COPIED: [&str; 4] = ["copy", "kopie", "copie", "copia"];

/// Starts of names that file managers give to copies.
const COPIES_OF: [&str; 5] = ["copy of ", "kopie von ", "kopie van ", "copie de ", "copia de "];

/// Ends of names that editors give to edited pictures.
const EDITED: [&str; 6] = ["edit", "edited", "bearbeitet", "enhanced", "enhanced-nr", "hdr"];

/// What a name says about its original.
struct Mark {
    /// The folded name of the original, without folder and extension.
    original: String,
    /// A number of a series may look the same.
    is_number: bool,
    /// It tells a copy also without the original, if other names have no such mark.
    is_telling: bool,
}

/// The names, of those of one light, that seem to be no slices of their own: copies or edits of other files or, without
/// any, the one that is named unlike all others. A copy has its original beside it, or a mark that most names lack:
/// `IMG (1).jpg` to `IMG (7).jpg` are a series.
pub fn copies<N: AsRef<str>>(names: &[N]) -> Vec<&str> {
    let copies = marked(names);
    if copies.is_empty() { odd(names).into_iter().collect() } else { copies }
}

fn marked<N: AsRef<str>>(names: &[N]) -> Vec<&str> {
    names.iter().zip(are_copies(names)).filter_map(|(name, is_copy)| is_copy.then_some(name.as_ref())).collect()
}

/// For each name, whether it looks like a copy or an edit of another file.
pub(super) fn are_copies<N: AsRef<str>>(names: &[N]) -> Vec<bool> {
    let stem = |name: &N| folded(member_names::base(member_names::stem(name.as_ref())));
    let stems: Vec<String> = names.iter().map(stem).collect();
    let marks: Vec<Option<Mark>> = stems.iter().map(|stem| mark(stem)).collect();
    let present: HashSet<&str> = stems.iter().map(String::as_str).collect();
    let mut series: HashMap<&str, usize> = HashMap::new();
    for mark in marks.iter().flatten().filter(|mark| mark.is_number) {
        *series.entry(&mark.original).or_default() += 1;
    }
    let telling = marks.iter().flatten().filter(|mark| mark.is_telling).count();
    let is_copy = |mark: &Mark| {
        let in_series = mark.is_number && series.get(mark.original.as_str()).is_some_and(|n| n * 2 > names.len());
        let has_original = present.contains(mark.original.as_str()) && !in_series;
        has_original || (mark.is_telling && telling * 2 < names.len())
    };
    marks.iter().map(|mark| mark.as_ref().is_some_and(is_copy)).collect()
}

/// The one name that is not of the series of all others: `output.jpg`, or `ZS PMax.jpg`, among `IMG_0001.jpg` to
/// `IMG_0030.jpg`. A series may begin without a number: `a.jpg`, `a (1).jpg`, `a (2).jpg`.
fn odd<N: AsRef<str>>(names: &[N]) -> Option<&str> {
    let shape = |name: &N| without_numbers(member_names::base(member_names::stem(name.as_ref())));
    let shapes: Vec<String> = names.iter().map(shape).collect();
    // of two names at least one is of the series
    let usual = shapes.iter().take(2).find(|usual| shapes.iter().filter(|shape| shape == usual).count() > 1)?;
    let mut others = names.iter().zip(&shapes).filter(|(_, shape)| *shape != usual);
    let (Some((name, shape)), None) = (others.next(), others.next()) else { return None };
    let starts_series = usual.starts_with(shape.trim_end_matches(['\0', ' ', '-', '_']));
    (names.len() > 3 && usual.contains('\0') && !starts_series).then(|| name.as_ref())
}

/// A clause about [`copies`]; `None` without any.
pub fn copied<N: AsRef<str>>(names: &[N]) -> Option<String> {
    let copies = marked(names);
    if let Some(odd) = odd(names).filter(|_| copies.is_empty()) {
        return Some(format!("{odd} is named unlike all other files: it may be a stacked image, or no slice"));
    }
    let seem = one_or_more(
        copies.len(),
        "seems to be a copy or an edit of another file",
        "seem to be copies or edits of other files",
    );
    (!copies.is_empty()).then(|| format!("{} {seem}", listed(copies)))
}

/// The mark of a copy in a folded name without folder and extension.
fn mark(stem: &str) -> Option<Mark> {
    let found = |original: &str, is_number, is_telling| {
        let original = original.trim_end_matches([' ', '-', '_', '.', '~']);
        // a copy of a copy
        let inner = mark(original).filter(|inner| !inner.is_number).map(|inner| inner.original);
        let original = inner.unwrap_or_else(|| original.to_owned());
        (!original.is_empty()).then_some(Mark { original, is_number, is_telling })
    };
    if let Some(word) = CONFLICT.iter().filter_map(|word| stem.find(*word)).min() {
        let before = &stem[..word];
        let cut = before.rfind('(').or_else(|| before.rfind(".sync-")).or_else(|| before.rfind(['_', '.', '-', ' ']));
        return found(&before[..cut.unwrap_or(word)], false, true);
    }
    if let Some(original) = COPIES_OF.iter().find_map(|start| stem.strip_prefix(start)) {
        return found(original, false, true);
    }
    if let Some(number) = stem.strip_prefix("img_e").filter(|rest| is_digits(rest)) {
        return found(&format!("img_{number}"), false, true);
    }
    let (unnumbered, number) = match stem.strip_suffix(')').and_then(|rest| rest.rsplit_once('(')) {
        Some((before, inner)) if is_digits(inner) => (before, inner),
        // "(edited)"
        Some((before, inner)) if EDITED.contains(&inner) => return found(before, false, true),
        _ => stem.rsplit_once([' ', '~', '-']).filter(|(_, number)| is_digits(number)).unwrap_or((stem, "")),
    };
    let whole = unnumbered.trim_end_matches([' ', '-']);
    let ends_in = |words: &[&str], joints: &[char]| {
        words.iter().filter_map(|word| whole.strip_suffix(word)?.strip_suffix(joints)).map(str::len).min()
    };
    let cut = ends_in(&COPIED, &[' ', '-', '_']).or_else(|| ends_in(&EDITED, &[' ', '-', '_']));
    match (cut, &stem[unnumbered.len()..]) {
        (Some(cut), _) => found(&whole[..cut], false, true),
        (None, "") => None,
        // "1 (2)" is what Windows calls a second file; "1 2", "1~2" and "1(2)" are rarer and need their original
        (None, end) if end.ends_with(')') => found(unnumbered, true, unnumbered.ends_with(' ')),
        (None, end) if end.starts_with('-') || number.starts_with('0') => None,
        (None, _) => found(unnumbered, true, false),
    }
}

fn is_digits(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit())
}
