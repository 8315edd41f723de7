//! The number of members that a zip declares, read before its directory is in memory.

use std::io;

use crate::{archive::ArchiveLimits, types::ReadAt};

/// Signatures of the end record, of the zip64 locator before it, and of the zip64 end record.
const END: &[u8] = b"PK\x05\x06";
pub(super) const ZIP64_LOCATOR: &[u8] = b"PK\x06\x07";
pub(super) const ZIP64_END: &[u8] = b"PK\x06\x06";
/// Signature of the header of a member in the directory.
pub(super) const MEMBER: &[u8] = b"PK\x01\x02";

/// Lengths without comment and extensible data, bytes.
const END_BYTES: u64 = 22;
pub(super) const ZIP64_LOCATOR_BYTES: u64 = 20;
const ZIP64_END_BYTES: u64 = 56;

/// Bytes that are read at most to parse a directory, as a constant and per member. The library reads the header of a
/// member in the directory, some of them twice, and its local header. Names have at most 1,024 bytes.
const DIRECTORY_BYTES: u64 = 1 << 20;
const MEMBER_BYTES: u64 = 2 << 10;

/// Most end records that are looked at: each may cost reads elsewhere in the file, which may be in a bucket. A zip has
/// one, and more only by chance.
const MOST_RECORDS: usize = 32;

/// Bytes that may be read to parse a directory. They bound the members in memory where [`declared`] does not find the
/// record that the library uses.
pub(super) fn directory_budget(limits: &ArchiveLimits) -> u64 {
    let most = DIRECTORY_BYTES.saturating_add(MEMBER_BYTES.saturating_mul(limits.max_members as u64));
    limits.max_directory_bytes.min(most)
}

/// The largest number of members in an end record that the zip library may use; 0 without a record. `tail` holds the
/// last bytes of the file of `length` bytes.
///
/// The signature of a record may occur in a comment or in a stored member. The library uses the last record that it can
/// follow. It does not look before a record whose directory ends where the record begins, and neither does this
/// function.
pub(super) fn declared(file: &dyn ReadAt, tail: &[u8], length: u64) -> io::Result<u64> {
    let mut most = 0;
    let mut before = tail;
    let mut records = 0;
    while records < MOST_RECORDS
        && let Some(at) = before.windows(END.len()).rposition(|window| window == END)
    {
        let (rest, record) = tail.split_at(at);
        (before, records) = (rest, records + 1);
        let position = length - record.len() as u64;
        let Some(end) = EndRecord::of(record).filter(|end| position + END_BYTES + end.comment <= length) else {
            continue;
        };
        if end.may_be_zip64()
            && let Some(members) = zip64_members(file, position)?
        {
            most = most.max(members);
        } else if end.is_of_one_file() {
            most = most.max(end.members);
            if end.follows_its_directory(file, position)? {
                break;
            }
        }
    }
    Ok(most)
}

/// The fields of an end record.
pub(super) struct EndRecord {
    /// Both numbers of files of a split zip; 0 for a zip in one file.
    files: u64,
    /// Members in this file, and in all files.
    pub members: u64,
    all_members: u64,
    /// Length and offset of the directory, bytes.
    pub directory_bytes: u64,
    pub directory_at: u64,
    /// Length of the comment, bytes.
    comment: u64,
}

impl EndRecord {
    /// The last end record of a file, and its position. `tail` holds the last bytes of the file of `length` bytes.
    pub(super) fn last(tail: &[u8], length: u64) -> Option<(Self, u64)> {
        let record = &tail[tail.windows(END.len()).rposition(|window| window == END)?..];
        Some((Self::of(record)?, length - record.len() as u64))
    }

    fn of(record: &[u8]) -> Option<Self> {
        Some(Self {
            files: number(record, 4, 4)?,
            members: number(record, 8, 2)?,
            all_members: number(record, 10, 2)?,
            directory_bytes: number(record, 12, 4)?,
            directory_at: number(record, 16, 4)?,
            comment: number(record, 20, 2)?,
        })
    }

    fn may_be_zip64(&self) -> bool {
        let (directory_bytes, directory_at) = (self.directory_bytes, self.directory_at);
        self.all_members == u64::from(u16::MAX) || directory_bytes.max(directory_at) == u64::from(u32::MAX)
    }

    pub(super) fn is_of_one_file(&self) -> bool {
        self.files == 0 && self.members == self.all_members
    }

    /// True when the directory ends at `position`, where the record begins.
    fn follows_its_directory(&self, file: &dyn ReadAt, position: u64) -> io::Result<bool> {
        let start = position.checked_sub(self.directory_bytes).filter(|&start| start >= self.directory_at);
        let Some(start) = start.filter(|start| start + MEMBER.len() as u64 <= position) else { return Ok(false) };
        Ok(bytes_at::<4>(file, start)? == MEMBER)
    }
}

/// The number of members in the zip64 end record of the end record at `position`; `None` when there is none. The record
/// is where the locator says or, when bytes were put before the zip, directly before the locator.
fn zip64_members(file: &dyn ReadAt, position: u64) -> io::Result<Option<u64>> {
    let Some(locator_at) = position.checked_sub(ZIP64_LOCATOR_BYTES) else { return Ok(None) };
    let locator = bytes_at::<{ ZIP64_LOCATOR_BYTES as usize }>(file, locator_at)?;
    if !locator.starts_with(ZIP64_LOCATOR) {
        return Ok(None);
    }
    let mut most: Option<u64> = None;
    for at in [number(&locator, 8, 8), locator_at.checked_sub(ZIP64_END_BYTES)].into_iter().flatten() {
        if at.checked_add(ZIP64_END_BYTES).is_some_and(|end| end <= locator_at) {
            let record = bytes_at::<{ ZIP64_END_BYTES as usize }>(file, at)?;
            most = most.max(number(&record, 32, 8).filter(|_| record.starts_with(ZIP64_END)));
        }
    }
    Ok(most)
}

fn bytes_at<const N: usize>(file: &dyn ReadAt, at: u64) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    file.read_exact_at(&mut bytes, at)?;
    Ok(bytes)
}

/// The little-endian number in `length` bytes from `at` on.
pub(super) fn number(bytes: &[u8], at: usize, length: usize) -> Option<u64> {
    let field = bytes.get(at..at + length)?;
    Some(field.iter().rev().fold(0, |value, &byte| value << 8 | u64::from(byte)))
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    /// A directory of one member, and an end record of `members` members with a comment.
    fn ended(members: u16, comment: &[u8]) -> Vec<u8> {
        let mut out = [MEMBER, &[0; 42]].concat();
        out.extend(end(members, out.len() as u32, 0, comment));
        out
    }

    fn end(members: u16, directory_bytes: u32, directory_at: u32, comment: &[u8]) -> Vec<u8> {
        let mut out = [END, &[0; 4]].concat();
        out.extend([members, members].map(u16::to_le_bytes).concat());
        out.extend([directory_bytes, directory_at].map(u32::to_le_bytes).concat());
        out.extend((comment.len() as u16).to_le_bytes());
        out.extend(comment);
        out
    }

    /// A zip64 end with its locator, `lead` bytes after the start.
    fn zip64(members: u64, lead: usize) -> Vec<u8> {
        let mut out = vec![7; lead];
        out.extend([ZIP64_END, &44u64.to_le_bytes(), &[0; 12]].concat());
        out.extend([members, members, 46, 0].map(u64::to_le_bytes).concat());
        out.extend([ZIP64_LOCATOR, &[0; 4], &0u64.to_le_bytes(), &[1, 0, 0, 0]].concat());
        out.extend(end(u16::MAX, u32::MAX, u32::MAX, b""));
        out
    }

    fn of(bytes: Vec<u8>) -> u64 {
        let (tail, length) = (bytes.clone(), bytes.len() as u64);
        declared(&bytes, &tail, length).unwrap()
    }

    #[test]
    fn the_number_is_read_from_the_record_with_or_without_zip64() {
        assert_eq!(of(ended(30_000, b"")), 30_000);
        assert_eq!(of(ended(2, b"a comment")), 2);
        assert_eq!(of(zip64(1_300_000, 0)), 1_300_000);
        assert_eq!(of(zip64(1_300_000, 90)), 1_300_000, "bytes before the zip");
        assert_eq!(of(ended(u16::MAX, b"")), 65_535, "no zip64 record");
        assert_eq!(of(b"no record at all".to_vec()), 0);
        assert_eq!(of(END.to_vec()), 0);
    }

    #[test]
    fn a_record_that_cannot_be_followed_hides_none_before_it() {
        let stray = end(2, 46, 900_000, b"");
        assert_eq!(of(ended(30_000, &stray)), 30_000);
        let lie = end(2, 10, 0, b"");
        assert_eq!(of([zip64(1_300_000, 0), lie].concat()), 1_300_000);
    }

    #[test]
    fn many_records_cost_few_reads() {
        struct Counting(Vec<u8>, AtomicUsize);
        impl ReadAt for Counting {
            fn length(&self) -> io::Result<u64> {
                self.0.length()
            }

            fn read_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<usize> {
                self.1.fetch_add(1, Ordering::Relaxed);
                self.0.read_at(buffer, offset)
            }
        }
        let bytes = ended(2, &[9; 100]).into_iter().chain(zip64(3, 0).repeat(500)).collect::<Vec<u8>>();
        let file = Counting(bytes.clone(), AtomicUsize::new(0));
        assert_eq!(declared(&file, &bytes, bytes.len() as u64).unwrap(), 3);
        let reads = file.1.into_inner();
        assert!(reads <= 3 * MOST_RECORDS, "{reads} reads");
    }

    #[test]
    fn a_stored_zip_before_the_directory_does_not_count() {
        assert_eq!(of([ended(30_000, b""), ended(2, b"")].concat()), 2);
    }
}
