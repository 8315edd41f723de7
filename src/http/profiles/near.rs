//! Suggests profiles and scans with similar names: another capital letter, a missing hyphen, another setting of the
//! lens.

use crate::contract::Name;

/// Most suggestions.
const MAX_SUGGESTIONS: usize = 3;

/// The profiles with the most similar names, nearest first: both names differ in at most a third of their letters (edit
/// distance, ignoring case and separators). After them, other lenses of the same rig.
pub(super) fn near<'a>(rig: &Name, lens: &Name, keys: &'a [(Name, Name)]) -> Vec<&'a (Name, Name)> {
    let (rig_folded, lens_folded) = (folded(rig), folded(lens));
    let mut found: Vec<(usize, &(Name, Name))> = Vec::new();
    for key in keys {
        let of_rig = distance(&rig_folded, &folded(&key.0));
        let of_lens = distance(&lens_folded, &folded(&key.1));
        match (of_rig, of_lens) {
            (Some(of_rig), Some(of_lens)) => found.push((of_rig + of_lens, key)),
            // after all that are similar in both
            (Some(0), None) => found.push((usize::MAX, key)),
            _ => {}
        }
    }
    found.sort_by_key(|(distance, _)| *distance);
    found.into_iter().take(MAX_SUGGESTIONS).map(|(_, key)| key).collect()
}

/// The names as a part of an error message; empty when there are none.
pub(super) fn sentence(near: &[&(Name, Name)]) -> String {
    let named: Vec<String> = near.iter().map(|(rig, lens)| format!("rig '{rig}' with lens '{lens}'")).collect();
    match named.as_slice() {
        [] => String::new(),
        named => format!(" (there is {})", named.join(", ")),
    }
}

/// The names that are most similar to `name`, nearest first.
pub fn names<'a>(name: &Name, known: &'a [Name]) -> Vec<&'a Name> {
    let own = folded(name);
    let mut found: Vec<(usize, &Name)> =
        known.iter().filter_map(|other| Some((distance(&own, &folded(other))?, other))).collect();
    found.sort_by_key(|(distance, _)| *distance);
    found.into_iter().take(MAX_SUGGESTIONS).map(|(_, name)| name).collect()
}

fn folded(name: &Name) -> String {
    name.as_str().chars().filter(|c| !"._-".contains(*c)).map(|c| c.to_ascii_lowercase()).collect()
}

/// The edit distance, if it is small enough.
fn distance(a: &str, b: &str) -> Option<usize> {
    let most = (a.len().max(b.len()) / 3).max(1);
    // names have at most 64 letters
    let distance = strsim::damerau_levenshtein(a, b);
    (distance <= most).then_some(distance)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(rig: &str, lens: &str) -> (Name, Name) {
        (Name::new(rig).expect("a name"), Name::new(lens).expect("a name"))
    }

    #[test]
    fn similar_names_of_scans_are_suggested() {
        let known = ["bee-41", "bee-42", "wasp-7"].map(|name| Name::new(name).expect("a name"));
        let near = |text: &str| names(&Name::new(text).expect("a name"), &known).first().map(|name| name.as_str());
        assert_eq!((near("Bee_42"), near("bee-4"), near("beetle")), (Some("bee-42"), Some("bee-41"), None));
    }

    #[test]
    fn similar_names_come_first_and_others_are_not_suggested() {
        let keys =
            [key("bench", "mpe65-2x"), key("bench", "mpe65-1x"), key("tower", "mpe65-1x"), key("bench", "other")];
        let told = |rig, lens| {
            let (rig, lens) = key(rig, lens);
            sentence(&near(&rig, &lens, &keys))
        };
        assert_eq!(
            told("Bench", "MPE65_1x"),
            " (there is rig 'bench' with lens 'mpe65-1x', rig 'bench' with lens 'mpe65-2x', rig 'bench' with lens 'other')"
        );
        assert_eq!(told("towr", "mpe65-1x"), " (there is rig 'tower' with lens 'mpe65-1x')");
        assert_eq!(told("elsewhere", "mpe65-1x"), "");
    }
}
