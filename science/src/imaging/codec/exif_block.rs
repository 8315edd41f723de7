//! Reads EXIF blocks, and writes new ones for pictures made from others.
//!
//! A block is never copied whole: its offsets, thumbnail and maker note are valid only in the original file. Known tags
//! are copied one by one.

use std::io::Cursor;

use exif::{Context, Field, In, Rational, SRational, Tag, Value, experimental::Writer};

use super::{CaptureTime, orientation};

/// Tags of the main directory that describe the picture and not its storage.
const DESCRIPTIVE: &[u16] = &[
    0x010E, // ImageDescription
    0x010F, // Make
    0x0110, // Model
    0x011A, // XResolution
    0x011B, // YResolution
    0x0128, // ResolutionUnit
    0x0131, // Software
    0x0132, // DateTime
    0x013B, // Artist
    0x013C, // HostComputer
    0x8298, // Copyright
    0xC614, // UniqueCameraModel
    0xC62F, // CameraSerialNumber
];

/// Tags of the Exif directory that are invalid for another picture: maker note, padding, positions in the picture.
const LEFT_OUT: &[u16] = &[0x927C, 0xEA1C, 0x9214, 0xA214];

/// Maximum size of a value that is copied, bytes.
const MAX_VALUE_BYTES: usize = 64 << 10;

/// Maximum size of all values together, bytes. Values may overlap, so a small hostile block could expand to a huge
/// size.
const MAX_TOTAL_BYTES: usize = 512 << 10;

/// Maximum number of fields that are copied; cameras write about a hundred.
const MAX_FIELDS: usize = 1_000;

/// A TIFF structure in memory: an EXIF block or a whole TIFF file. Untrusted; a defect in one place does not hide the
/// rest.
pub(super) struct Structure<'a> {
    data: &'a [u8],
    little: bool,
}

/// One entry of a directory.
pub(super) struct Entry<'a> {
    /// The tag.
    pub(super) number: u16,
    kind: u16,
    value: &'a [u8],
}

impl<'a> Structure<'a> {
    /// `None` for other data.
    pub(super) fn of(data: &'a [u8]) -> Option<Self> {
        match data.get(..4)? {
            [b'I', b'I', 42, 0] => Some(Self { data, little: true }),
            [b'M', b'M', 0, 42] => Some(Self { data, little: false }),
            _ => None,
        }
    }

    fn short(&self, bytes: [u8; 2]) -> u16 {
        if self.little { u16::from_le_bytes(bytes) } else { u16::from_be_bytes(bytes) }
    }

    fn long(&self, bytes: [u8; 4]) -> u32 {
        if self.little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) }
    }

    fn short_at(&self, at: usize) -> Option<u16> {
        self.data.get(at..)?.first_chunk().map(|bytes| self.short(*bytes))
    }

    /// Four bytes.
    pub(super) fn long_at(&self, at: usize) -> Option<u32> {
        self.data.get(at..)?.first_chunk().map(|bytes| self.long(*bytes))
    }

    /// The entries of the directory at `offset` whose values are readable.
    pub(super) fn entries(&self, offset: u32) -> Vec<Entry<'a>> {
        let start = offset as usize;
        let count = usize::from(self.short_at(start).unwrap_or(0));
        (0..count)
            .map_while(|i| self.data.get(start + 2 + i * 12..start + 14 + i * 12).map(|_| start + 2 + i * 12))
            .filter_map(|at| self.entry(at))
            .collect()
    }

    fn entry(&self, at: usize) -> Option<Entry<'a>> {
        let kind = self.short_at(at + 2)?;
        let unit = match kind {
            1 | 2 | 6 | 7 => 1,
            3 | 8 => 2,
            4 | 9 | 11 => 4,
            5 | 10 | 12 => 8,
            _ => return None,
        };
        let length = unit * usize::try_from(self.long_at(at + 4)?).ok()?;
        let place = if length <= 4 { at + 8 } else { self.long_at(at + 8)? as usize };
        let value = self.data.get(place..place.checked_add(length)?)?;
        Some(Entry { number: self.short_at(at)?, kind, value })
    }

    /// The entries of the directory to which the tag `pointer` in `entries` points.
    pub(super) fn child(&self, entries: &[Entry<'a>], pointer: Tag) -> Vec<Entry<'a>> {
        let found = entries.iter().find(|entry| entry.number == pointer.number());
        let offset = found.and_then(|entry| entry.value.first_chunk()).map(|bytes| self.long(*bytes));
        offset.map(|offset| self.entries(offset)).unwrap_or_default()
    }

    /// The value of an entry.
    pub(super) fn value(&self, entry: &Entry<'_>) -> Value {
        let bytes = entry.value;
        let (pairs, quads) = (bytes.as_chunks::<2>().0, bytes.as_chunks::<4>().0);
        let longs = || quads.iter().map(|b| self.long(*b));
        let ratios = || {
            bytes.as_chunks::<8>().0.iter().map(|b| {
                let [a, b, c, d, e, f, g, h] = *b;
                (self.long([a, b, c, d]), self.long([e, f, g, h]))
            })
        };
        let double = |b: &[u8; 8]| if self.little { f64::from_le_bytes(*b) } else { f64::from_be_bytes(*b) };
        match entry.kind {
            1 => Value::Byte(bytes.to_vec()),
            2 => {
                let text = bytes.iter().rposition(|&b| b != 0).map_or(0, |last| last + 1);
                Value::Ascii(vec![bytes[..text].to_vec()])
            }
            3 => Value::Short(pairs.iter().map(|b| self.short(*b)).collect()),
            4 => Value::Long(longs().collect()),
            5 => Value::Rational(ratios().map(|(num, denom)| Rational { num, denom }).collect()),
            6 => Value::SByte(bytes.iter().map(|b| b.cast_signed()).collect()),
            8 => Value::SShort(pairs.iter().map(|b| self.short(*b).cast_signed()).collect()),
            9 => Value::SLong(longs().map(u32::cast_signed).collect()),
            10 => {
                let signed =
                    |(num, denom): (u32, u32)| SRational { num: num.cast_signed(), denom: denom.cast_signed() };
                Value::SRational(ratios().map(signed).collect())
            }
            11 => Value::Float(longs().map(f32::from_bits).collect()),
            12 => Value::Double(bytes.as_chunks().0.iter().map(double).collect()),
            _ => Value::Undefined(bytes.to_vec(), 0),
        }
    }
}

/// The orientation of a block, 1 to 8; `None` without the tag.
pub(super) fn orientation(block: &[u8]) -> Option<u8> {
    let structure = Structure::of(block)?;
    let entries = structure.entries(structure.long_at(4)?);
    let found = entries.iter().find(|entry| entry.number == Tag::Orientation.number())?;
    // some phones and editors write another integer than the short that Exif wants, and viewers turn such pictures
    structure.value(found).get_uint(0).map(orientation::sane)
}

/// When the picture was taken: the tag `DateTimeOriginal`, `YYYY:MM:DD hh:mm:ss`. `None` without a valid one.
pub(super) fn taken(block: &[u8]) -> Option<CaptureTime> {
    let structure = Structure::of(block)?;
    let primary = structure.entries(structure.long_at(4)?);
    let exif = structure.child(&primary, Tag::ExifIFDPointer);
    let found = exif.iter().find(|entry| entry.number == Tag::DateTimeOriginal.number())?;
    let Value::Ascii(lines) = structure.value(found) else { return None };
    capture_time(std::str::from_utf8(lines.first()?).ok()?)
}

/// The time in a text `YYYY:MM:DD hh:mm:ss`; `None` for another text, and for one that is no time.
pub(super) fn capture_time(text: &str) -> Option<CaptureTime> {
    let numbers: Vec<u64> = text.trim().split([':', ' ']).map(|part| part.parse().ok()).collect::<Option<_>>()?;
    let [year, month, day, hour, minute, second] = numbers[..] else { return None };
    // a camera whose clock is not set writes zeros
    let valid = (1..=9999).contains(&year) && (1..=12).contains(&month) && (1..=31).contains(&day);
    let days = (year * 12 + month) * 31 + day;
    (valid && hour < 24 && minute < 60 && second <= 60)
        .then_some(CaptureTime(((days * 24 + hour) * 60 + minute) * 60 + second))
}

/// The fields of a block (or of a TIFF file) that remain valid in another file with the same pixels, each tag once, and
/// whether the block is little-endian.
pub(super) fn kept(block: &[u8]) -> Option<(Vec<Field>, bool)> {
    kept_of_page(block, 0)
}

/// The same for a page of a TIFF file, from 0 on.
fn kept_of_page(block: &[u8], page: usize) -> Option<(Vec<Field>, bool)> {
    let structure = Structure::of(block)?;
    let next = |at: u32| {
        let entries = usize::from(structure.short_at(at as usize)?);
        structure.long_at(at as usize + 2 + entries * 12)
    };
    let first = structure.long_at(4)?;
    let primary = structure.entries((0..page).try_fold(first, |at, _| next(at))?);
    let exif = structure.child(&primary, Tag::ExifIFDPointer);
    let gps = structure.child(&primary, Tag::GPSInfoIFDPointer);
    let interop = structure.child(&exif, Tag::InteropIFDPointer);

    let mut fields: Vec<Field> = Vec::new();
    let mut total = 0;
    let directories =
        [(Context::Tiff, primary), (Context::Exif, exif), (Context::Gps, gps), (Context::Interop, interop)];
    for (context, entries) in directories {
        for entry in entries.iter().filter(|entry| holds_elsewhere(context, entry.number)) {
            let tag = Tag(context, entry.number);
            let length = entry.value.len();
            let wanted = length > 0 && length <= MAX_VALUE_BYTES && total + length <= MAX_TOTAL_BYTES;
            if wanted && fields.len() < MAX_FIELDS && !fields.iter().any(|other| other.tag == tag) {
                total += length;
                fields.push(Field { tag, ifd_num: In::PRIMARY, value: structure.value(entry) });
            }
        }
    }
    Some((fields, structure.little))
}

fn holds_elsewhere(context: Context, number: u16) -> bool {
    let pointers = [Tag::ExifIFDPointer, Tag::GPSInfoIFDPointer, Tag::InteropIFDPointer];
    match context {
        Context::Tiff => DESCRIPTIVE.contains(&number) || number == Tag::Orientation.number(),
        _ => !LEFT_OUT.contains(&number) && pointers.iter().all(|pointer| pointer.number() != number),
    }
}

/// A block of these fields; `None` for no fields.
pub(super) fn written(fields: &[Field], little_endian: bool) -> Option<Vec<u8>> {
    if fields.is_empty() {
        return None;
    }
    let mut writer = Writer::new();
    for field in fields {
        writer.push_field(field);
    }
    let mut out = Cursor::new(Vec::new());
    writer.write(&mut out, little_endian).ok()?;
    Some(out.into_inner())
}

/// A new block from the tags of a page of a TIFF file.
pub(super) fn from_tiff(file: &[u8], page: usize) -> Option<Vec<u8>> {
    let (fields, little_endian) = kept_of_page(file, page)?;
    written(&fields, little_endian)
}

/// The block without its longest values, so that it has at most `most` bytes; `None` when nothing remains.
pub(super) fn within(block: &[u8], most: usize) -> Option<Vec<u8>> {
    if block.len() <= most {
        return Some(block.to_vec());
    }
    let (fields, little_endian) = kept(block)?;
    [4096, 256, 32].iter().find_map(|&longest| {
        let short: Vec<Field> = fields.iter().filter(|field| length(&field.value) <= longest).cloned().collect();
        written(&short, little_endian).filter(|block| block.len() <= most)
    })
}

/// Size of a value, bytes.
fn length(value: &Value) -> usize {
    match value {
        Value::Ascii(lines) => lines.iter().map(|line| line.len() + 1).sum(),
        Value::Byte(v) | Value::Undefined(v, _) => v.len(),
        Value::SByte(v) => v.len(),
        Value::Short(v) => 2 * v.len(),
        Value::SShort(v) => 2 * v.len(),
        Value::Long(v) => 4 * v.len(),
        Value::SLong(v) => 4 * v.len(),
        Value::Float(v) => 4 * v.len(),
        Value::Double(v) => 8 * v.len(),
        Value::Rational(v) => 8 * v.len(),
        Value::SRational(v) => 8 * v.len(),
        Value::Unknown(_, count, _) => *count as usize,
    }
}

/// The text of an ASCII tag of the main directory.
pub(super) fn text(block: &[u8], tag: Tag) -> Option<String> {
    let structure = Structure::of(block)?;
    let entries = structure.entries(structure.long_at(4)?);
    let found = entries.iter().find(|entry| entry.number == tag.number())?;
    match structure.value(found) {
        Value::Ascii(lines) => lines.first().map(|line| String::from_utf8_lossy(line).trim().to_owned()),
        _ => None,
    }
}

/// The fields of a block by directory, for the TIFF writer.
#[derive(Default)]
pub(super) struct Directories {
    /// Main directory, without the tags that the TIFF writer sets.
    pub primary: Vec<Field>,
    /// Exif directory.
    pub exif: Vec<Field>,
    /// GPS directory.
    pub gps: Vec<Field>,
}

/// Sorts the fields of `block` into directories.
pub(super) fn directories(block: &[u8]) -> Directories {
    let mut out = Directories::default();
    for field in kept(block).map(|(fields, _)| fields).unwrap_or_default() {
        match field.tag.context() {
            Context::Tiff => out.primary.push(field),
            Context::Exif => out.exif.push(field),
            Context::Gps => out.gps.push(field),
            _ => {}
        }
    }
    out
}
