//! Compares the headers of all slices: they must agree in size and orientation.

use std::collections::BTreeMap;

use super::{
    light::Light,
    messages::{listed, one_or_more},
    slices::ArchivedSlices,
};
use crate::{
    imaging::{
        Slices,
        codec::{CaptureTime, ColourSpace, Header},
    },
    types::{Error, ErrorKind, Warning, WarningCode, error::ErrorLocation},
};

/// Properties of the whole stack.
pub(super) struct Common {
    pub width: u32,
    pub height: u32,
    /// The maximum, when slices differ.
    pub bit_depth: u8,
    /// The maximum, when slices differ.
    pub channels: u8,
    /// EXIF orientation of all slices, 1 without a tag.
    pub orientation: u8,
    /// When the slices of the front light, and of the back light, were taken, as far as known.
    pub taken: [Vec<Option<CaptureTime>>; 2],
}

/// A header and its slice.
struct Found<'a> {
    name: &'a str,
    light: Light,
    index: usize,
    header: Header,
}

/// Reads the headers of all slices of both lights and checks that they agree.
///
/// At most `most` bytes of a compressed slice are decompressed. Slices whose header is beyond them are skipped; if that
/// applies to all slices of one light, its first slice is decompressed completely: lights may differ in bit depth.
pub(super) fn check(
    front: &ArchivedSlices,
    back: &ArchivedSlices,
    most: u64,
    warnings: &mut Vec<Warning>,
) -> Result<Common, Error> {
    let mut found = Vec::new();
    for (slices, light) in [(front, Light::Front), (back, Light::Back)] {
        let before = found.len();
        for index in 0..slices.count() {
            if let Some(header) = slices.header(index, most)? {
                found.push(Found { name: slices.name(index), light, index, header });
            }
        }
        if found.len() == before
            && slices.count() > 0
            && let Some(header) = slices.header(0, u64::MAX)?
        {
            found.push(Found { name: slices.name(0), light, index: 0, header });
        }
    }
    refuse_turned(&found)?;
    let (width, height) = refuse_sizes(&found)?;
    let largest = |of: fn(&Header) -> u8| found.iter().map(|f| of(&f.header)).max().unwrap_or_default();
    let (bit_depth, channels) = (largest(|h| h.bit_depth), largest(|h| h.channels));
    // the two lights may differ: grey is sufficient for a silhouette
    let (front_found, back_found) = found.split_at(found.partition_point(|f| f.light == Light::Front));
    let bits = |h: &Header| format!("has {} bits per sample", h.bit_depth);
    let colour = |h: &Header| if h.channels == 1 { "is grey" } else { "is in colour" }.to_owned();
    let lights = [front_found, back_found];
    let depth_of = |h: &Header| h.bit_depth;
    let depths = |found: &&[Found<'_>]| mixed(WarningCode::MixedBitDepth, "in bit depth", found, depth_of, bits);
    warnings.extend(lights.iter().filter_map(depths));
    let channels_of = |h: &Header| h.channels;
    let colours = |found: &&[Found<'_>]| mixed(WarningCode::MixedColour, "in colour", found, channels_of, colour);
    warnings.extend(lights.iter().filter_map(colours));
    let (space_of, space) = (|h: &Header| h.colour, |h: &Header| h.colour.clause().to_owned());
    let in_space = "in colour space, and are fused as they are";
    warnings.extend(mixed(WarningCode::MixedColourSpaces, in_space, front_found, space_of, space));
    warnings.extend(unknown_colours(front_found));
    let orientation = usual(&found, |header| header.orientation).unwrap_or(1);
    let taken = [(Light::Front, front), (Light::Back, back)].map(|(light, slices)| {
        let mut taken = vec![None; slices.count()];
        found.iter().filter(|f| f.light == light).for_each(|f| taken[f.index] = f.header.taken);
        taken
    });
    Ok(Common { width, height, bit_depth, channels, orientation, taken })
}

/// Checks slices beside those of front and back light against what these have in `common`, whose bit depth and channels
/// become the maximum of all. `what` names them in sentences. `none`: no slices.
///
/// # Errors
/// As [`check`], and [`ErrorKind::SizeMismatch`] for another size or orientation.
pub(super) fn check_beside(
    slices: &ArchivedSlices,
    what: &str,
    none: &ArchivedSlices,
    common: &mut Common,
    most: u64,
) -> Result<Common, Error> {
    let own = check(slices, none, most, &mut Vec::new())?;
    let says = |of: &Common| match of.orientation {
        1 => format!("{} x {} px", of.width, of.height),
        tag => format!("{} x {} px with the orientation tag {tag}", of.width, of.height),
    };
    let (here, there) = (says(&own), says(common));
    if here != there {
        let name = slices.name(0);
        let detail = format!(
            "the {what} have {here} ({name}), and the others {there}: take both with the same settings of the camera"
        );
        return Err(Error::new(ErrorKind::SizeMismatch, detail).in_file(name, None));
    }
    common.bit_depth = common.bit_depth.max(own.bit_depth);
    common.channels = common.channels.max(own.channels);
    Ok(own)
}

/// A warning for slices in a colour space that no output can state.
fn unknown_colours(found: &[Found<'_>]) -> Option<Warning> {
    let odd: Vec<&str> = found.iter().filter(|f| f.header.colour == ColourSpace::Unknown).map(|f| f.name).collect();
    let have = one_or_more(odd.len(), "has", "have");
    let detail = format!(
        "{} of {} slices {have} a colour space that is not known, or a colour profile for another kind of picture, so \
         the image has no profile and is shown as sRGB: {}; save all slices in sRGB, or with an ICC profile for RGB",
        odd.len(),
        found.len(),
        listed(odd.iter().copied())
    );
    (!odd.is_empty()).then(|| Warning::new(WarningCode::UnknownColourSpace, detail))
}

/// A warning when slices of one light differ `in_what`. Names the first slice and the first of another `value`, with a
/// `clause` about each.
fn mixed<T: PartialEq>(
    code: WarningCode,
    in_what: &str,
    found: &[Found<'_>],
    value: impl Fn(&Header) -> T,
    clause: impl Fn(&Header) -> String,
) -> Option<Warning> {
    let first = found.first()?;
    let other = found.iter().find(|f| value(&f.header) != value(&first.header))?;
    let (is, other_is) = (clause(&first.header), clause(&other.header));
    let detail = format!(
        "the {} slices differ {in_what}: {} {is}, {} {other_is}; use the same settings for all slices of one light",
        first.light.word(),
        first.name,
        other.name
    );
    Some(Warning::new(code, detail))
}

/// The most frequent value; of equally frequent ones the first.
fn usual<T: Ord + Copy>(found: &[Found<'_>], value: impl Fn(&Header) -> T) -> Option<T> {
    let mut counts: BTreeMap<T, (usize, usize)> = BTreeMap::new();
    for (position, f) in found.iter().enumerate() {
        let entry = counts.entry(value(&f.header)).or_insert((0, position));
        entry.0 += 1;
    }
    counts.into_iter().max_by_key(|(_, (count, position))| (*count, usize::MAX - position)).map(|(value, _)| value)
}

/// Refuses slices with different orientation tags. Tags are applied on decoding. When only some slices are rotated, the
/// orientation sensor was misled (a camera that looks down on a specimen), and the homographies would not match them.
fn refuse_turned(found: &[Found<'_>]) -> Result<(), Error> {
    let Some(usual) = usual(found, |header| header.orientation) else { return Ok(()) };
    let odd: Vec<&Found<'_>> = found.iter().filter(|f| f.header.orientation != usual).collect();
    if odd.is_empty() {
        return Ok(());
    }
    let detail = format!(
        "{} of {} slices {} another orientation tag than the rest: {}; switch off the automatic rotation of the \
         camera, and set the same tag in all slices or remove it",
        odd.len(),
        found.len(),
        one_or_more(odd.len(), "has", "have"),
        listed(odd.iter().map(|f| f.name))
    );
    let describe = |f: &Found<'_>| format!("orientation {} instead of {usual}", f.header.orientation);
    Err(with_locations(Error::new(ErrorKind::InvalidImage, detail), &odd, describe))
}

fn refuse_sizes(found: &[Found<'_>]) -> Result<(u32, u32), Error> {
    let size_of = |header: &Header| (header.width, header.height);
    let Some((width, height)) = usual(found, size_of) else {
        return Err(Error::new(
            ErrorKind::SliceCountMismatch,
            "the zip holds no slices; put the pictures of the stack into it, as JPEG, PNG or TIFF",
        ));
    };
    let odd: Vec<&Found<'_>> = found.iter().filter(|f| size_of(&f.header) != (width, height)).collect();
    let Some(first) = odd.first() else { return Ok((width, height)) };
    let detail = format!(
        "{} of {} slices {} not {width} x {height} px like the rest: {} ({} x {} px); remove files that are not slices \
         from the zip, and use the same camera settings for all slices",
        odd.len(),
        found.len(),
        one_or_more(odd.len(), "is", "are"),
        listed(odd.iter().map(|f| f.name)),
        first.header.width,
        first.header.height
    );
    let describe = |f: &Found<'_>| format!("{} x {} px", f.header.width, f.header.height);
    Err(with_locations(Error::new(ErrorKind::SizeMismatch, detail), &odd, describe))
}

fn with_locations(error: Error, odd: &[&Found<'_>], describe: impl Fn(&Found<'_>) -> String) -> Error {
    odd.iter().fold(error, |error, f| {
        error.at(ErrorLocation {
            detail: describe(f),
            pointer: None,
            file: Some(f.name.to_owned()),
            slice: u32::try_from(f.index).ok(),
        })
    })
}
