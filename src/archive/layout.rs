//! Which members are slices, and of which light.

use std::collections::{BTreeMap, HashMap};

use super::{ArchiveLimits, container::Container, container::Member, invalid, listed, manifest, names, order};
use crate::{
    imaging::codec,
    model::{Code, Fault, Warning, profile::MAX_SLICES},
};

/// Where the light came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Light {
    /// On the object: the picture.
    Front,
    /// From behind the object: its silhouette.
    Back,
}

impl Light {
    /// The light that a folder stands for by its name: `front`, `frontlight`, `frontlit`, `fg`, `without_backlight` and
    /// `back`, `backlight`, `backlit`, `bg`, `with_backlight`, in upper or lower case, with blanks, `_` and `-`
    /// anywhere.
    pub fn of_folder(name: &str) -> Option<Self> {
        let plain: String = name.chars().filter(|c| !matches!(c, ' ' | '_' | '-')).collect::<String>().to_lowercase();
        match plain.as_str() {
            "front" | "frontlight" | "frontlit" | "fg" | "foreground" | "withoutbacklight" => Some(Self::Front),
            "back" | "backlight" | "backlit" | "bg" | "background" | "withbacklight" => Some(Self::Back),
            _ => None,
        }
    }

    /// As it is said in sentences.
    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Front => "front-light",
            Self::Back => "back-light",
        }
    }
}

/// A picture and where it lies.
pub(super) struct Picture {
    /// The member.
    pub member: Member,
    /// Its name without the folders around everything.
    pub inner: String,
}

impl Picture {
    /// The light that its folder stands for, and its name within that folder.
    pub(super) fn in_light_folder(&self) -> Option<(Light, &str)> {
        let (folder, rest) = self.inner.split_once('/')?;
        Some((Light::of_folder(folder)?, rest))
    }
}

/// The slices of both lights, in order.
pub(super) struct Sorted {
    pub front: Vec<Member>,
    pub back: Vec<Member>,
}

/// Finds the slices among the members, sorts them by light and puts them in order.
pub(super) fn sort(
    container: &Container,
    limits: &ArchiveLimits,
    warnings: &mut Vec<Warning>,
) -> Result<Sorted, Fault> {
    let members = container.members()?;
    refuse_same_names(&members)?;
    let (pictures, others) = split(members, warnings)?;
    if pictures.is_empty() {
        return Err(Fault::new(Code::InvalidArchive, "the zip holds no JPEG, PNG or TIFF pictures"));
    }
    let (pictures, wrapper) = unwrapped(pictures);
    refuse_twins(&pictures)?;
    refuse_too_much(&pictures, limits)?;

    let manifest = manifest::find(container, &others, &wrapper, limits, warnings)?;
    let used = manifest.as_ref().map(|(member, _)| member.index);
    warn_of_others(others.iter().filter(|other| Some(other.index) != used), warnings);

    let sorted = match manifest {
        Some((_, manifest)) => manifest.apply(pictures)?,
        None => {
            let (mut front, mut back) = by_folder(pictures)?;
            order::sort(&mut front, |member| &member.name, warnings);
            order::sort(&mut back, |member| &member.name, warnings);
            Sorted { front, back }
        }
    };
    refuse_counts(&sorted)?;
    Ok(sorted)
}

/// Two names that are the same once cleaned, or on a computer that does not tell upper from lower case.
fn refuse_same_names(members: &[Member]) -> Result<(), Fault> {
    let mut seen: HashMap<String, &str> = HashMap::new();
    for member in members {
        if let Some(other) = seen.insert(member.name.to_lowercase(), &member.name) {
            let detail = format!("the zip has {other} and {}, which is the same name; rename one", member.name);
            return Err(invalid(&member.name, detail));
        }
    }
    Ok(())
}

/// Pictures, and everything else. A camera raw file beside a picture of the same name is passed over; one without is
/// refused, and so is any picture of a kind that is not read.
fn split(members: Vec<Member>, warnings: &mut Vec<Warning>) -> Result<(Vec<Member>, Vec<Member>), Fault> {
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
    let stem_of = |member: &Member| names::stem(&member.name).to_lowercase();
    let stems: std::collections::HashSet<String> = pictures.iter().map(stem_of).collect();
    if let Some((member, format)) = raw.iter().find(|(member, _)| !stems.contains(&stem_of(member))) {
        return Err(codec::ImageFault::Raw(format).in_file(&member.name, None));
    }
    if !raw.is_empty() {
        let names = listed(raw.iter().map(|(member, _)| member.name.as_str()));
        warnings.push(Warning::new(
            "raw_passed_over",
            format!("{names}: camera raw files beside pictures of the same name were passed over"),
        ));
    }
    Ok((pictures, others))
}

/// Takes away the folders around all pictures; says which.
fn unwrapped(pictures: Vec<Member>) -> (Vec<Picture>, String) {
    let mut wrapper = String::new();
    while let Some(folder) = common_folder(&pictures, wrapper.len()) {
        if Light::of_folder(&folder).is_some() {
            break;
        }
        wrapper.push_str(&folder);
        wrapper.push('/');
    }
    let strip = |member: Member| Picture { inner: member.name[wrapper.len()..].to_owned(), member };
    (pictures.into_iter().map(strip).collect(), wrapper)
}

fn common_folder(pictures: &[Member], from: usize) -> Option<String> {
    let (first, _) = pictures.first()?.name[from..].split_once('/')?;
    let in_it = |member: &Member| member.name[from..].split_once('/').is_some_and(|(folder, _)| folder == first);
    pictures.iter().all(in_it).then(|| first.to_owned())
}

/// The same picture in two formats would be counted twice.
fn refuse_twins(pictures: &[Picture]) -> Result<(), Fault> {
    let mut seen: HashMap<String, &str> = HashMap::new();
    for picture in pictures {
        let name = &picture.member.name;
        if let Some(other) = seen.insert(names::stem(name).to_lowercase(), name) {
            let detail = format!("{other} and {name} look like one slice in two formats; keep only one of the formats");
            return Err(invalid(name, detail));
        }
    }
    Ok(())
}

fn refuse_too_much(pictures: &[Picture], limits: &ArchiveLimits) -> Result<(), Fault> {
    let total = pictures.iter().fold(0u64, |sum, picture| sum.saturating_add(picture.member.size));
    if total > limits.max_total_bytes {
        let most = limits.max_total_bytes;
        let detail = format!("the pictures have {total} bytes unpacked; at most {most} are read");
        return Err(Fault::new(Code::ArchiveTooLarge, detail));
    }
    Ok(())
}

fn warn_of_others<'a>(others: impl Iterator<Item = &'a Member>, warnings: &mut Vec<Warning>) {
    let names: Vec<&str> = others.map(|member| member.name.as_str()).collect();
    if !names.is_empty() {
        warnings.push(Warning::new("files_passed_over", format!("{}: not pictures, passed over", listed(names))));
    }
}

/// Sorts by folder: `front` and `back`, or the root for front.
fn by_folder(pictures: Vec<Picture>) -> Result<(Vec<Member>, Vec<Member>), Fault> {
    let (mut root, mut front, mut back) = (Vec::new(), Vec::new(), Vec::new());
    let mut strange: BTreeMap<String, String> = BTreeMap::new();
    for picture in pictures {
        match (picture.in_light_folder(), picture.inner.split_once('/')) {
            (Some((Light::Front, _)), _) => front.push(picture),
            (Some((Light::Back, _)), _) => back.push(picture),
            (None, None) => root.push(picture),
            (None, Some((folder, _))) => {
                strange.entry(folder.to_owned()).or_insert(picture.member.name);
            }
        }
    }
    if let Some(example) = strange.values().next() {
        let folders = listed(strange.keys().map(String::as_str));
        let detail = format!(
            "the pictures lie in folders that are neither front nor back ({folders}); put the front-light slices into \
             front/ and the back-light slices into back/, one stack per zip"
        );
        return Err(invalid(example, detail));
    }
    if let (Some(loose), false) = (root.first(), front.is_empty()) {
        let detail = format!(
            "there are pictures in front/ and outside of it ({}), so it is not clear which are the slices; put all \
             front-light slices into front/",
            loose.member.name
        );
        return Err(invalid(&loose.member.name, detail));
    }
    root.append(&mut front);
    Ok((in_one_folder(root, Light::Front)?, in_one_folder(back, Light::Back)?))
}

/// All slices of a light lie in one folder: two folders would mix two stacks.
fn in_one_folder(pictures: Vec<Picture>, light: Light) -> Result<Vec<Member>, Fault> {
    let folder_of = |picture: &Picture| picture.inner.rsplit_once('/').map(|(folder, _)| folder.to_owned());
    if let Some(first) = pictures.first().map(folder_of)
        && let Some(other) = pictures.iter().find(|picture| folder_of(picture) != first)
    {
        let word = light.word();
        let (a, b) = (first.unwrap_or_default(), folder_of(other).unwrap_or_default());
        let detail =
            format!("the {word} slices lie in several folders ({a}, {b}); put all of one stack into one folder");
        return Err(invalid(&other.member.name, detail));
    }
    Ok(pictures.into_iter().map(|picture| picture.member).collect())
}

fn refuse_counts(sorted: &Sorted) -> Result<(), Fault> {
    let (front, back) = (sorted.front.len(), sorted.back.len());
    let mismatch = |detail: String| Err(Fault::new(Code::SliceCountMismatch, detail));
    if front == 0 {
        return mismatch(format!(
            "the zip has {back} back-light slices and no front-light slices; add the folder front/"
        ));
    }
    if front < 2 {
        return mismatch("the zip has 1 front-light slice; a focus stack has at least 2".into());
    }
    if back != 0 && back != front {
        return mismatch(format!(
            "the zip has {front} front-light slices and {back} back-light slices; both must be taken at the same rail \
             positions"
        ));
    }
    if front > MAX_SLICES {
        let detail = format!("the zip has {front} slices per light; at most {MAX_SLICES} are read");
        return Err(Fault::new(Code::ArchiveTooLarge, detail));
    }
    Ok(())
}
