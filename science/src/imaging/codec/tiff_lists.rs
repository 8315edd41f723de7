//! Lists in the first directory of a TIFF, looked at before the decoder makes room for them: it takes 32 bytes for a value
//! that may have one byte in the file, and a file may compress a thousandfold in its zip.

use std::io::{Read, Seek, SeekFrom};

use super::{Format, ImageFault};

/// Most entries of a directory; usual are twenty.
const MAX_ENTRIES: u64 = 4_096;

/// Most values of a list. 65,535 rows of three colours in strips of their own make 196,605.
const MAX_VALUES: u64 = 1 << 20;

/// Lists that the decoder reads whatever is asked of it: bits per sample, strips, extra samples, sample formats, tiles,
/// tables of JPEG, subsampling.
const LISTS: [u16; 9] = [258, 273, 279, 324, 325, 338, 339, 347, 530];

/// Refuses a file whose first directory has more entries than any sound one, or a list of more values. Leaves the reader at
/// the start. What cannot be read is left to the decoder, which says what is wrong.
pub(super) fn refuse_long(reader: &mut (impl Read + Seek)) -> Result<(), ImageFault> {
    let long = longest(reader);
    reader.seek(SeekFrom::Start(0)).map_err(|error| ImageFault::from_io(Format::Tiff, &error))?;
    match long {
        Some(why) => Err(ImageFault::damaged(Format::Tiff, why)),
        None => Ok(()),
    }
}

/// What is too long.
fn longest(reader: &mut (impl Read + Seek)) -> Option<String> {
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
        return Some(format!("a directory of {entries} entries"));
    }
    for _ in 0..entries {
        let entry = next(reader, entry_bytes)?;
        let (tag, values) = (number(&entry[..2]) as u16, number(&entry[value_count.clone()]));
        if LISTS.contains(&tag) && values > MAX_VALUES {
            return Some(format!("a list of {values} values in tag {tag}"));
        }
    }
    None
}

fn next(reader: &mut impl Read, length: usize) -> Option<Vec<u8>> {
    let mut bytes = vec![0; length];
    reader.read_exact(&mut bytes).ok()?;
    Some(bytes)
}
