//! Finds the slices among the members of a zip and assigns each to a light.
//!
//! In: the directory. Out: the slices of all lights in order. The steps: check names, separate pictures from other
//! files, strip enclosing folders, apply the manifest if there is one, otherwise sort by folder and name.

use std::collections::{BTreeMap, HashMap, HashSet};

use super::{
    container::Container,
    further_lights,
    light::Light,
    limits::ArchiveLimits,
    manifest, member_names,
    members::{Member, Picture, SortedSlices},
    messages::{invalid, listed, one_or_more, slices_of},
    moved_target, slice_order,
};
use crate::{
    imaging::codec,
    types::{Error, ErrorKind, Warning, WarningCode, profile::MAX_SLICES, text::folded},
};

/// Finds the slices, groups them by light and orders them.
pub(super) fn sort(
    container: &Container,
    limits: &ArchiveLimits,
    warnings: &mut Vec<Warning>,
) -> Result<SortedSlices, Error> {
    let members = checked_members(container, warnings)?;
    let Split { pictures, raw: _, others } = split(members, warnings)?;
    if pictures.is_empty() {
        return Err(no_pictures(&others));
    }
    refuse_twins(&pictures)?;
    refuse_too_much(&pictures, limits)?;
    let (pictures, moved) = moved_target::split(pictures)?;
    let (pictures, wrapper) = unwrapped(pictures);

    let manifest = manifest::find(container, &others, &wrapper, limits, warnings)?;
    let used = manifest.as_ref().map(|(member, _)| member.index);
    warn_of_others(others.iter().filter(|other| Some(other.index) != used), warnings);

    let sorted = match manifest {
        Some((_, manifest)) => SortedSlices { moved, ..manifest.apply(pictures)? },
        None => by_names(pictures, moved)?,
    };
    refuse_extremes(&sorted)?;
    Ok(sorted)
}

/// The same by names alone. `listed` is the manifest of the stack, if it has one.
pub(super) fn of_pictures(pictures: Vec<Member>, listed: Option<manifest::Manifest>) -> Result<SortedSlices, Error> {
    refuse_twins(&pictures)?;
    let (pictures, moved) = moved_target::split(pictures)?;
    let (pictures, _) = unwrapped(pictures);
    let sorted = match listed {
        Some(manifest) => SortedSlices { moved, ..manifest.apply(pictures)? },
        None => by_names(pictures, moved)?,
    };
    refuse_extremes(&sorted)?;
    Ok(sorted)
}

fn by_names(pictures: Vec<Picture>, moved: Vec<Member>) -> Result<SortedSlices, Error> {
    let (mut front, mut back, lights) = by_folder(pictures)?;
    // the times of capture may correct this order, and the warnings come with them
    slice_order::sort(&mut front, |member| &member.name, &mut Vec::new());
    slice_order::sort(&mut back, |member| &member.name, &mut Vec::new());
    Ok(SortedSlices { front, back, lights, moved, is_listed: false })
}

/// All files of the zip, with checked names.
pub(super) fn checked_members(container: &Container, warnings: &mut Vec<Warning>) -> Result<Vec<Member>, Error> {
    let members = container.members()?;
    refuse_same_names(&members)?;
    warn_of_names(&members, warnings);
    Ok(members)
}

/// The error for a zip without pictures. Most often a zip was zipped again.
pub(super) fn no_pictures(others: &[Member]) -> Error {
    let is_archive = |member: &&Member| {
        let name = member.name.to_lowercase();
        [".zip", ".7z", ".rar", ".tar", ".gz", ".tgz"].iter().any(|extension| name.ends_with(extension))
    };
    let archives: Vec<&str> = others.iter().filter(is_archive).map(|member| member.name.as_str()).collect();
    let detail = match (&archives[..], others) {
        ([], []) => "the zip is empty; add the slices".to_owned(),
        ([], _) => format!(
            "the zip holds no JPEG, PNG or TIFF pictures, but {}; add the slices in one of these formats",
            listed(others.iter().map(|member| member.name.as_str()))
        ),
        ([one], _) if one.to_lowercase().ends_with(".zip") => {
            format!("the zip holds no pictures but another zip, {one}: send that one")
        }
        (several, _) => format!(
            "the zip holds no pictures but other archives, {}: send one zip per stack that holds the pictures themselves",
            listed(several.iter().copied())
        ),
    };
    Error::new(ErrorKind::InvalidArchive, detail)
}

/// Warns of names in an unknown code page.
fn warn_of_names(members: &[Member], warnings: &mut Vec<Warning>) {
    let unclear: Vec<&str> = members.iter().filter(|m| m.unclear_name).map(|m| m.name.as_str()).collect();
    if !unclear.is_empty() {
        warnings.push(Warning::new(
            WarningCode::UnclearFileNames,
            format!(
                "{}: the zip does not specify the code page of these names, so letters may be wrong; digits, and so the \
                 order, are correct; make the zip with UTF-8 names (7-Zip: -mcu=on)",
                listed(unclear)
            ),
        ));
    }
}

/// Refuses names that are equal after cleaning or on a file system that ignores case.
pub(super) fn refuse_same_names(members: &[Member]) -> Result<(), Error> {
    let mut seen: HashMap<String, &str> = HashMap::new();
    for member in members {
        if let Some(other) = seen.insert(folded(&member.name), &member.name) {
            let detail = format!("the zip has both {other} and {}, which are the same name; rename one", member.name);
            return Err(invalid(&member.name, detail));
        }
    }
    Ok(())
}

/// The files of a zip by what they are.
pub(super) struct Split {
    /// Pictures.
    pub pictures: Vec<Member>,
    /// Camera raw files next to a picture of the same name.
    pub raw: Vec<Member>,
    /// Other files.
    pub others: Vec<Member>,
}

/// Separates pictures from other files. A camera raw file next to a picture of the same name is ignored, with a
/// warning. A raw file without one is refused.
pub(super) fn split(members: Vec<Member>, warnings: &mut Vec<Warning>) -> Result<Split, Error> {
    let (split, alone) = split_with_raw(members);
    if let Some((member, format)) = alone.first() {
        return Err(codec::ImageFault::Raw(format).in_file(&member.name, None));
    }
    if !split.raw.is_empty() {
        let names = listed(split.raw.iter().map(|member| member.name.as_str()));
        warnings.push(Warning::new(
            WarningCode::RawPassedOver,
            format!("{names}: camera raw files were ignored, because there are pictures of the same name"),
        ));
    }
    Ok(split)
}

/// Separates pictures from other files, and camera raw files without a picture of the same name, each with its format.
pub(super) fn split_with_raw(members: Vec<Member>) -> (Split, Vec<(Member, &'static str)>) {
    let (mut pictures, mut raw, mut others) = (Vec::new(), Vec::new(), Vec::new());
    for member in members {
        if let Some(format) = codec::raw_extension(&member.name) {
            raw.push((member, format));
        } else if codec::is_picture_name(&member.name) {
            pictures.push(member);
        } else {
            others.push(member);
        }
    }
    let stem_of = |member: &Member| folded(member_names::stem(&member.name));
    let stems: HashSet<String> = pictures.iter().map(stem_of).collect();
    let (raw, alone): (Vec<_>, Vec<_>) = raw.into_iter().partition(|(member, _)| stems.contains(&stem_of(member)));
    let raw = raw.into_iter().map(|(member, _)| member).collect();
    (Split { pictures, raw, others }, alone)
}

/// Strips the folders that enclose all pictures. Returns the stripped prefix too.
pub(super) fn unwrapped(pictures: Vec<Member>) -> (Vec<Picture>, String) {
    let folder = |member: &Member, depth: usize| member.folder().split('/').nth(depth).map(folded);
    let mut depth = 0;
    while let Some(first) = pictures.first().and_then(|member| folder(member, depth)).filter(|name| !name.is_empty())
        && Light::of_folder(&first).is_none()
        && pictures.iter().all(|member| folder(member, depth).as_ref() == Some(&first))
    {
        depth += 1;
    }
    // folders of one name may have different lengths in bytes
    let inner = |name: &str| name.splitn(depth + 1, '/').nth(depth).unwrap_or(name).to_owned();
    let wrapper = pictures.first().map_or("", |member| member.name.strip_suffix(&inner(&member.name)).unwrap_or(""));
    let wrapper = wrapper.to_owned();
    (pictures.into_iter().map(|member| Picture { inner: inner(&member.name), member }).collect(), wrapper)
}

/// Refuses names that differ only in their extension: one slice in two formats would count twice.
pub(super) fn refuse_twins(pictures: &[Member]) -> Result<(), Error> {
    match twins(pictures).first() {
        Some((member, detail)) => Err(invalid(&member.name, detail.as_str())),
        None => Ok(()),
    }
}

/// The pictures whose name differs from that of an earlier one only in its extension, each with a sentence.
pub(super) fn twins(pictures: &[Member]) -> Vec<(&Member, String)> {
    let mut seen: HashMap<String, &str> = HashMap::new();
    let mut twins = Vec::new();
    for member in pictures {
        let name = &member.name;
        if let Some(other) = seen.insert(folded(member_names::stem(name)), name) {
            let detail =
                format!("{other} and {name} seem to be one slice in two formats; keep only one of the formats");
            twins.push((member, detail));
        }
    }
    twins
}

pub(super) fn refuse_too_much(pictures: &[Member], limits: &ArchiveLimits) -> Result<(), Error> {
    let total = pictures.iter().fold(0u64, |sum, picture| sum.saturating_add(picture.size));
    if total > limits.max_total_bytes {
        let most = limits.max_total_bytes;
        let detail = format!(
            "the pictures have {total} bytes uncompressed; at most {most} are read; send fewer or smaller slices"
        );
        return Err(Error::new(ErrorKind::ArchiveTooLarge, detail));
    }
    Ok(())
}

pub(super) fn warn_of_others<'a>(others: impl Iterator<Item = &'a Member>, warnings: &mut Vec<Warning>) {
    let names: Vec<&str> = others.map(|member| member.name.as_str()).collect();
    if !names.is_empty() {
        warnings.push(Warning::new(
            WarningCode::FilesPassedOver,
            format!("{}: ignored, because these are not pictures", listed(names)),
        ));
    }
}

/// The slices of the front light, of the back light, and of further lights.
type OfLights = (Vec<Member>, Vec<Member>, Vec<(String, Vec<Member>)>);

/// Groups by folder: `front` (or the root) and `back`; beside `front` also further lights.
fn by_folder(pictures: Vec<Picture>) -> Result<OfLights, Error> {
    let (mut root, mut front, mut back, mut further) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for picture in pictures {
        match (picture.in_light_folder(), picture.inner.split_once('/')) {
            (Some((Light::Front, _)), _) => front.push(picture),
            (Some((Light::Back, _)), _) => back.push(picture),
            (None, None) => root.push(picture),
            (None, Some(_)) => further.push(picture),
        }
    }
    if front.is_empty() {
        refuse_unknown(&further)?;
    }
    if let (Some(loose), false) = (root.first(), front.is_empty()) {
        let detail = format!(
            "there are pictures both in front/ and outside of it ({}), so the slices are ambiguous; put all front-light \
             slices into front/",
            loose.member.name
        );
        return Err(invalid(&loose.member.name, detail));
    }
    root.append(&mut front);
    let lights = further_lights::by_folder(further)?;
    Ok((in_one_folder(root, Light::Front)?, in_one_folder(back, Light::Back)?, lights))
}

/// Refuses pictures in folders that stand for no light.
fn refuse_unknown(pictures: &[Picture]) -> Result<(), Error> {
    let mut unknown: BTreeMap<String, &str> = BTreeMap::new();
    for Picture { member, inner } in pictures {
        let folder = inner.split('/').next().unwrap_or_default();
        let whole = member.name[..member.name.len() - inner.len()].to_owned() + folder;
        unknown.entry(whole).or_insert(&member.name);
    }
    match unknown.values().next() {
        Some(example) => Err(invalid(example, unknown_folders(&unknown))),
        None => Ok(()),
    }
}

/// The sentence for folders that stand for no light. Maps each folder to one of its pictures.
fn unknown_folders(unknown: &BTreeMap<String, &str>) -> String {
    let folders = listed(unknown.keys().map(String::as_str));
    let looks_like_a_view = |folder: &String| member_names::base(folder).bytes().any(|byte| byte.is_ascii_digit());
    if unknown.len() > 1 && unknown.keys().all(looks_like_a_view) {
        return format!(
            "the pictures are in {} folders that are neither front nor back ({folders}), like the views of a scan; one \
             zip holds one stack: send the zip to /v1/scans/{{scan}}/archive, or each folder as a zip of its own",
            unknown.len()
        );
    }
    let places = one_or_more(unknown.len(), "a folder that is", "folders that are");
    format!(
        "there are pictures in {places} neither front nor back ({folders}); put the front-light slices into front/ and \
         the back-light slices into back/ (German, French, Spanish, Italian and Dutch words are understood too), one \
         stack per zip; beside a folder front/, other folders are further lights of the same view"
    )
}

/// Refuses slices of one light in several folders: they would be two stacks.
fn in_one_folder(pictures: Vec<Picture>, light: Light) -> Result<Vec<Member>, Error> {
    let folder_of = |picture: &Picture| picture.inner.rsplit_once('/').map(|(folder, _)| folder.to_owned());
    let same = |a: &Option<String>, b: &Option<String>| a.as_deref().map(folded) == b.as_deref().map(folded);
    if let Some(first) = pictures.first().map(folder_of)
        && let Some(other) = pictures.iter().find(|picture| !same(&folder_of(picture), &first))
    {
        let word = light.word();
        let (a, b) = (first.unwrap_or_default(), folder_of(other).unwrap_or_default());
        let detail =
            format!("the {word} slices are in several folders ({a}, {b}); put the slices of one stack into one folder");
        return Err(invalid(&other.member.name, detail));
    }
    Ok(pictures.into_iter().map(|picture| picture.member).collect())
}

/// Checks of the number of slices that need no headers. The others come after the headers, which may show why there are
/// too many or too few.
fn refuse_extremes(sorted: &SortedSlices) -> Result<(), Error> {
    let (front, back) = (sorted.front.len(), sorted.back.len());
    if front == 0 {
        let back = slices_of(back, Light::Back);
        let detail = format!("the zip has {back} and no front-light slices; add the folder front/");
        return Err(Error::new(ErrorKind::SliceCountMismatch, detail));
    }
    if front > MAX_SLICES || back > MAX_SLICES {
        let most = if front >= back { slices_of(front, Light::Front) } else { slices_of(back, Light::Back) };
        let detail = format!("the zip has {most}; at most {MAX_SLICES} of one light are allowed: send fewer slices");
        return Err(Error::new(ErrorKind::ArchiveTooLarge, detail));
    }
    Ok(())
}
