//! What the headers of the slices tell together: they must be of one size and lie the same way.

use std::collections::BTreeMap;

use super::{light::Light, listed, slices::ArchivedSlices};
use crate::{
    imaging::{Slices, codec::Header},
    types::{Error, ErrorKind, Warning, error::ErrorLocation},
};

/// What all slices have in common.
pub(super) struct Common {
    pub width: u32,
    pub height: u32,
    /// The larger, when slices differ.
    pub bit_depth: u8,
    /// The larger, when slices differ.
    pub channels: u8,
    /// Orientation tag of all slices, 1 without one.
    pub orientation: u8,
}

/// A header with the slice it belongs to.
struct Found<'a> {
    name: &'a str,
    light: Light,
    index: usize,
    header: Header,
}

/// Reads the headers of all slices of both lights and checks that they fit each other.
///
/// Of compressed slices at most `most` bytes are unpacked; those whose header lies behind them are left out, but the first
/// when it would be all of them.
pub(super) fn check(
    front: &ArchivedSlices,
    back: &ArchivedSlices,
    most: u64,
    warnings: &mut Vec<Warning>,
) -> Result<Common, Error> {
    let mut found = Vec::new();
    for slices in [front, back] {
        for index in 0..slices.count() {
            if let Some(header) = slices.header(index, most)? {
                let light = if std::ptr::eq(slices, front) { Light::Front } else { Light::Back };
                found.push(Found { name: slices.name(index), light, index, header });
            }
        }
    }
    if found.is_empty()
        && let Some(header) = front.header(0, u64::MAX)?
    {
        found.push(Found { name: front.name(0), light: Light::Front, index: 0, header });
    }
    refuse_turned(&found)?;
    let (width, height) = refuse_sizes(&found)?;
    let largest = |of: fn(&Header) -> u8| found.iter().map(|f| of(&f.header)).max().unwrap_or_default();
    let (bit_depth, channels) = (largest(|h| h.bit_depth), largest(|h| h.channels));
    // the lights may differ from each other: grey is enough for a silhouette
    let (front_found, back_found) = found.split_at(found.partition_point(|f| f.light == Light::Front));
    if [front_found, back_found].iter().any(|light| differ(light, |h| h.bit_depth)) {
        warnings.push(Warning::new("mixed_bit_depth", "some slices of one light have 8 bits per sample and some 16"));
    }
    if [front_found, back_found].iter().any(|light| differ(light, |h| h.channels)) {
        warnings.push(Warning::new("mixed_colour", "some slices of one light are grey and some in colour"));
    }
    let orientation = usual(&found, |header| header.orientation).unwrap_or(1);
    Ok(Common { width, height, bit_depth, channels, orientation })
}

fn differ(found: &[Found<'_>], value: impl Fn(&Header) -> u8) -> bool {
    found.windows(2).any(|pair| value(&pair[0].header) != value(&pair[1].header))
}

/// The value that most slices have; the first of them when there are several such values.
fn usual<T: Ord + Copy>(found: &[Found<'_>], value: impl Fn(&Header) -> T) -> Option<T> {
    let mut counts: BTreeMap<T, (usize, usize)> = BTreeMap::new();
    for (position, f) in found.iter().enumerate() {
        let entry = counts.entry(value(&f.header)).or_insert((0, position));
        entry.0 += 1;
    }
    counts.into_iter().max_by_key(|(_, (count, position))| (*count, usize::MAX - position)).map(|(value, _)| value)
}

/// Orientation tags are applied; where only some slices are turned, the camera was fooled (it looks down on a
/// specimen), and the homographies would fit none of them.
fn refuse_turned(found: &[Found<'_>]) -> Result<(), Error> {
    let Some(usual) = usual(found, |header| header.orientation) else { return Ok(()) };
    let odd: Vec<&Found<'_>> = found.iter().filter(|f| f.header.orientation != usual).collect();
    if odd.is_empty() {
        return Ok(());
    }
    let detail = format!(
        "{} of {} slices carry another orientation tag than the others: {}; switch off the automatic rotation of the \
         camera, and remove the tag or set it alike in all slices",
        odd.len(),
        found.len(),
        listed(odd.iter().map(|f| f.name))
    );
    let said = |f: &Found<'_>| format!("orientation {} instead of {usual}", f.header.orientation);
    Err(places(Error::new(ErrorKind::InvalidImage, detail), &odd, said))
}

fn refuse_sizes(found: &[Found<'_>]) -> Result<(u32, u32), Error> {
    let size_of = |header: &Header| (header.width, header.height);
    let Some((width, height)) = usual(found, size_of) else {
        return Err(Error::new(ErrorKind::SliceCountMismatch, "the zip holds no slices"));
    };
    let odd: Vec<&Found<'_>> = found.iter().filter(|f| size_of(&f.header) != (width, height)).collect();
    let Some(first) = odd.first() else { return Ok((width, height)) };
    let detail = format!(
        "{} of {} slices are not {width} x {height} px like the others: {} ({} x {} px); take what is no slice out of the \
         zip, and use the same settings of the camera for all slices",
        odd.len(),
        found.len(),
        listed(odd.iter().map(|f| f.name)),
        first.header.width,
        first.header.height
    );
    let said = |f: &Found<'_>| format!("{} x {} px", f.header.width, f.header.height);
    Err(places(Error::new(ErrorKind::SizeMismatch, detail), &odd, said))
}

fn places(fault: Error, odd: &[&Found<'_>], said: impl Fn(&Found<'_>) -> String) -> Error {
    odd.iter().fold(fault, |fault, f| {
        fault.at(ErrorLocation {
            detail: said(f),
            pointer: None,
            file: Some(f.name.to_owned()),
            slice: u32::try_from(f.index).ok(),
        })
    })
}
