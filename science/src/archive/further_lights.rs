//! Further lights of a stack: folders beside `front` and `back` with slices of the same view, taken at the same rail
//! positions under another light (ultraviolet, a lamp from the left, a crossed polariser).
//!
//! In: the pictures of a zip that has a folder for the front light. Out: those in other folders, by folder. Folders
//! that are rather a view of a scan, results or a target are refused, because they are no light.

use super::{
    headers::{self, Common},
    members::{Member, Picture},
    messages::{invalid, listed, one_or_more},
    other_folders, slice_order,
    slices::ArchivedSlices,
};
use crate::types::{Error, ErrorKind, Warning, text::folded, view::ViewAngles};

/// Maximum number of further lights.
const MAX_LIGHTS: usize = 16;
/// Maximum length of a name, bytes.
const LONGEST_NAME: usize = 32;

/// A further light: its name, and its slices.
pub(super) type Named<T> = (String, T);

/// The further lights among `pictures`, which lie in folders that stand for neither front nor back: by name, each in
/// the order of the names of its files.
///
/// # Errors
/// [`ErrorKind::InvalidArchive`] for a folder that is no further light, a light in several folders, and more than
/// [`MAX_LIGHTS`].
pub(super) fn by_folder(pictures: Vec<Picture>) -> Result<Vec<Named<Vec<Member>>>, Error> {
    let mut lights: Vec<(Named<Vec<Member>>, String)> = Vec::new();
    for picture in pictures {
        let folder = picture.inner.split('/').next().unwrap_or_default();
        let inside = picture.inner.rsplit_once('/').map_or("", |(inside, _)| inside);
        match lights.iter_mut().find(|((name, _), _)| folded(name) == folded(folder)) {
            Some(((name, _), first)) if folded(first) != folded(inside) => {
                let detail = format!(
                    "the slices of the further light {name} are in several folders ({first}, {inside}); put them into one"
                );
                return Err(invalid(&picture.member.name, detail));
            }
            Some(((_, members), _)) => members.push(picture.member),
            None => {
                require_name(folder).map_err(|detail| invalid(&picture.member.name, detail))?;
                let inside = inside.to_owned();
                lights.push(((folder.to_owned(), vec![picture.member]), inside));
            }
        }
    }
    let mut lights: Vec<_> = lights.into_iter().map(|(light, _)| light).collect();
    refuse_many(&lights)?;
    lights.sort_by_cached_key(|(name, _)| folded(name));
    for (_, members) in &mut lights {
        slice_order::sort(members, |member| &member.name, &mut Vec::new());
    }
    Ok(lights)
}

/// Why `name` can be the name of no further light, and what to do.
pub(super) fn require_name(name: &str) -> Result<(), String> {
    let is_letter = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_';
    if ViewAngles::of_name(name).is_some() {
        return Err(format!(
            "the folder {name} is named like a view of a scan, and a zip with front/ holds one view; send a scan to \
             /v1/scans/{{scan}}/archive, with front/ inside the folder of each view, or give a further light a name \
             without angles"
        ));
    }
    if let Some(reason) = other_folders::no_slices(name) {
        return Err(format!("the folder {name} is no further light, because {reason}; remove it from the zip"));
    }
    if name.is_empty() || name.len() > LONGEST_NAME || !name.bytes().all(is_letter) {
        return Err(format!(
            "the folder {name} beside front/ would be a further light, but the name of a light has 1 to {LONGEST_NAME} \
             letters from a to z, digits, '-' and '_'; rename the folder, or remove it from the zip"
        ));
    }
    Ok(())
}

/// Refuses more than [`MAX_LIGHTS`].
pub(super) fn refuse_many<T>(lights: &[Named<T>]) -> Result<(), Error> {
    if lights.len() <= MAX_LIGHTS {
        return Ok(());
    }
    let names = listed(lights.iter().map(|(name, _)| name.as_str()));
    let detail = format!(
        "the zip has {} folders beside front and back ({names}); at most {MAX_LIGHTS} further lights are fused: send the \
         others in a second zip with the same front light",
        lights.len()
    );
    Err(Error::new(ErrorKind::InvalidArchive, detail))
}

/// The slices of a further light, checked against what the others have in `common`, and in order. `none`: no slices.
pub(super) fn checked(
    (name, slices): Named<ArchivedSlices>,
    none: &ArchivedSlices,
    common: &mut Common,
    (most, is_listed): (u64, bool),
    warnings: &mut Vec<Warning>,
) -> Result<Named<ArchivedSlices>, Error> {
    let own = headers::check_beside(&slices, &format!("slices of the further light {name}"), none, common, most)?;
    let settled = slice_order::settle(&slices.names(), &own.taken[0], is_listed);
    warnings.extend(settled.warnings);
    Ok((name, slices.reordered(&settled.order).sized(own.width, own.height)))
}

/// Refuses a further light with another number of slices than the front light.
pub(super) fn refuse_count((name, names): (&str, &[String]), front: &[String], why: &str) -> Result<(), Error> {
    if names.len() == front.len() {
        return Ok(());
    }
    let (found, expected) = (names.len(), front.len());
    let slices = one_or_more(found, "slice", "slices");
    let detail = format!(
        "the further light {name} has {found} {slices} and the front light {expected}; both must be taken at the same rail \
         positions{why}; add or remove slices in the folder {name}, or remove the folder"
    );
    Err(Error::new(ErrorKind::SliceCountMismatch, detail).in_file(name, None))
}
