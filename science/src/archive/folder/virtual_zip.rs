//! The zip: headers in memory, members in files. Every member is stored, with zip64 fields whatever its size.

use std::{
    collections::VecDeque,
    fs::File,
    io,
    os::unix::fs::FileExt,
    sync::{Arc, Mutex, PoisonError},
};

use super::file::{FolderFile, unreadable};
use crate::types::ReadAt;

/// Files that are kept open. A scan has a zip per view.
const MOST_OPEN: usize = 8;
/// Version 4.5 of the format, which has zip64.
const VERSION: u16 = 45;
/// Names are UTF-8.
const FLAGS: u16 = 1 << 11;
/// 1980-01-01, the first date of the format: times are not kept.
const DATE: u16 = 0x21;

/// A member of the zip.
#[derive(Debug)]
pub(super) struct Member {
    pub name: String,
    pub crc32: u32,
    pub source: Source,
}

/// Where the bytes of a member are.
#[derive(Debug)]
pub(super) enum Source {
    Bytes(Vec<u8>),
    File(FolderFile),
}

impl Source {
    fn length(&self) -> u64 {
        match self {
            Self::Bytes(bytes) => bytes.len() as u64,
            Self::File(file) => file.stamp.bytes,
        }
    }
}

/// A folder as a zip of stored members. Reads of several threads do not wait for each other.
#[derive(Debug)]
pub struct FolderZip {
    /// Headers and members alternate; the directory is last. Each with its offset.
    parts: Vec<(u64, Source)>,
    length: u64,
    /// The files that were read last, by the number of their part.
    open: Mutex<VecDeque<(usize, Arc<File>)>>,
}

impl FolderZip {
    pub(super) fn new(members: Vec<Member>) -> Self {
        let (mut parts, mut directory, mut at) = (Vec::with_capacity(2 * members.len() + 1), Vec::new(), 0);
        let count = members.len() as u64;
        for Member { name, crc32, source } in members {
            let bytes = source.length();
            directory.extend(directory_entry(&name, crc32, bytes, at));
            for part in [Source::Bytes(local_header(&name, crc32, bytes)), source] {
                let length = part.length();
                parts.push((at, part));
                at += length;
            }
        }
        directory.extend(end(count, directory.len() as u64, at));
        let length = at + directory.len() as u64;
        parts.push((at, Source::Bytes(directory)));
        Self { parts, length, open: Mutex::default() }
    }

    /// The file of part `index`, kept open if it was read lately.
    fn opened(&self, index: usize, file: &FolderFile) -> io::Result<Arc<File>> {
        let lock = || self.open.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, open)) = lock().iter().find(|(of, _)| *of == index) {
            return Ok(Arc::clone(open));
        }
        let opened = Arc::new(file.open().map_err(io::Error::other)?);
        let mut open = lock();
        open.truncate(MOST_OPEN - 1);
        open.push_front((index, Arc::clone(&opened)));
        Ok(opened)
    }
}

impl ReadAt for FolderZip {
    fn length(&self) -> io::Result<u64> {
        Ok(self.length)
    }

    fn read_at(&self, buffer: &mut [u8], at: u64) -> io::Result<usize> {
        // of parts at the same offset the last is not empty
        let index = self.parts.partition_point(|(start, _)| *start <= at).saturating_sub(1);
        let Some((start, part)) = self.parts.get(index).filter(|_| at < self.length) else { return Ok(0) };
        let within = at - start;
        match part {
            Source::Bytes(bytes) => bytes.read_at(buffer, within),
            Source::File(file) => {
                let left = usize::try_from(file.stamp.bytes - within).unwrap_or(usize::MAX);
                let most = left.min(buffer.len());
                let open = self.opened(index, file)?;
                let read = FileExt::read_at(&*open, &mut buffer[..most], within);
                let read = read.map_err(|error| match error.kind() {
                    io::ErrorKind::Interrupted => error,
                    _ => io::Error::other(unreadable(&file.path, &error)),
                })?;
                file.require_unchanged(&open).map_err(io::Error::other)?;
                if read == 0 && most > 0 { Err(io::Error::other(file.changed())) } else { Ok(read) }
            }
        }
    }
}

/// What both headers of a member have in common, from the version on.
fn common(name: &str, crc32: u32, extra: u16) -> Vec<u8> {
    let mut out = Vec::with_capacity(128 + name.len());
    for short in [VERSION, FLAGS, 0, 0, DATE] {
        out.extend(short.to_le_bytes());
    }
    for long in [crc32, u32::MAX, u32::MAX] {
        out.extend(long.to_le_bytes());
    }
    // paths of the system are shorter
    out.extend(u16::try_from(name.len()).unwrap_or(u16::MAX).to_le_bytes());
    out.extend(extra.to_le_bytes());
    out
}

/// The extra field with the true values of those that are `0xFFFFFFFF` in the header.
fn zip64(values: &[u64]) -> Vec<u8> {
    let mut out = [1, 8 * values.len() as u16].map(u16::to_le_bytes).concat();
    out.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    out
}

fn local_header(name: &str, crc32: u32, bytes: u64) -> Vec<u8> {
    let extra = zip64(&[bytes, bytes]);
    [b"PK\x03\x04", common(name, crc32, extra.len() as u16).as_slice(), name.as_bytes(), &extra].concat()
}

fn directory_entry(name: &str, crc32: u32, bytes: u64, at: u64) -> Vec<u8> {
    let extra = zip64(&[bytes, bytes, at]);
    let version = VERSION.to_le_bytes();
    // no comment, the first file, no attributes; the offset is in the extra field
    let rest = [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xFF, 0xFF, 0xFF, 0xFF];
    let fields = common(name, crc32, extra.len() as u16);
    [b"PK\x01\x02", version.as_slice(), &fields, &rest, name.as_bytes(), &extra].concat()
}

/// The end records: that of zip64, its locator, and the one that refers to them.
fn end(count: u64, directory_bytes: u64, directory_at: u64) -> Vec<u8> {
    let mut out = b"PK\x06\x06".to_vec();
    out.extend(44_u64.to_le_bytes());
    out.extend([VERSION, VERSION, 0, 0, 0, 0].map(u16::to_le_bytes).concat());
    out.extend([count, count, directory_bytes, directory_at].map(u64::to_le_bytes).concat());
    out.extend(b"PK\x06\x07\0\0\0\0");
    out.extend((directory_at + directory_bytes).to_le_bytes());
    out.extend(1_u32.to_le_bytes());
    out.extend(b"PK\x05\x06\0\0\0\0");
    out.extend([0xFF; 12]);
    out.extend([0, 0]);
    out
}
