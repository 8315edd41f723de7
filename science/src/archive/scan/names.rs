//! Groups a list of names into views, without a zip: to show the grouping before pictures are sent, and for programs
//! that send each view on its own.
//!
//! The rules are those of [`open_scan`](super::open_scan), with two differences. The name of a view keeps the folders
//! that enclose all views. A wrong view has a [`problem`](NamedView::problem), and the others are grouped all the same:
//! a folder that is being filled always has a view that is not complete.

use std::collections::{BTreeSet, HashMap};

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{
    checks, folders,
    grouping::{self, Enclosing},
    manifest,
    view::{Group, Ignored, ScanRules},
};
use crate::{
    archive::{
        layout, member_names, members::Member, messages::invalid, named_stack::NamedStack, natural_order,
        numbering_gaps,
    },
    types::{Error, Warning},
};

/// The views that names tell.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct NameGrouping {
    /// The views: by tilt, then by pan; then those without angles, in natural order. One is enough.
    pub views: Vec<NamedView>,
    /// The files that belong to no view, in natural order. Files that operating systems add are not listed.
    pub ignored: Vec<Ignored>,
    /// What the user should know.
    pub warnings: Vec<Warning>,
    /// The same files as one stack, or as a dot target.
    #[serde(default)]
    pub stack: NamedStack,
}

/// A view that names tell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct NamedView {
    /// The folders and the part of the file names that name the view, or its label in the manifest. Folders that
    /// enclose all views are a part of it. Empty for a view in the root.
    pub name: String,
    /// Pan, degrees; null when names do not say it.
    pub pan_deg: Option<f64>,
    /// Tilt, degrees; null when names do not say it.
    pub tilt_deg: Option<f64>,
    /// Names of the front-light slices, in the order of fusion.
    pub front: Vec<String>,
    /// Names of the back-light slices, in order; empty without a back light.
    pub back: Vec<String>,
    /// Why the view cannot be sent, as far as names and numbers tell; null when nothing is wrong.
    pub problem: Option<String>,
    /// The gaps in the numbering of the front-light slices, as a clause (`after s_05.jpg comes s_07.jpg`); null when
    /// there are none, or when the names are not numbered evenly.
    #[serde(default)]
    pub gaps: Option<String>,
}

/// Groups names into views. `names` are relative, with `/` or `\` between folders. `listed` is the content of the
/// `manifest.json` among them. It is ignored when that file is in a folder that does not enclose all pictures.
///
/// # Errors
/// [`ErrorKind::InvalidArchive`](crate::types::ErrorKind) for absolute names, `..`, control characters, names that are
/// too long or the same; a `manifest.json` without its content, or with one that does not match.
///
/// # Example
/// ```
/// use pinstack_science::archive::{ScanRules, scan::group_names};
///
/// let names = ["pan000_tilt10/1.jpg", "pan000_tilt10/2.jpg", "pan020_tilt10/1.jpg", "pan020_tilt10/2.jpg"];
/// let found = group_names(&names.map(String::from), None, &ScanRules::default())?;
/// assert_eq!((found.views.len(), found.views[1].pan_deg), (2, Some(20.0)));
/// # Ok::<(), pinstack_science::types::Error>(())
/// ```
pub fn group_names(names: &[String], listed: Option<&[u8]>, rules: &ScanRules) -> Result<NameGrouping, Error> {
    let mut warnings = Vec::new();
    let mut members = Vec::new();
    for (index, name) in names.iter().enumerate() {
        let Some(name) = member_names::checked(name)? else { continue };
        members.push(Member { index, name, size: 0, unclear_name: false });
    }
    layout::refuse_same_names(&members)?;
    let mut ignored = take_both_lights(&mut members);
    let (split, alone) = layout::split_with_raw(members);
    ignored.extend(alone.into_iter().map(|(member, format)| Ignored {
        reason: format!("a {format} camera raw file without a picture of the same name; convert it first"),
        name: member.name,
    }));
    let stack = NamedStack::of(split.pictures.clone(), listed);
    let is_named = split.others.iter().any(manifest::has_its_name);
    let listed = match (manifest::find(&split.others, &split.pictures), listed) {
        (Some(member), Some(bytes)) => manifest::read(member, bytes, &split.pictures)?,
        (Some(member), None) => {
            let detail = format!("{} lists the views: its content is needed too, as manifest", member.name);
            return Err(invalid(&member.name, detail));
        }
        (None, Some(_)) if !is_named => {
            let detail = "a manifest was given, but none of the names is manifest.json: add its name, which says where \
                          the names in it begin";
            return Err(invalid("manifest.json", detail));
        }
        // without a manifest, or with one that belongs to another program
        (None, _) => None,
    };
    let twins: HashMap<usize, String> =
        layout::twins(&split.pictures).into_iter().map(|(member, detail)| (member.index, detail)).collect();
    let (groups, others) = grouping::group(split, listed, rules, Enclosing::Kept, &mut warnings)?;
    ignored.extend(others);
    natural_order::sort(&mut ignored, |file| &file.name);
    let mut same: HashMap<usize, String> = checks::same_views(&groups).into_iter().collect();
    let views = groups.into_iter().enumerate().map(|(at, group)| {
        let in_two_formats = || group.front.iter().chain(&group.back).find_map(|member| twins.get(&member.index));
        let problem = in_two_formats().cloned().or_else(|| checks::wrong_counts(&group)).or_else(|| same.remove(&at));
        view(group, problem)
    });
    Ok(NameGrouping { views: views.collect(), ignored, warnings, stack })
}

fn view(group: Group, problem: Option<String>) -> NamedView {
    let Group { label: _, pan_deg, tilt_deg, name, front, back } = group;
    let names = |members: Vec<Member>| members.into_iter().map(|member| member.name).collect::<Vec<_>>();
    let front = names(front);
    let gaps = numbering_gaps::skipped(&front);
    NamedView { name, pan_deg, tilt_deg, front, back: names(back), problem, gaps }
}

/// Takes out the files in folders that name both lights.
fn take_both_lights(members: &mut Vec<Member>) -> Vec<Ignored> {
    let wrong = members.iter().map(Member::folder).filter(|folder| folders::names_both_lights(folder));
    let wrong: BTreeSet<String> = wrong.map(str::to_owned).collect();
    let taken = members.extract_if(.., |member| wrong.contains(member.folder()));
    let reason = "its folders name both lights; keep one word for the light in the path";
    taken.map(|member| Ignored { name: member.name, reason: reason.to_owned() }).collect()
}
