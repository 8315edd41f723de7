//! A zip of stored files whose layout is known before any of them is read, so that it has a length and can be resumed
//! with `Range`.
//!
//! Members are not compressed (images do not shrink), so offsets follow from sizes. Their CRC-32 must be known. The
//! `zip` crate writes a zip from its beginning to its end only; so the headers (APPNOTE.TXT 6.3.10, zip64 where a
//! number needs it) are written here, and tests read the result with that crate and with other programs.

use std::{io, sync::Arc};

use bytes::Bytes;
use futures::{Stream, StreamExt, TryStreamExt, stream};
use jiff::{Timestamp, tz::TimeZone};
use sha2::{Digest, Sha256};

use crate::store::{BlobStore, digest::hex};

/// Largest number that fits into a 32-bit field of a zip that has no zip64 record.
const MAX_32: u64 = u32::MAX as u64 - 1;
/// The same for 16 bits.
const MAX_16: u64 = u16::MAX as u64 - 1;
/// Names are UTF-8.
const UTF8_NAMES: u16 = 1 << 11;
/// Version 4.5: zip64.
const VERSION: u16 = 45;
/// Made by version 4.5 on Unix, for the file mode.
const MADE_BY: u16 = (3 << 8) | VERSION;
/// A regular file that everyone may read.
const MODE: u32 = 0o100_644 << 16;

/// A member of the zip.
#[derive(Debug, Clone)]
pub struct ZipEntry {
    /// Name with `/` between folders.
    pub path: String,
    /// Its bytes.
    pub content: EntryContent,
}

/// The bytes of a member.
#[derive(Debug, Clone)]
pub enum EntryContent {
    /// In memory.
    Text(Bytes),
    /// In the blob store.
    Blob {
        /// Key.
        key: String,
        /// Size, bytes.
        bytes: u64,
        /// CRC-32.
        crc32: u32,
        /// SHA-256, hex.
        sha256: String,
    },
}

/// The layout of a zip.
#[derive(Debug)]
pub struct StoredZip {
    segments: Vec<Segment>,
    length: u64,
    tag: String,
}

#[derive(Debug, Clone)]
struct Segment {
    /// Offset in the zip.
    offset: u64,
    bytes: u64,
    source: SegmentSource,
}

#[derive(Debug, Clone)]
enum SegmentSource {
    Memory(Bytes),
    Blob(String),
}

impl StoredZip {
    /// The zip of `entries`, whose members have the time `modified` (UTC).
    pub fn new(entries: Vec<ZipEntry>, modified: Timestamp) -> Self {
        let time = dos_time(modified);
        let mut zip = Self { segments: Vec::with_capacity(2 * entries.len() + 1), length: 0, tag: String::new() };
        let mut directory = Vec::new();
        let mut hash = Sha256::new();
        let count = entries.len() as u64;
        for ZipEntry { path, content } in entries {
            let (size, crc32, digest) = match &content {
                EntryContent::Text(text) => {
                    (text.len() as u64, crc32fast::hash(text), Sha256::digest(text).as_slice().to_vec())
                }
                EntryContent::Blob { bytes, crc32, sha256, .. } => (*bytes, *crc32, sha256.as_bytes().to_vec()),
            };
            hash.update((path.len() as u64).to_le_bytes());
            hash.update(&path);
            hash.update(size.to_le_bytes());
            hash.update(digest);
            let member = Member { path: &path, size, crc32, offset: zip.length, time };
            directory.extend(member.directory_entry());
            zip.push(member.header().into());
            match content {
                EntryContent::Text(text) => zip.push(text),
                EntryContent::Blob { key, bytes, .. } => zip.add(bytes, SegmentSource::Blob(key)),
            }
        }
        hash.update(time.to_le_bytes());
        zip.tag = hex(&hash.finalize());
        let end = end_of_directory(count, zip.length, directory.len() as u64);
        zip.push(directory.into());
        zip.push(end.into());
        zip
    }

    fn push(&mut self, bytes: Bytes) {
        self.add(bytes.len() as u64, SegmentSource::Memory(bytes));
    }

    fn add(&mut self, bytes: u64, source: SegmentSource) {
        if bytes > 0 {
            self.segments.push(Segment { offset: self.length, bytes, source });
            self.length += bytes;
        }
    }

    /// Length, bytes.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// A digest of names and contents, for the `ETag`.
    pub fn tag(&self) -> &str {
        &self.tag
    }

    /// Keys and sizes of the blobs it is made of.
    pub fn blobs(&self) -> impl Iterator<Item = (&str, u64)> {
        self.segments.iter().filter_map(|segment| match &segment.source {
            SegmentSource::Blob(key) => Some((key.as_str(), segment.bytes)),
            SegmentSource::Memory(_) => None,
        })
    }

    /// The bytes from `first` on, `length` of them. Blobs are opened one after the other; one that is gone ends the
    /// stream with an error.
    pub fn stream(
        &self,
        blobs: Arc<dyn BlobStore>,
        first: u64,
        length: u64,
    ) -> impl Stream<Item = io::Result<Bytes>> + Send + 'static {
        let end = first.saturating_add(length).min(self.length);
        let wanted: Vec<(Segment, u64, u64)> = self
            .segments
            .iter()
            .filter_map(|segment| {
                let from = first.max(segment.offset);
                let to = end.min(segment.offset + segment.bytes);
                (from < to).then(|| (segment.clone(), from - segment.offset, to - segment.offset))
            })
            .collect();
        stream::iter(wanted)
            .then(move |(segment, from, to)| {
                let blobs = Arc::clone(&blobs);
                async move { part(&*blobs, segment.source, from, to).await }
            })
            .try_flatten()
    }
}

async fn part(
    blobs: &dyn BlobStore,
    source: SegmentSource,
    from: u64,
    to: u64,
) -> io::Result<stream::BoxStream<'static, io::Result<Bytes>>> {
    match source {
        SegmentSource::Memory(bytes) => {
            let part = bytes.slice(usize_of(from)..usize_of(to));
            Ok(stream::once(async { Ok(part) }).boxed())
        }
        SegmentSource::Blob(key) => {
            let gone = || io::Error::new(io::ErrorKind::NotFound, format!("the blob {key} was deleted"));
            blobs.read(&key, from..to).await.map_err(io::Error::other)?.ok_or_else(gone)
        }
    }
}

/// An offset within a segment in memory, which is smaller than the memory.
fn usize_of(offset: u64) -> usize {
    usize::try_from(offset).unwrap_or(usize::MAX)
}

/// What the headers of a member need.
struct Member<'a> {
    path: &'a str,
    size: u64,
    crc32: u32,
    offset: u64,
    time: u32,
}

impl Member<'_> {
    /// The local file header.
    fn header(&self) -> Vec<u8> {
        let mut extra = Vec::new();
        if self.size > MAX_32 {
            // uncompressed and compressed size
            extra.extend(zip64_extra(&[self.size, self.size]));
        }
        let mut out = Vec::with_capacity(30 + self.path.len() + extra.len());
        out.extend(0x0403_4b50u32.to_le_bytes());
        out.extend(self.common());
        out.extend(length_16(extra.len()).to_le_bytes());
        out.extend(self.path.as_bytes());
        out.extend(extra);
        out
    }

    /// The entry of the central directory.
    fn directory_entry(&self) -> Vec<u8> {
        let mut large = Vec::new();
        if self.size > MAX_32 {
            large.extend([self.size, self.size]);
        }
        if self.offset > MAX_32 {
            large.push(self.offset);
        }
        let extra = if large.is_empty() { Vec::new() } else { zip64_extra(&large) };
        let mut out = Vec::with_capacity(46 + self.path.len() + extra.len());
        out.extend(0x0201_4b50u32.to_le_bytes());
        out.extend(MADE_BY.to_le_bytes());
        out.extend(self.common());
        out.extend(length_16(extra.len()).to_le_bytes());
        // no comment, disk 0, no internal attributes
        out.extend([0; 6]);
        out.extend(MODE.to_le_bytes());
        out.extend(capped_32(self.offset).to_le_bytes());
        out.extend(self.path.as_bytes());
        out.extend(extra);
        out
    }

    /// What both headers have: from the version needed to the length of the name.
    fn common(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(24);
        out.extend(VERSION.to_le_bytes());
        out.extend(UTF8_NAMES.to_le_bytes());
        // stored
        out.extend(0u16.to_le_bytes());
        out.extend(self.time.to_le_bytes());
        out.extend(self.crc32.to_le_bytes());
        out.extend(capped_32(self.size).to_le_bytes());
        out.extend(capped_32(self.size).to_le_bytes());
        out.extend(length_16(self.path.len()).to_le_bytes());
        out
    }
}

/// The end of the central directory, with the zip64 records where a number needs them.
fn end_of_directory(count: u64, offset: u64, bytes: u64) -> Vec<u8> {
    let mut out = Vec::new();
    if count > MAX_16 || offset > MAX_32 || bytes > MAX_32 {
        out.extend(0x0606_4b50u32.to_le_bytes());
        // size of the rest of this record
        out.extend(44u64.to_le_bytes());
        out.extend(MADE_BY.to_le_bytes());
        out.extend(VERSION.to_le_bytes());
        out.extend([0; 8]);
        for number in [count, count, bytes, offset] {
            out.extend(number.to_le_bytes());
        }
        out.extend(0x0706_4b50u32.to_le_bytes());
        out.extend([0; 4]);
        out.extend((offset + bytes).to_le_bytes());
        out.extend(1u32.to_le_bytes());
    }
    let count = if count > MAX_16 { u16::MAX } else { count as u16 };
    out.extend(0x0605_4b50u32.to_le_bytes());
    out.extend([0; 4]);
    out.extend(count.to_le_bytes());
    out.extend(count.to_le_bytes());
    out.extend(capped_32(bytes).to_le_bytes());
    out.extend(capped_32(offset).to_le_bytes());
    // no comment
    out.extend([0; 2]);
    out
}

fn zip64_extra(numbers: &[u64]) -> Vec<u8> {
    let mut out = Vec::with_capacity(4 + 8 * numbers.len());
    out.extend(1u16.to_le_bytes());
    out.extend(length_16(8 * numbers.len()).to_le_bytes());
    numbers.iter().for_each(|number| out.extend(number.to_le_bytes()));
    out
}

/// A number of a 32-bit field; all ones when it is in the zip64 record.
fn capped_32(number: u64) -> u32 {
    if number > MAX_32 { u32::MAX } else { number as u32 }
}

/// A length of a 16-bit field. Names are made by the service and far shorter.
fn length_16(length: usize) -> u16 {
    u16::try_from(length).unwrap_or(u16::MAX)
}

/// Date and time as MS-DOS wrote them: from 1980 to 2107, in steps of 2 seconds.
fn dos_time(time: Timestamp) -> u32 {
    let time = time.to_zoned(TimeZone::UTC).datetime();
    let year = u32::try_from(i32::from(time.year()).clamp(1980, 2107) - 1980).unwrap_or(0);
    let field = |number: i8| u32::try_from(number).unwrap_or(0);
    let date = (year << 9) | (field(time.month()) << 5) | field(time.day());
    let clock = (field(time.hour()) << 11) | (field(time.minute()) << 5) | (field(time.second()) / 2);
    (date << 16) | clock
}

#[cfg(test)]
mod tests;
