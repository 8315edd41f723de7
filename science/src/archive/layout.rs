//! Which members are slices, and of which light.

use std::collections::{BTreeMap, HashMap};

use super::{
    ArchiveLimits,
    container::Container,
    invalid,
    light::Light,
    listed, manifest, member_names,
    members::{Member, Picture, SortedSlices},
    natural_order,
};
use crate::{
    imaging::codec,
    types::{Error, ErrorKind, Warning, profile::MAX_SLICES},
};

/// Finds the slices among the members, sorts them by light and puts them in order.
pub(super) fn sort(
    container: &Container,
    limits: &ArchiveLimits,
    warnings: &mut Vec<Warning>,
) -> Result<SortedSlices, Error> {
    let members = container.members()?;
    refuse_same_names(&members)?;
    warn_of_names(&members, warnings);
    let (pictures, others) = split(members, warnings)?;
    if pictures.is_empty() {
        return Err(no_pictures(&others));
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
            natural_order::sort(&mut front, |member| &member.name, warnings);
            natural_order::sort(&mut back, |member| &member.name, warnings);
            SortedSlices { front, back }
        }
    };
    refuse_extremes(&sorted)?;
    Ok(sorted)
}

/// A zip without pictures: most often the zip was zipped once more.
fn no_pictures(others: &[Member]) -> Error {
    let is_archive = |member: &&Member| {
        let name = member.name.to_lowercase();
        [".zip", ".7z", ".rar", ".tar", ".gz", ".tgz"].iter().any(|extension| name.ends_with(extension))
    };
    let archives: Vec<&str> = others.iter().filter(is_archive).map(|member| member.name.as_str()).collect();
    let detail = match (&archives[..], others) {
        ([], []) => "the zip is empty; put the slices into it".to_owned(),
        ([], _) => format!(
            "the zip holds no JPEG, PNG or TIFF pictures; it holds {}",
            listed(others.iter().map(|member| member.name.as_str()))
        ),
        ([one], _) if one.to_lowercase().ends_with(".zip") => {
            format!("the zip holds no pictures but another zip, {one}: send that one")
        }
        (several, _) => format!(
            "the zip holds no pictures but other archives, {}: send one zip per stack, with the pictures themselves in it",
            listed(several.iter().copied())
        ),
    };
    Error::new(ErrorKind::InvalidArchive, detail)
}

/// Names in a code page that the zip does not tell.
fn warn_of_names(members: &[Member], warnings: &mut Vec<Warning>) {
    let unclear: Vec<&str> = members.iter().filter(|m| m.unclear_name).map(|m| m.name.as_str()).collect();
    if !unclear.is_empty() {
        warnings.push(Warning::new(
            "unclear_file_names",
            format!(
                "{}: the zip does not tell the code page of these names, so that they may be shown with wrong \
                 letters; digits, and so the order by number, are right; make the zip with UTF-8 names (7-Zip: -mcu=on)",
                listed(unclear)
            ),
        ));
    }
}

/// Two names that are the same once cleaned, or on a computer that does not tell upper from lower case.
fn refuse_same_names(members: &[Member]) -> Result<(), Error> {
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
fn split(members: Vec<Member>, warnings: &mut Vec<Warning>) -> Result<(Vec<Member>, Vec<Member>), Error> {
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
    let stem_of = |member: &Member| member_names::stem(&member.name).to_lowercase();
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
fn refuse_twins(pictures: &[Picture]) -> Result<(), Error> {
    let mut seen: HashMap<String, &str> = HashMap::new();
    for picture in pictures {
        let name = &picture.member.name;
        if let Some(other) = seen.insert(member_names::stem(name).to_lowercase(), name) {
            let detail = format!("{other} and {name} look like one slice in two formats; keep only one of the formats");
            return Err(invalid(name, detail));
        }
    }
    Ok(())
}

fn refuse_too_much(pictures: &[Picture], limits: &ArchiveLimits) -> Result<(), Error> {
    let total = pictures.iter().fold(0u64, |sum, picture| sum.saturating_add(picture.member.size));
    if total > limits.max_total_bytes {
        let most = limits.max_total_bytes;
        let detail = format!("the pictures have {total} bytes unpacked; at most {most} are read");
        return Err(Error::new(ErrorKind::ArchiveTooLarge, detail));
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
fn by_folder(pictures: Vec<Picture>) -> Result<(Vec<Member>, Vec<Member>), Error> {
    let (mut root, mut front, mut back) = (Vec::new(), Vec::new(), Vec::new());
    let mut strange: BTreeMap<String, String> = BTreeMap::new();
    for picture in pictures {
        match (picture.in_light_folder(), picture.inner.split_once('/')) {
            (Some((Light::Front, _)), _) => front.push(picture),
            (Some((Light::Back, _)), _) => back.push(picture),
            (None, None) => root.push(picture),
            (None, Some((folder, _))) => {
                let whole = picture.member.name[..picture.member.name.len() - picture.inner.len()].to_owned() + folder;
                strange.entry(whole).or_insert(picture.member.name);
            }
        }
    }
    if let Some(example) = strange.values().next() {
        return Err(invalid(example, strange_folders(&strange)));
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

/// Folders, and a picture in each, of which no light is known.
fn strange_folders(strange: &BTreeMap<String, String>) -> String {
    let folders = listed(strange.keys().map(String::as_str));
    let looks_like_a_view = |folder: &String| member_names::base(folder).bytes().any(|byte| byte.is_ascii_digit());
    if strange.len() > 1 && strange.keys().all(looks_like_a_view) {
        return format!(
            "the pictures lie in {} folders that are neither front nor back ({folders}), like the views of a scan; \
             one zip holds one stack: send each folder as a zip of its own",
            strange.len()
        );
    }
    format!(
        "the pictures lie in folders that are neither front nor back ({folders}); put the front-light slices into \
         front/ and the back-light slices into back/ (German, French, Spanish, Italian and Dutch words are understood \
         too), one stack per zip"
    )
}

/// All slices of a light lie in one folder: two folders would mix two stacks.
fn in_one_folder(pictures: Vec<Picture>, light: Light) -> Result<Vec<Member>, Error> {
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

/// What the directory alone tells of the number of slices; the rest waits until the headers were looked at, which may
/// say why there are too many or too few.
fn refuse_extremes(sorted: &SortedSlices) -> Result<(), Error> {
    let (front, back) = (sorted.front.len(), sorted.back.len());
    if front == 0 {
        let detail = format!("the zip has {back} back-light slices and no front-light slices; add the folder front/");
        return Err(Error::new(ErrorKind::SliceCountMismatch, detail));
    }
    if front > MAX_SLICES || back > MAX_SLICES {
        let most = front.max(back);
        let detail = format!("the zip has {most} slices per light; at most {MAX_SLICES} are read");
        return Err(Error::new(ErrorKind::ArchiveTooLarge, detail));
    }
    Ok(())
}
