//! What a page of a TIFF says about its colours.

use std::io::{Read, Seek};

use ::tiff::{
    Directory, TiffResult,
    decoder::{Decoder, ifd::Value},
    tags::{IfdPointer, Tag, Type, ValueBuffer},
};

use super::{ColourSpace, colour_space::resolved, colour_tags::ColourTags};

/// Tags about colours: of the page, of its Exif directory, and of the interoperability directory.
const TRANSFER_FUNCTION: u16 = 301;
const WHITE_POINT: u16 = 318;
const PRIMARIES: u16 = 319;
const COLOUR_SPACE: u16 = 0xA001;
const GAMMA: u16 = 0xA500;
const INTEROPERABILITY: u16 = 0xA005;
const INDEX: u16 = 1;

/// The ICC profile for outputs, and the colour space.
pub(super) fn colours<R: Read + Seek>(decoder: &mut Decoder<R>, channels: u8) -> (Option<Vec<u8>>, ColourSpace) {
    let mut value = ValueBuffer::empty(Type::BYTE);
    let found = decoder.image_ifd().find_tag_buf(Tag::IccProfile, &mut value).ok().flatten();
    let icc = found.map(|_| value.as_bytes().to_vec()).filter(|icc| !icc.is_empty());
    let tags = if icc.is_none() { colour_tags(decoder) } else { ColourTags::default() };
    resolved(icc, tags.declared(), channels)
}

/// The tags of a page, its Exif directory and the interoperability directory of that.
fn colour_tags<R: Read + Seek>(decoder: &mut Decoder<R>) -> ColourTags {
    let numbers = |decoder: &mut Decoder<R>, tag| ratios(decoder.find_tag(Tag::Unknown(tag)));
    let mut tags = ColourTags {
        white: numbers(decoder, WHITE_POINT),
        primaries: numbers(decoder, PRIMARIES),
        has_transfer: decoder.image_ifd().directory().contains(Tag::Unknown(TRANSFER_FUNCTION)),
        ..ColourTags::default()
    };
    let Some(exif) = decoder.find_tag_unsigned(Tag::ExifDirectory).ok().flatten().and_then(|at| child(decoder, at))
    else {
        return tags;
    };
    let mut exif_tags = decoder.read_directory_tags(&exif);
    tags.space = exif_tags.find_tag_unsigned(Tag::Unknown(COLOUR_SPACE)).ok().flatten();
    tags.gamma = ratios(exif_tags.find_tag(Tag::Unknown(GAMMA))).first().copied();
    let interop = exif_tags.find_tag_unsigned(Tag::Unknown(INTEROPERABILITY)).ok().flatten();
    if let Some(interop) = interop.and_then(|at| child(decoder, at)) {
        let index = decoder.read_directory_tags(&interop).get_tag_ascii_string(Tag::Unknown(INDEX));
        tags.index = index.ok().map(String::into_bytes);
    }
    tags
}

/// The rational numbers of a tag.
fn ratios(found: TiffResult<Option<Value>>) -> Vec<f64> {
    let values = match found.ok().flatten() {
        Some(Value::List(values)) => values,
        one => one.into_iter().collect(),
    };
    let number = |value| match value {
        Value::Rational(numerator, denominator) => Some(f64::from(numerator) / f64::from(denominator)),
        _ => None,
    };
    values.into_iter().filter_map(number).collect()
}

/// The directory at an offset.
fn child<R: Read + Seek>(decoder: &mut Decoder<R>, at: u64) -> Option<Directory> {
    decoder.read_directory(IfdPointer(at)).ok()
}
