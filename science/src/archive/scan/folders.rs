//! What the folders of a picture say: the view, and the light.

use std::collections::{BTreeMap, HashMap, HashSet};

use crate::{
    archive::{light::Light, messages::invalid},
    types::{Error, text::folded},
};

/// What one folder holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Place {
    /// The folders that name the view, joined by `/`, without the light and without folders that enclose everything.
    pub view: String,
    /// The folders that enclose all views, joined by `/`.
    pub enclosing: String,
    /// The light that a folder stands for.
    pub light: Option<Light>,
}

/// The place of each folder that holds pictures.
pub(super) fn places<'a>(folders: &HashSet<&'a str>) -> Result<HashMap<&'a str, Place>, Error> {
    let mut sorted: Vec<&str> = folders.iter().copied().collect();
    sorted.sort_unstable();
    let parts: Vec<Vec<&str>> = sorted.iter().map(|folder| split(folder)).collect();
    let wrapper = common(&parts, |part| Light::of_folder(part).is_some());
    let mut found = Vec::new();
    for (folder, parts) in sorted.iter().zip(&parts) {
        found.push(whole(folder, &parts[wrapper..])?);
    }
    accept_pairs(&mut found, sorted.iter().zip(&parts).map(|(_, parts)| &parts[wrapper..]));
    let views: Vec<Vec<&str>> = found.iter().map(|place| split(&place.view)).collect();
    let again = common(&views, |_| false);
    // what all folders have in common but their lights
    let enclosing =
        [parts.first().map_or(&[][..], |all| &all[..wrapper]), views.first().map_or(&[][..], |view| &view[..again])];
    let enclosing = enclosing.concat().join("/");
    let views: Vec<String> = views.iter().map(|view| view[again..].join("/")).collect();
    let place = |(place, view): (Place, String)| Place { view, enclosing: enclosing.clone(), ..place };
    Ok(sorted.into_iter().zip(found.into_iter().zip(views).map(place)).collect())
}

/// The parts of a folder; none of the root.
fn split(folder: &str) -> Vec<&str> {
    folder.split('/').filter(|part| !part.is_empty()).collect()
}

/// The number of leading parts that all have in common, up to the first that `ends`.
fn common(all: &[Vec<&str>], ends: impl Fn(&str) -> bool) -> usize {
    let Some(first) = all.first() else { return 0 };
    let part = |parts: &[&str], at: usize| parts.get(at).map(|part| folded(part));
    let same = |at: usize| all.iter().all(|parts| part(parts, at) == part(first, at));
    (0..first.len()).find(|&at| ends(first[at]) || !same(at)).unwrap_or(first.len())
}

/// True when parts of a folder are words for different lights.
pub(super) fn names_both_lights(folder: &str) -> bool {
    lights(&split(folder)).len() > 1
}

fn lights(parts: &[&str]) -> HashSet<Light> {
    parts.iter().filter_map(|part| Light::of_folder(part)).collect()
}

/// The place of a folder by those of its parts that are the word for a light as a whole.
fn whole(folder: &str, parts: &[&str]) -> Result<Place, Error> {
    let lights = lights(parts);
    if lights.len() > 1 {
        let detail = format!(
            "the folder {folder} names both lights, so its pictures are ambiguous; keep one word for the light in the path"
        );
        return Err(invalid(folder, detail));
    }
    let view: Vec<&str> = parts.iter().copied().filter(|part| Light::of_folder(part).is_none()).collect();
    Ok(Place { view: view.join("/"), enclosing: String::new(), light: lights.into_iter().next() })
}

/// Reads a light that is a part of the name of a folder, `bee_back` beside `bee` or `bee_front`, if folders pair up in
/// this way. Otherwise the word belongs to the name.
fn accept_pairs<'a>(places: &mut [Place], parts: impl Iterator<Item = &'a [&'a str]>) {
    let read: Vec<Option<Place>> = places
        .iter()
        .zip(parts)
        .map(|(place, parts)| if place.light.is_none() { partial(parts) } else { None })
        .collect();
    let mut lights: BTreeMap<String, HashSet<Light>> = BTreeMap::new();
    for (place, read) in places.iter().zip(&read) {
        let Place { view, light, .. } = read.as_ref().unwrap_or(place);
        lights.entry(folded(view)).or_default().insert(light.unwrap_or(Light::Front));
    }
    let is_pair = |place: &Place| lights.get(&folded(&place.view)).is_some_and(|lights| lights.len() == 2);
    if !read.iter().flatten().any(is_pair) {
        return;
    }
    for (place, read) in places.iter_mut().zip(read) {
        if let Some(read) = read
            && (is_pair(&read) || read.light == Some(Light::Back))
        {
            *place = read;
        }
    }
}

/// The place of a folder, the last part of which contains a word for a light.
fn partial(parts: &[&str]) -> Option<Place> {
    let at = parts.iter().rposition(|part| light_in(part).is_some())?;
    let (light, rest) = light_in(parts[at])?;
    let view: Vec<&str> =
        parts.iter().enumerate().map(|(i, part)| if i == at { rest.as_str() } else { part }).collect();
    Some(Place { view: view.join("/"), enclosing: String::new(), light: Some(light) })
}

/// The light that a name contains as a word or as consecutive words, and the name without them:
/// `bee_without_backlight_3` gives the front light and `bee_3`. `None` without such a word, for words for different
/// lights, and for a name without other words.
pub(super) fn light_in(name: &str) -> Option<(Light, String)> {
    let words = words(name);
    let mut found: Option<(Light, std::ops::Range<usize>)> = None;
    let mut at = 0;
    while at < words.len() {
        // the longest run first: "without_backlight" is not "backlight"
        let run = (1..=3usize.min(words.len() - at)).rev().find_map(|length| {
            let range = words[at].start..words[at + length - 1].end;
            let joined = words[at..at + length].windows(2).all(|pair| pair[1].start - pair[0].end == 1);
            Some((Light::of_folder(name.get(range.clone())?).filter(|_| joined)?, range, length))
        });
        at += run.as_ref().map_or(1, |(_, _, length)| *length);
        match (&found, run) {
            (Some((before, _)), Some((light, ..))) if *before != light => return None,
            (None, Some((light, range, _))) => found = Some((light, range)),
            _ => {}
        }
    }
    let (light, range) = found?;
    let is_separator = |c: char| matches!(c, '_' | '-' | ' ' | '.' | '=');
    let (before, after) = (&name[..range.start], &name[range.end..]);
    // one of the two separators goes with the word
    let rest = match (before.ends_with(is_separator), after.starts_with(is_separator)) {
        (true, true) | (false, true) if before.is_empty() || before.ends_with(is_separator) => {
            format!("{before}{}", &after[1..])
        }
        _ => format!("{before}{after}"),
    };
    let rest = if after.is_empty() { rest.trim_end_matches(is_separator).to_owned() } else { rest };
    rest.chars().any(char::is_alphanumeric).then_some((light, rest))
}

/// The words of a name: runs of letters.
fn words(name: &str) -> Vec<std::ops::Range<usize>> {
    let mut out: Vec<std::ops::Range<usize>> = Vec::new();
    for (at, c) in name.char_indices() {
        let is_letter = c.is_alphabetic() || matches!(c, '\u{300}'..='\u{36F}');
        match out.last_mut() {
            Some(last) if is_letter && last.end == at => last.end = at + c.len_utf8(),
            _ if is_letter => out.push(at..at + c.len_utf8()),
            _ => {}
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_light_is_read_from_a_name_with_other_words() {
        for (name, light, rest) in [
            ("bee_back", Light::Back, "bee"),
            ("bee_01_without_backlight", Light::Front, "bee_01"),
            ("with_backlight_bee", Light::Back, "bee"),
            ("view01_front_03", Light::Front, "view01_03"),
            ("view01-back-light-03", Light::Back, "view01-03"),
            ("back03", Light::Back, "03"),
            ("_x_00190_y_00000_back_step_-08000_", Light::Back, "_x_00190_y_00000_step_-08000_"),
        ] {
            assert_eq!(light_in(name), Some((light, rest.to_owned())), "{name}");
        }
        for name in ["backpack_3", "front", "silverback_1", "front_and_back_2", "view_01"] {
            assert_eq!(light_in(name), None, "{name}");
        }
    }

    #[test]
    fn a_word_for_a_light_belongs_to_the_name_without_a_partner() {
        let of = |folders: &[&'static str]| places(&folders.iter().copied().collect()).unwrap();
        let place =
            |view: &str, enclosing: &str, light| Place { view: view.into(), enclosing: enclosing.into(), light };
        let alone = of(&["silver back 1", "silver back 2"]);
        assert_eq!(alone["silver back 1"], place("silver back 1", "", None));
        assert_eq!(of(&["s/a/front", "s/a/back"])["s/a/back"], place("", "s/a", Some(Light::Back)));
        let pair = of(&["s/a_1", "s/a_1_back", "s/a_2", "s/a_2_back"]);
        assert_eq!(pair["s/a_2_back"], place("a_2", "s", Some(Light::Back)));
        assert_eq!(pair["s/a_2"], place("a_2", "s", None));
    }
}
