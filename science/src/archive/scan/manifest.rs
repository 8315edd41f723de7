//! The `manifest.json` of a scan: the views, given explicitly.

use std::collections::{HashMap, HashSet};

use serde::Deserialize;

use super::view::Group;
use crate::{
    archive::{manifest::json, member_names, members::Member, messages::invalid, other_folders},
    types::{Error, text::folded},
};

/// Name of the file, in the root or in a folder that encloses everything.
const FILE: &str = "manifest.json";
/// Maximum size, bytes: more than 400 views of 120 slices in both lights with names of 100 bytes.
const MAX_BYTES: u64 = 16 << 20;

#[derive(Deserialize)]
struct Manifest {
    views: Vec<ListedView>,
}

#[derive(Deserialize)]
struct ListedView {
    #[serde(default)]
    label: Option<String>,
    #[serde(default)]
    pan_deg: Option<f64>,
    #[serde(default)]
    tilt_deg: Option<f64>,
    front: Vec<String>,
    #[serde(default)]
    back: Vec<String>,
}

/// The views that a manifest lists.
pub(super) struct ListedViews {
    /// [`Member::index`] of the manifest.
    pub manifest: usize,
    /// Its views, in its order.
    pub groups: Vec<Group>,
}

/// True for a file with the name of a manifest, in any folder.
pub(super) fn has_its_name(member: &Member) -> bool {
    member_names::base(&member.name).eq_ignore_ascii_case(FILE)
}

/// The manifest among the files that are not pictures. It is in the root or in a folder that encloses all `pictures`
/// but those of results and of targets; of several the least deep one. A file of this name in another folder belongs to
/// another program.
pub(super) fn find<'a>(others: &'a [Member], pictures: &[Member]) -> Option<&'a Member> {
    let has_slices = |folder: &&str| other_folders::no_slices(folder).is_none();
    let all: HashSet<&str> = pictures.iter().map(Member::folder).collect();
    let slices: Vec<&str> = all.iter().copied().filter(has_slices).collect();
    let enclosed = if slices.is_empty() { all.into_iter().collect() } else { slices };
    let encloses_all = |folder: &str| enclosed.iter().all(|inner| is_within(inner, folder));
    let depth = |member: &&Member| member.name.matches('/').count();
    others.iter().filter(|member| has_its_name(member) && encloses_all(member.folder())).min_by_key(depth)
}

/// True when `inner` is `folder` or in it.
fn is_within(inner: &str, folder: &str) -> bool {
    let (inner, folder) = (folded(inner), folded(folder));
    folder.is_empty() || inner.strip_prefix(&folder).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
}

/// Refuses a manifest that is too large to read.
///
/// # Errors
/// When it is.
pub(super) fn refuse_too_large(Member { name, size, .. }: &Member) -> Result<(), Error> {
    if *size <= MAX_BYTES {
        return Ok(());
    }
    Err(invalid(name, format!("{name} is larger than 16 MiB, the maximum for a list of views; shorten it")))
}

/// The views in the content of a manifest. `None` for a file without `views`, which is no manifest of a scan.
///
/// # Errors
/// When it is no JSON, or lists a picture that is not among `pictures` or was listed before.
pub(super) fn read(member: &Member, bytes: &[u8], pictures: &[Member]) -> Result<Option<ListedViews>, Error> {
    let name = &member.name;
    let advice = r#"it must look like {"views": [{"label": "side", "front": ["a.jpg", "b.jpg"], "back": []}]}"#;
    let value = json(name, bytes, advice)?;
    if value.get("views").is_none() {
        return Ok(None);
    }
    let manifest: Manifest = serde_json::from_value(value).map_err(|error| {
        invalid(name, format!("{name} is not a list of views ({error}); {advice}")).caused_by(error)
    })?;
    let folder = name.rsplit_once('/').map_or("", |(folder, _)| folder);
    let mut pictures = Pictures::new(pictures, folder);
    let groups = manifest.views.into_iter().enumerate().map(|(at, view)| pictures.group(name, at, view));
    Ok(Some(ListedViews { manifest: member.index, groups: groups.collect::<Result<_, _>>()? }))
}

/// The pictures that are not listed yet, by their names in lower case.
struct Pictures<'a> {
    by_name: HashMap<String, &'a Member>,
    folder: String,
}

impl<'a> Pictures<'a> {
    fn new(pictures: &'a [Member], folder: &str) -> Self {
        let by_name = pictures.iter().map(|member| (folded(&member.name), member)).collect();
        let folder = if folder.is_empty() { String::new() } else { format!("{}/", folded(folder)) };
        Self { by_name, folder }
    }

    /// Names are relative to the folder of the manifest, or to the root.
    fn take(&mut self, file: &str, view: &str, name: &str) -> Result<Member, Error> {
        let small = folded(&name.replace('\\', "/"));
        let relative = format!("{}{small}", self.folder);
        let found = self.by_name.remove(&relative).or_else(|| self.by_name.remove(&small));
        found.cloned().ok_or_else(|| {
            let shown: String = name.chars().take(200).collect();
            let detail = format!("{file} lists {shown} in {view}, which is not in the zip or was listed before");
            invalid(file, detail)
        })
    }

    fn group(&mut self, file: &str, at: usize, view: ListedView) -> Result<Group, Error> {
        let ListedView { label, pan_deg, tilt_deg, front, back } = view;
        let name = label.clone().unwrap_or_else(|| format!("view {}", at + 1));
        let mut take = |names: &[String]| -> Result<Vec<Member>, Error> {
            names.iter().map(|slice| self.take(file, &name, slice)).collect()
        };
        let (front, back) = (take(&front)?, take(&back)?);
        Ok(Group { label: label.filter(|label| !label.is_empty()), pan_deg, tilt_deg, name, front, back })
    }
}
