//! The moved target in the zip of a calibration: pictures of the same target, nearer to the lens, in a folder of their
//! own.
//!
//! In: the pictures of the zip. Out: those below a folder `moved`, apart from the others and in order. Where all
//! pictures are below such a folder, it only encloses them.

use super::{
    headers::{self, Common},
    light::plain,
    members::Member,
    messages::invalid,
    slice_order,
    slices::ArchivedSlices,
};
use crate::{
    imaging::Slices,
    types::{Error, Warning, text::folded},
};

/// Names of the folder: English, German, French, Spanish, Italian, Dutch.
const FOLDER: [&str; 7] = ["moved", "movedtarget", "verschoben", "deplace", "movido", "spostato", "verplaatst"];

/// Separates the pictures of the moved target, in the order of their names, from all others, which come first.
pub(super) fn split(pictures: Vec<Member>) -> Result<(Vec<Member>, Vec<Member>), Error> {
    let is_moved = |picture: &Member| picture.folder().split('/').any(|part| FOLDER.contains(&plain(part).as_str()));
    let (mut moved, others): (Vec<_>, Vec<_>) = pictures.into_iter().partition(is_moved);
    if others.is_empty() {
        return Ok((moved, others));
    }
    let folder = moved.first().map(|first| first.folder().to_owned()).unwrap_or_default();
    if let Some(other) = moved.iter().find(|other| folded(other.folder()) != folded(&folder)) {
        let detail = format!(
            "the pictures of the moved target are in several folders ({folder}, {}); put them into one",
            other.folder()
        );
        return Err(invalid(&other.name, detail));
    }
    slice_order::sort(&mut moved, |member| &member.name, &mut Vec::new());
    Ok((others, moved))
}

/// The slices of the moved target, checked against what the others have in `common`. `none`: no slices.
pub(super) fn checked(
    moved: ArchivedSlices,
    none: &ArchivedSlices,
    common: &mut Common,
    most: u64,
    warnings: &mut Vec<Warning>,
) -> Result<ArchivedSlices, Error> {
    if moved.count() == 0 {
        return Ok(moved);
    }
    let own = headers::check_beside(&moved, "pictures of the moved target", none, common, most)?;
    let settled = slice_order::settle(&moved.names(), &own.taken[0], false);
    warnings.extend(settled.warnings);
    Ok(moved.reordered(&settled.order).sized(own.width, own.height))
}
