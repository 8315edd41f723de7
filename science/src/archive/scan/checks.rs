//! What is wrong with the views of a scan, as far as names and numbers tell.

use std::collections::{BTreeMap, HashMap};

use super::view::Group;
use crate::{
    archive::{
        Light, copies,
        members::Member,
        messages::{listed, one_or_more, slices_of},
    },
    types::{Error, ErrorKind, Warning, WarningCode, error::ErrorLocation, text::folded},
};

/// Views whose errors are listed.
const MOST_LISTED: usize = 50;

/// Checks that there are views, that each has slices in both lights or in the front light alone, and that no two have
/// the same angles.
///
/// # Errors
/// As [`super::open_scan`].
pub(super) fn check(groups: &[Group], is_listed: bool) -> Result<(), Error> {
    if groups.is_empty() {
        let detail = "the zip holds no views: its pictures are in folders of results or of a calibration target; put the \
                      slices of each view into a folder of its own";
        return Err(Error::new(ErrorKind::InvalidArchive, detail));
    }
    if let ([one], false) = (groups, is_listed) {
        let (front, back) = (slices_of(one.front.len(), Light::Front), slices_of(one.back.len(), Light::Back));
        let detail = format!(
            "the zip holds one stack ({front} and {back}), or its names do not tell the views apart; send one stack to \
             /v1/stacks; for a scan, put each view into a folder of its own, name the views in the file names \
             (bee_pan020_tilt06_focus_03.jpg), or list them in a manifest.json"
        );
        return Err(Error::new(ErrorKind::InvalidArchive, detail));
    }
    refuse_counts(groups)?;
    refuse_same(groups)
}

fn refuse_counts(groups: &[Group]) -> Result<(), Error> {
    let wrong: Vec<(&Group, String)> = groups.iter().filter_map(|group| Some((group, wrong_counts(group)?))).collect();
    let Some((_, first)) = wrong.first() else { return Ok(()) };
    let detail = match wrong.len() {
        1 => first.clone(),
        n => format!("{n} of {} views have wrong numbers of slices; the first: {first}", groups.len()),
    };
    let mut error = Error::new(ErrorKind::SliceCountMismatch, detail);
    for (group, detail) in wrong.into_iter().take(MOST_LISTED) {
        error = error.at(ErrorLocation { detail, file: Some(group.shown().to_owned()), ..ErrorLocation::default() });
    }
    Err(error)
}

/// Why the numbers of slices of a view are wrong; `None` when they are not.
pub(super) fn wrong_counts(group: &Group) -> Option<String> {
    let (name, front, back) = (group.shown(), group.front.len(), group.back.len());
    match (front, back) {
        (0, _) => {
            let back = slices_of(back, Light::Back);
            Some(format!("{name} has {back} and no front-light slices; add them, or remove it"))
        }
        (1, _) => Some(format!("{name} has one front-light slice; a stack needs two or more: add them, or remove it")),
        (_, 0) => None,
        _ if front != back => Some(format!(
            "{name} has {} and {}; both need the same number{}: add what is missing, or remove the view",
            slices_of(front, Light::Front),
            slices_of(back, Light::Back),
            copied(group).map_or(String::new(), |copied| format!(" ({copied})"))
        )),
        _ => None,
    }
}

/// A clause about copies among the slices of a view.
fn copied(group: &Group) -> Option<String> {
    let names = |members: &[Member]| members.iter().map(|member| member.name.clone()).collect::<Vec<_>>();
    [&group.front, &group.back].into_iter().find_map(|members| copies::copied(&names(members)))
}

/// The views that have the angles or the label of an earlier one and would replace it: position, and a sentence.
pub(super) fn same_views(groups: &[Group]) -> Vec<(usize, String)> {
    let rounded = |angle: Option<f64>| angle.map(|angle| (angle * 1000.0).round() as i64);
    let mut seen: HashMap<_, &str> = HashMap::new();
    let mut same = Vec::new();
    for (at, group) in groups.iter().enumerate() {
        let key = (rounded(group.pan_deg), rounded(group.tilt_deg));
        let key = match group.angles() {
            // equal angles are an error whatever the labels say
            Some(_) => (key, None),
            None => (key, Some(folded(group.label.as_deref().unwrap_or_default()))),
        };
        if let Some(other) = seen.insert(key, group.shown()) {
            let (what, advice) = match group.angles() {
                Some(_) => ("angles", "remove one, or correct its angles"),
                None => ("name", "remove or rename one"),
            };
            let detail =
                format!("{other} and {} have the same {what}; one zip holds each view once: {advice}", group.shown());
            same.push((at, detail));
        }
    }
    same
}

fn refuse_same(groups: &[Group]) -> Result<(), Error> {
    let Some((at, detail)) = same_views(groups).into_iter().next() else { return Ok(()) };
    let file = groups.get(at).map(|group| group.shown().to_owned());
    let location = ErrorLocation { detail: detail.clone(), file, ..ErrorLocation::default() };
    Err(Error::new(ErrorKind::InvalidArchive, detail).at(location))
}

/// Warns of views whose number of slices differs from that of most.
pub(super) fn warn(groups: &[Group], warnings: &mut Vec<Warning>) {
    let mut counts: BTreeMap<(usize, bool), usize> = BTreeMap::new();
    let of = |group: &Group| (group.front.len(), group.back.is_empty());
    groups.iter().for_each(|group| *counts.entry(of(group)).or_default() += 1);
    let Some((usual, _)) = counts.into_iter().max_by_key(|(_, count)| *count) else { return };
    let others: Vec<&str> = groups.iter().filter(|group| of(group) != usual).map(Group::shown).collect();
    if !others.is_empty() {
        let (slices, no_back) = usual;
        let lights = if no_back { "front light only" } else { "both lights" };
        let differ = one_or_more(others.len(), "differs", "differ");
        let detail =
            format!("{} {differ} from the other views, which have {slices} slices and {lights}", listed(others));
        warnings.push(Warning::new(WarningCode::ViewsDiffer, detail));
    }
}
