//! Checks the lengths of the lists in the first directory of a TIFF before the decoder allocates memory for them. It
//! takes 32 bytes for a value that may have one byte in the file, and the file may be compressed a thousandfold in its
//! zip.

use std::io::{Read, Seek, SeekFrom};

use super::{Format, ImageFault};

/// Maximum number of entries of a directory; about twenty are usual.
const MAX_ENTRIES: u64 = 4_096;

/// Maximum number of values of a list. 65,535 rows of three planes, one strip each, need 196,605.
const MAX_VALUES: u64 = 1 << 20;

/// Lists that the decoder always reads: bits per sample, strips, extra samples, sample formats, tiles, JPEG tables,
/// subsampling.
const LISTS: [u16; 9] = [258, 273, 279, 324, 325, 338, 339, 347, 530];

/// Refuses a file whose first directory has too many entries or a list of too many values. The reader is at the start
/// afterwards. Unreadable parts are left to the decoder, which reports them.
pub(super) fn refuse_long(reader: &mut (impl Read + Seek)) -> Result<(), ImageFault> {
    let long = longest(reader);
    reader.seek(SeekFrom::Start(0)).map_err(|error| ImageFault::from_io(Format::Tiff, &error))?;
    match long {
        Some(why) => Err(ImageFault::damaged(Format::Tiff, why)),
        None => Ok(()),
    }
}

/// A clause about what is too long, if anything.
fn longest(reader: &mut (impl Read + Seek)) -> Option<&'static str> {
    let mut start = [0; 8];
    reader.seek(SeekFrom::Start(0)).ok()?;
    reader.read_exact(&mut start).ok()?;
    let little = start[0] == b'I';
    let is_big = start[2..4].contains(&43);
    let number = |bytes: &[u8]| -> u64 {
        let add = |sum: u64, &byte: &u8| sum << 8 | u64::from(byte);
        if little { bytes.iter().rev().fold(0, add) } else { bytes.iter().fold(0, add) }
    };
    let directory = if is_big { number(&next(reader, 8)?) } else { number(&start[4..]) };
    reader.seek(SeekFrom::Start(directory)).ok()?;
    let (count_bytes, entry_bytes, value_count) = if is_big { (8, 20, 4..12) } else { (2, 12, 4..8) };
    let entries = number(&next(reader, count_bytes)?);
    if entries > MAX_ENTRIES {
        return Some("a directory of too many entries");
    }
    for _ in 0..entries {
        let entry = next(reader, entry_bytes)?;
        let (tag, values) = (number(&entry[..2]) as u16, number(&entry[value_count.clone()]));
        if LISTS.contains(&tag) && values > MAX_VALUES {
            return Some("a list of too many values");
        }
    }
    None
}

fn next(reader: &mut impl Read, length: usize) -> Option<Vec<u8>> {
    let mut bytes = vec![0; length];
    reader.read_exact(&mut bytes).ok()?;
    Some(bytes)
}
