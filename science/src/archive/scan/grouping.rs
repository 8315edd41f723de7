//! Sorts files into views by their names: the members of a zip, or a list of names alone.
//!
//! 1. Files that are no pictures, and pictures in folders of results, are ignored.
//! 2. A manifest names the views, or
//! 3. the folders of a picture give view and light ([`folders`]), and
//! 4. within a folder, the names of the files may give a light and several views ([`file_names`]).
//! 5. Views are sorted. Whether they are complete is checked by [`checks`](super::checks).

use std::collections::{BTreeMap, HashMap, HashSet};

use super::{
    angles, file_names,
    folders::{self, Place},
    manifest::ListedViews,
    view::{Group, Ignored, ScanRules},
};
use crate::{
    archive::{layout::Split, light::Light, member_names, members::Member, natural_order, other_folders, slice_order},
    types::{Error, Warning, text::folded},
};

/// Whether folders that enclose all views are a part of the names of the views.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Enclosing {
    /// They are looked through: a zip that is made within a folder or of it holds the same views.
    Dropped,
    /// They are kept: the name of a view does not change when another folder appears beside it.
    Kept,
}

/// How the views of a list of pictures are named.
struct Naming<'a> {
    rules: &'a ScanRules,
    /// The folders that enclose all views.
    around: &'a str,
    enclosing: Enclosing,
}

/// A picture with what its folders and its name say.
struct Sorted {
    member: Member,
    light: Light,
    /// The name without folder, extension and light.
    stem: String,
}

/// The views, and what belongs to none. `listed`: what a manifest says.
///
/// # Errors
/// When a folder names both lights.
pub(super) fn group(
    split: Split,
    listed: Option<ListedViews>,
    rules: &ScanRules,
    enclosing: Enclosing,
    warnings: &mut Vec<Warning>,
) -> Result<(Vec<Group>, Vec<Ignored>), Error> {
    let Split { pictures, raw, others } = split;
    let mut ignored = Vec::new();
    let ignore = |member: &Member, reason: &str| Ignored { name: member.name.clone(), reason: reason.to_owned() };
    ignored.extend(raw.iter().map(|member| ignore(member, "a camera raw file; the picture of the same name is used")));
    let used = listed.as_ref().map(|listed| listed.manifest);
    let unused = others.iter().filter(|other| Some(other.index) != used);
    ignored.extend(
        unused.map(|member| ignore(member, "neither a JPEG, PNG or TIFF picture nor the manifest of the scan")),
    );
    let mut groups = match listed {
        Some(ListedViews { groups, .. }) => {
            let named: HashSet<usize> =
                groups.iter().flat_map(|group| group.front.iter().chain(&group.back)).map(|m| m.index).collect();
            let rest = pictures.iter().filter(|picture| !named.contains(&picture.index));
            ignored.extend(rest.map(|member| ignore(member, "not in the manifest")));
            groups
        }
        None => {
            let (views, rest): (Vec<Member>, Vec<Member>) =
                pictures.into_iter().partition(|picture| other_folders::no_slices(picture.folder()).is_none());
            ignored.extend(
                rest.iter().filter_map(|member| Some(ignore(member, other_folders::no_slices(member.folder())?))),
            );
            by_names(views, rules, enclosing, &mut ignored, warnings)?
        }
    };
    sort(&mut groups);
    natural_order::sort(&mut ignored, |file| &file.name);
    Ok((groups, ignored))
}

/// Views by folders and file names.
fn by_names(
    pictures: Vec<Member>,
    rules: &ScanRules,
    enclosing: Enclosing,
    ignored: &mut Vec<Ignored>,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<Group>, Error> {
    let names: HashSet<String> = pictures.iter().map(|member| member.folder().to_owned()).collect();
    let places = folders::places(&names.iter().map(String::as_str).collect())?;
    let around = places.values().next().map_or("", |place| place.enclosing.as_str());
    let naming = Naming { rules, around, enclosing };
    let with_light = folders_with_lights_in_names(&pictures, &places);
    let mut views: BTreeMap<String, (String, Vec<Sorted>)> = BTreeMap::new();
    for member in pictures {
        let Some(place) = places.get(member.folder()) else { continue };
        let stem = member_names::stem(member_names::base(&member.name)).to_owned();
        let in_name = if with_light.contains(&folded(member.folder())) { folders::light_in(&stem) } else { None };
        let (light, stem) = match (place.light, in_name) {
            (Some(light), _) => (light, stem),
            (None, Some((light, rest))) => (light, rest),
            (None, None) => (Light::Front, stem),
        };
        let view = views.entry(folded(&place.view)).or_insert_with(|| (place.view.clone(), Vec::new()));
        view.1.push(Sorted { member, light, stem });
    }
    let mut groups = Vec::new();
    for (name, pictures) in views.into_values() {
        groups.extend(of_folder(&name, pictures, &naming, ignored, warnings));
    }
    Ok(groups)
}

/// The folders whose file names tell the lights: without a light of their own, and with both lights in the names.
fn folders_with_lights_in_names(pictures: &[Member], places: &HashMap<&str, Place>) -> HashSet<String> {
    let mut lights: HashMap<String, HashSet<Option<Light>>> = HashMap::new();
    for member in pictures {
        if places.get(member.folder()).is_some_and(|place| place.light.is_none()) {
            let stem = member_names::stem(member_names::base(&member.name));
            lights.entry(folded(member.folder())).or_default().insert(folders::light_in(stem).map(|(light, _)| light));
        }
    }
    let has_both = |lights: &HashSet<Option<Light>>| lights.contains(&Some(Light::Back)) && lights.len() > 1;
    lights.into_iter().filter(|(_, lights)| has_both(lights)).map(|(folder, _)| folder).collect()
}

/// The views of one folder: one, or several by the names of the files.
fn of_folder(
    folder: &str,
    pictures: Vec<Sorted>,
    naming: &Naming,
    ignored: &mut Vec<Ignored>,
    warnings: &mut Vec<Warning>,
) -> Vec<Group> {
    let Some(reading) = reading_of(&pictures) else { return vec![view(folder, pictures, naming, warnings)] };
    let mut views: BTreeMap<String, (String, Vec<Sorted>)> = BTreeMap::new();
    for picture in pictures {
        match reading.parts(&picture.stem) {
            Some(parts) => views.entry(parts.key).or_insert_with(|| (parts.label, Vec::new())).1.push(picture),
            None => ignored.push(Ignored {
                name: picture.member.name,
                reason: "its name has no number of a slice, unlike the other files of its folder".to_owned(),
            }),
        }
    }
    let name = |label: &str| if folder.is_empty() { label.to_owned() } else { format!("{folder}/{label}") };
    views.into_values().map(|(label, pictures)| view(&name(&label), pictures, naming, warnings)).collect()
}

/// How the names of the files of a folder tell its views, from the light with more files.
fn reading_of(pictures: &[Sorted]) -> Option<file_names::Reading> {
    let stems = |light: Light| -> Vec<&str> {
        pictures.iter().filter(|picture| picture.light == light).map(|picture| picture.stem.as_str()).collect()
    };
    let (front, back) = (stems(Light::Front), stems(Light::Back));
    file_names::several_views(if front.len() >= back.len() { &front } else { &back })
}

/// One view, its slices in natural order.
fn view(name: &str, pictures: Vec<Sorted>, naming: &Naming, warnings: &mut Vec<Warning>) -> Group {
    let (mut front, mut back) = (Vec::new(), Vec::new());
    for Sorted { member, light, .. } in pictures {
        match light {
            Light::Front => front.push(member),
            Light::Back => back.push(member),
        }
    }
    slice_order::sort(&mut front, |member| &member.name, warnings);
    slice_order::sort(&mut back, |member| &member.name, warnings);
    let Naming { rules, around, enclosing } = naming;
    let angles::NamedAngles { pan_deg, tilt_deg, rest } = angles::read(name, rules);
    // a tilt that all views have is in a folder that encloses them: x=6/y=0, x=6/y=120
    let of_all = angles::read(around, rules);
    let whole = match (around.is_empty(), name.is_empty()) {
        (true, _) => name.to_owned(),
        (_, true) => (*around).to_owned(),
        _ => format!("{around}/{name}"),
    };
    let name = if *enclosing == Enclosing::Kept { whole } else { name.to_owned() };
    let (pan_deg, tilt_deg) = (pan_deg.or(of_all.pan_deg), tilt_deg.or(of_all.tilt_deg));
    Group { label: rest, pan_deg, tilt_deg, name, front, back }
}

/// By tilt, then by pan; then those without angles, in natural order.
fn sort(groups: &mut Vec<Group>) {
    natural_order::sort(groups, |group| group.shown());
    let angle = |angle: Option<f64>| angle.unwrap_or(f64::INFINITY);
    groups.sort_by(|a, b| {
        let tilt = angle(a.tilt_deg).total_cmp(&angle(b.tilt_deg));
        tilt.then(angle(a.pan_deg).total_cmp(&angle(b.pan_deg)))
    });
}
