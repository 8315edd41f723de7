//! Reads and writes zip containers. No module but this and its children uses the `zip` crate.
//!
//! Untrusted input: sizes are checked before memory is allocated, the directory is parsed within a byte budget, and
//! entries that overlap or have equal names are refused. An I/O error of the disk is never reported as a damaged zip.

mod copying;
mod decoding;
mod disk_failure;
mod member_count;
mod without_zip64;

use std::{
    fs::File,
    io::{self, BufReader, Read, Seek, SeekFrom, Write},
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

use zip::{CompressionMethod, ZipArchive, ZipWriter, result::ZipError, write::SimpleFileOptions};

use super::{
    limits::ArchiveLimits,
    member_names,
    members::Member,
    messages::invalid,
    not_a_zip, png_trailer,
    seek_window::{SeekWindow, position},
};
use crate::{
    imaging::codec::{self, Header, ImageFault},
    types::{Error, ErrorKind, ReadAt},
};
use disk_failure::{DiskFailure, unreadable};

/// Upper bound of the first allocation for a member, in multiples of its compressed size: the maximum expansion ratio
/// of deflate. The declared size may be wrong.
const FIRST_ALLOCATION_RATIO: u64 = 1_100;

/// A reader with its own position over shared bytes. All clones share one budget of bytes; `u64::MAX` is unlimited.
#[derive(Clone)]
struct SharedReader {
    source: Arc<dyn ReadAt>,
    length: u64,
    at: u64,
    budget: Arc<AtomicU64>,
    failure: DiskFailure,
}

/// Message of a read beyond the budget. Identifies that error inside a `ZipError`.
const BUDGET_SPENT: &str = "directory budget spent";

impl Read for SharedReader {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        // a zip may refer to offsets that no file has, which the system would report as an error of the disk
        if self.at >= self.length {
            return Ok(0);
        }
        let read = self.source.read_at(buffer, self.at).inspect_err(|error| self.failure.note(error))?;
        let spend = |left: u64| if left == u64::MAX { Some(left) } else { left.checked_sub(read as u64) };
        if self.budget.fetch_update(Ordering::Relaxed, Ordering::Relaxed, spend).is_err() {
            return Err(io::Error::other(BUDGET_SPENT));
        }
        self.at += read as u64;
        Ok(read)
    }
}

impl Seek for SharedReader {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.at = position(to, self.at, self.length)?;
        Ok(self.at)
    }
}

/// An open zip. Cheap to clone; clones read independently.
#[derive(Clone)]
pub(super) struct Container {
    zip: ZipArchive<SharedReader>,
    failure: DiskFailure,
}

impl Container {
    /// Parses the directory of a zip.
    pub(super) fn open(source: Arc<dyn ReadAt>, limits: &ArchiveLimits) -> Result<Self, Error> {
        let failure = DiskFailure::default();
        failure.explain(Self::checked(source, limits, &failure))
    }

    /// Parses the directory of the file at `path`.
    pub(super) fn open_file(path: &Path, limits: &ArchiveLimits) -> Result<Self, Error> {
        Self::open(Arc::new(File::open(path).map_err(unreadable)?), limits)
    }

    /// Parses the directory of a small zip in memory.
    pub(super) fn in_memory(bytes: Vec<u8>, limits: &ArchiveLimits) -> Result<Self, Error> {
        Self::open(Arc::new(bytes), limits)
    }

    fn checked(source: Arc<dyn ReadAt>, limits: &ArchiveLimits, failure: &DiskFailure) -> Result<Self, Error> {
        let length = source.length().map_err(unreadable)?;
        let Ends { head, tail } = refuse_other_files(&*source, length, limits)?;
        let source = without_zip64::rebuilt(&source, &tail, length, limits)?.unwrap_or(source);
        let length = source.length().map_err(unreadable)?;
        let damaged_directory = |why: &dyn std::fmt::Display| damaged_directory(why, &head);

        let budget = Arc::new(AtomicU64::new(member_count::directory_budget(limits)));
        let shared = SharedReader { source, length, at: 0, budget: budget.clone(), failure: failure.clone() };
        let directory_error = |error: ZipError| match &error {
            ZipError::Io(error) if error.to_string() == BUDGET_SPENT => Error::new(
                ErrorKind::ArchiveTooLarge,
                "the directory of the zip is too large; make the zip again with fewer files and without comments",
            ),
            ZipError::UnsupportedArchive(what) => Error::new(
                ErrorKind::UnsupportedArchive,
                format!("this kind of zip is not supported ({what}); make a plain zip"),
            ),
            ZipError::InvalidArchive(what) if what.contains("Multi-disk") => Error::new(
                ErrorKind::UnsupportedArchive,
                "the zip is split over several files; make one zip (zip64 is supported, so it may be of any size)",
            ),
            ZipError::InvalidArchive(what) => damaged_directory(what).caused_by(error),
            other => damaged_directory(other).caused_by(error),
        };
        let mut zip = ZipArchive::new(shared).map_err(directory_error)?;
        refuse_many(zip.len() as u64, limits)?;
        // the crate keeps the last of several equal names silently
        if zip.has_duplicate_names() {
            return Err(Error::new(
                ErrorKind::InvalidArchive,
                "the zip has several members of the same name; make a new zip instead of updating an old one",
            ));
        }
        if zip.has_overlapping_entries().map_err(directory_error)? {
            return Err(Error::new(
                ErrorKind::InvalidArchive,
                "members of the zip overlap, as in a zip bomb; make the zip again with an ordinary program",
            ));
        }
        budget.store(u64::MAX, Ordering::Relaxed);
        Ok(Self { zip, failure: failure.clone() })
    }

    /// All members that are files, with checked names, without the files that operating systems add.
    pub(super) fn members(&self) -> Result<Vec<Member>, Error> {
        let mut members = Vec::new();
        for index in 0..self.zip.len() {
            let entry = self.zip.by_index_data(index).map_err(|error| {
                let detail = format!("the directory of the zip is damaged{}; make the zip again", in_brackets(&error));
                Error::new(ErrorKind::InvalidArchive, detail).caused_by(error)
            })?;
            let raw = match entry.name() {
                Ok(name) => name.into_owned(),
                Err(_) => String::from_utf8_lossy(entry.name_raw()).into_owned(),
            };
            let unclear_name = member_names::is_of_another_code_page(entry.name_raw());
            let Some(name) = member_names::checked(&raw)? else { continue };
            if entry.is_symlink() {
                return Err(invalid(&name, format!("{name} is a symbolic link; put the file itself into the zip")));
            }
            if !entry.is_dir() {
                members.push(Member { index, name, size: entry.size(), unclear_name });
            }
        }
        Ok(members)
    }

    /// Refuses members that cannot be decompressed or are too large.
    pub(super) fn refuse_unreadable(&self, member: &Member, limits: &ArchiveLimits) -> Result<(), Error> {
        let entry = self.zip.by_index_data(member.index).map_err(|error| not_decompressed(&member.name, error))?;
        let unsupported =
            |detail: String| Error::new(ErrorKind::UnsupportedArchive, detail).in_file(&member.name, None);
        if entry.encrypted() {
            return Err(unsupported(format!("{} is encrypted; make the zip without a password", member.name)));
        }
        let method = entry.compression();
        if !matches!(method, CompressionMethod::Stored | CompressionMethod::Deflated | CompressionMethod::Deflate64) {
            let method = method_name(method);
            return Err(unsupported(format!(
                "{} is compressed with {method}, which is not supported; make the zip with \"store\" or \"deflate\"",
                member.name
            )));
        }
        if member.size > limits.max_member_bytes {
            let (size, most) = (member.size, limits.max_member_bytes);
            let detail = format!(
                "{} has {size} bytes uncompressed; at most {most} are allowed for one file: make it smaller, or \
                 remove it if it is not needed",
                member.name
            );
            return Err(Error::new(ErrorKind::ArchiveTooLarge, detail).in_file(&member.name, None));
        }
        Ok(())
    }

    /// The bytes of a member. Its size and CRC are checked. Data after the end of a PNG is decompressed and discarded.
    pub(super) fn read(&self, member: &Member, limits: &ArchiveLimits) -> Result<Vec<u8>, Error> {
        self.failure.explain(self.read_whole(member, limits))
    }

    fn read_whole(&self, member: &Member, limits: &ArchiveLimits) -> Result<Vec<u8>, Error> {
        self.refuse_unreadable(member, limits)?;
        let mut zip = self.zip.clone();
        let entry = zip.by_index(member.index).map_err(|error| not_decompressed(&member.name, error))?;
        let room = member.size.min(entry.compressed_size().saturating_mul(FIRST_ALLOCATION_RATIO));
        let room = usize::try_from(room).unwrap_or(0).saturating_add(codec::JPEG_ROOM);
        let mut bytes = Vec::with_capacity(room);
        // one byte more than declared reveals a member that is larger than declared
        let mut entry = entry.take(member.size.saturating_add(1));
        let unpacked = png_trailer::read_without_trailer(&mut entry, &mut bytes)
            .map_err(|error| not_decompressed(&member.name, error))?;
        if unpacked != member.size {
            return Err(damaged(&member.name, &"its size differs from the size in the directory"));
        }
        Ok(bytes)
    }

    /// The first `most` bytes of a member, or all of a shorter one, whatever its declared size. The CRC is not checked.
    pub(super) fn read_start(&self, member: &Member, limits: &ArchiveLimits, most: u64) -> Result<Vec<u8>, Error> {
        self.refuse_unreadable(member, &ArchiveLimits { max_member_bytes: u64::MAX, ..*limits })?;
        let mut zip = self.zip.clone();
        let entry = zip.by_index(member.index).map_err(|error| not_decompressed(&member.name, error))?;
        let mut bytes = Vec::new();
        let read = entry.take(most).read_to_end(&mut bytes).map_err(|error| not_decompressed(&member.name, error));
        self.failure.explain(read)?;
        Ok(bytes)
    }

    /// The header of a picture. At most `most` bytes of a compressed member are decompressed for it; `None` when the
    /// header is beyond them.
    pub(super) fn probe(&self, member: &Member, limits: &ArchiveLimits, most: u64) -> Result<Option<Header>, Error> {
        self.failure.explain(self.probe_header(member, limits, most))
    }

    fn probe_header(&self, member: &Member, limits: &ArchiveLimits, most: u64) -> Result<Option<Header>, Error> {
        self.refuse_unreadable(member, limits)?;
        let picture_error = |fault: ImageFault| fault.in_file(&member.name, None);
        let mut zip = self.zip.clone();
        if let Ok(entry) = zip.by_index_seek(member.index) {
            return codec::probe(BufReader::new(entry), &limits.image).map(Some).map_err(picture_error);
        }
        let entry = zip.by_index(member.index).map_err(|error| not_decompressed(&member.name, error))?;
        let mut reader = BufReader::new(SeekWindow::new(entry, member.size, most));
        let header = codec::probe(&mut reader, &limits.image);
        // what was not read may have been left out silently, as a colour profile is
        if reader.get_ref().was_stopped() {
            return Ok(None);
        }
        if reader.get_ref().fell_behind() {
            // a TIFF whose directory refers back and forth; rare
            drop(reader);
            let bytes = self.read_whole(member, limits)?;
            return codec::probe(io::Cursor::new(bytes), &limits.image).map(Some).map_err(picture_error);
        }
        header.map(Some).map_err(picture_error)
    }
}

/// A directory that does not match the file, whose first bytes are `head`.
fn damaged_directory(why: &dyn std::fmt::Display, head: &[u8]) -> Error {
    if not_a_zip::lost_line_ends(head) {
        return Error::new(ErrorKind::InvalidArchive, not_a_zip::LOST_LINE_ENDS);
    }
    let detail =
        format!("the zip is damaged{}; was the upload cut off? Make the zip again and send it again", in_brackets(why));
    Error::new(ErrorKind::InvalidArchive, detail)
}

/// The message of a library in brackets. Empty when it names Rust types, which mean nothing to users.
fn in_brackets(why: &dyn std::fmt::Display) -> String {
    let why = why.to_string();
    if why.is_empty() || why.contains("::") { String::new() } else { format!(" ({why})") }
}

/// A member that cannot be decompressed.
fn damaged(name: &str, why: &dyn std::fmt::Display) -> Error {
    invalid(
        name,
        format!(
            "{name} is damaged in the zip{}; was the upload cut off? Make the zip again and send it again",
            in_brackets(why)
        ),
    )
}

/// The same, caused by an error of the zip library or of its reader.
fn not_decompressed(name: &str, error: impl std::error::Error + Send + Sync + 'static) -> Error {
    damaged(name, &error).caused_by(error)
}

#[allow(deprecated)]
fn method_name(method: CompressionMethod) -> String {
    match method {
        CompressionMethod::Unsupported(number) => {
            format!("{} (method {number})", CompressionMethod::name_from_u16(number))
        }
        other => other.to_string(),
    }
}

fn refuse_many(members: u64, limits: &ArchiveLimits) -> Result<(), Error> {
    if members <= limits.max_members as u64 {
        return Ok(());
    }
    let detail = format!("the zip has {members} members; at most {} are allowed", limits.max_members);
    Err(Error::new(ErrorKind::ArchiveTooLarge, detail))
}

/// The first and the last bytes of a file.
struct Ends {
    head: Vec<u8>,
    tail: Vec<u8>,
}

/// Refuses files that are not a zip, truncated zips, and zips that declare too many members.
fn refuse_other_files(file: &dyn ReadAt, length: u64, limits: &ArchiveLimits) -> Result<Ends, Error> {
    let mut head = vec![0; length.min(not_a_zip::HEAD_BYTES) as usize];
    file.read_exact_at(&mut head, 0).map_err(unreadable)?;
    let tail_length = length.min(not_a_zip::END_RECORD_BYTES);
    let mut tail = vec![0; tail_length as usize];
    file.read_exact_at(&mut tail, length - tail_length).map_err(unreadable)?;
    if let Some(detail) = not_a_zip::diagnose(&head, &tail, length) {
        return Err(Error::new(ErrorKind::InvalidArchive, detail));
    }
    let members = member_count::declared(file, &tail, length).map_err(unreadable)?;
    refuse_many(members, limits)?;
    Ok(Ends { head, tail })
}

/// Writes a zip of stored members, because pictures hardly compress; zip64 where required. The same members give the
/// same bytes: no times are stored.
///
/// # Errors
/// Any I/O error of `out`, and [`io::ErrorKind::InvalidInput`] for a duplicate name.
pub fn pack(out: impl Write + Seek, members: impl Iterator<Item = (String, Vec<u8>)>) -> io::Result<()> {
    let mut zip = ZipWriter::new(out);
    for (name, bytes) in members {
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Stored)
            .large_file(bytes.len() as u64 >= u64::from(u32::MAX));
        zip.start_file(name, options)?;
        zip.write_all(&bytes)?;
    }
    zip.finish()?.flush()
}
