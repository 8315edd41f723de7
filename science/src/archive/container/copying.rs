//! Copies members of one zip into another.

use std::io::{self, Read, Seek, Write};

use zip::{CompressionMethod, ExtraField, ZipWriter, read::ZipFile, result::ZipError, write::SimpleFileOptions};

use super::{Container, SharedReader, damaged, not_decompressed};
use crate::{
    archive::{ArchiveLimits, members::Member},
    types::{Error, ErrorKind},
};

/// Maximum size of the extra fields of a member that is copied with its compressed bytes.
const MAX_EXTRA_BYTES: usize = 256;

/// Upper bound of the bytes that a zip needs besides members and their headers.
const END_BYTES: u64 = 1 << 10;

/// Upper bound of the bytes of both headers of a member, without its name and its extra fields.
const HEADER_BYTES: u64 = 30 + 46 + 2 * 32;

impl Container {
    /// Writes a zip of `members`, each under a new name, and of small files. Deflated members are copied with their
    /// compressed bytes where their headers allow it; others are stored. The size and the CRC of each member are
    /// checked. The time fields are not kept, so the result depends on the contents only; the extra fields of deflated
    /// members, which may hold times, are copied.
    ///
    /// # Errors
    /// As [`Container::read`] for a member; [`ErrorKind::DiskFull`] and [`ErrorKind::Io`] for `out`.
    pub(in crate::archive) fn copy<'a>(
        &self,
        members: impl Iterator<Item = (String, &'a Member)>,
        files: &[(&str, &[u8])],
        limits: &ArchiveLimits,
        out: impl Write + Seek,
    ) -> Result<(), Error> {
        self.failure.explain(self.copy_all(members, files, limits, out))
    }

    fn copy_all<'a>(
        &self,
        members: impl Iterator<Item = (String, &'a Member)>,
        files: &[(&str, &[u8])],
        limits: &ArchiveLimits,
        out: impl Write + Seek,
    ) -> Result<(), Error> {
        let mut to = ZipWriter::new(out);
        for (name, bytes) in files {
            to.start_file(name, stored(bytes.len() as u64)).map_err(not_written)?;
            to.write_all(bytes).map_err(not_written)?;
        }
        for (name, member) in members {
            self.refuse_unreadable(member, limits)?;
            match self.is_copied_raw(member)? {
                true => self.copy_raw(member, name, &mut to)?,
                false => self.copy_stored(member, name, &mut to)?,
            }
        }
        to.finish().map_err(not_written)?.flush().map_err(not_written)
    }

    /// Upper bound of the size of the zip that [`Container::copy`] writes for members with names of at most
    /// `name_bytes` bytes and one file of `file_bytes`.
    pub(in crate::archive) fn copied_bytes<'a>(
        &self,
        members: impl Iterator<Item = &'a Member>,
        name_bytes: u64,
        file_bytes: u64,
    ) -> Result<u64, Error> {
        let headers = HEADER_BYTES + 2 * (name_bytes + MAX_EXTRA_BYTES as u64);
        let mut sum = END_BYTES + headers + file_bytes;
        for member in members {
            let bytes = match self.is_copied_raw(member)? {
                true => self.entry(member)?.compressed_size(),
                false => member.size,
            };
            sum = sum.saturating_add(bytes).saturating_add(headers);
        }
        Ok(sum)
    }

    /// True when the compressed bytes of a member can be copied: it is deflated, smaller than the file, and has no
    /// extra field that names it.
    fn is_copied_raw(&self, member: &Member) -> Result<bool, Error> {
        let entry = self.entry(member)?;
        if entry.compression() != CompressionMethod::Deflated || entry.compressed_size() >= entry.size() {
            return Ok(false);
        }
        let mut zip = self.zip.clone();
        let file =
            self.failure.explain(zip.by_index_raw(member.index).map_err(|e| not_decompressed(&member.name, e)))?;
        let names_itself = file.extra_data_fields().any(|field| matches!(field, ExtraField::UnicodePath(_)));
        let is_small =
            file.extra_data().is_none_or(|extra| extra.len() <= MAX_EXTRA_BYTES) && file.comment().is_empty();
        Ok(is_small && !names_itself)
    }

    fn entry(&self, member: &Member) -> Result<zip::read::ZipFileEntry<'_>, Error> {
        self.zip.by_index_data(member.index).map_err(|error| not_decompressed(&member.name, error))
    }

    fn copy_raw<W: Write + Seek>(&self, member: &Member, name: String, to: &mut ZipWriter<W>) -> Result<(), Error> {
        let mut zip = self.zip.clone();
        // the copy does not look at the checksum
        let entry = zip.by_index(member.index).map_err(|error| not_decompressed(&member.name, error))?;
        unpack(entry, member, &mut io::sink())?;
        let entry = zip.by_index_raw(member.index).map_err(|error| not_decompressed(&member.name, error))?;
        to.raw_copy_file_rename(entry, name).map_err(not_written)
    }

    fn copy_stored<W: Write + Seek>(&self, member: &Member, name: String, to: &mut ZipWriter<W>) -> Result<(), Error> {
        let mut zip = self.zip.clone();
        let entry = zip.by_index(member.index).map_err(|error| not_decompressed(&member.name, error))?;
        to.start_file(name, stored(member.size)).map_err(not_written)?;
        unpack(entry, member, to)
    }
}

/// Decompresses a member into `out`, and checks its size and CRC.
fn unpack(entry: ZipFile<'_, SharedReader>, member: &Member, out: &mut impl Write) -> Result<(), Error> {
    // one byte more than declared reveals a member that is larger than declared
    let mut from = entry.take(member.size.saturating_add(1));
    let mut buffer = vec![0; 256 << 10];
    let mut unpacked = 0;
    loop {
        match from.read(&mut buffer).map_err(|error| not_decompressed(&member.name, error))? {
            0 => break,
            read => {
                unpacked += read as u64;
                if unpacked <= member.size {
                    out.write_all(&buffer[..read]).map_err(not_written)?;
                }
            }
        }
    }
    match unpacked == member.size {
        true => Ok(()),
        false => Err(damaged(&member.name, &"its size differs from the size in the directory")),
    }
}

fn stored(bytes: u64) -> SimpleFileOptions {
    SimpleFileOptions::default().compression_method(CompressionMethod::Stored).large_file(bytes >= u64::from(u32::MAX))
}

/// An error of the zip that is written.
fn not_written(error: impl Into<ZipError>) -> Error {
    let error = error.into();
    let kind = match &error {
        ZipError::Io(error) if error.kind() == io::ErrorKind::StorageFull => ErrorKind::DiskFull,
        ZipError::Io(error) if error.kind() == io::ErrorKind::QuotaExceeded => ErrorKind::DiskFull,
        _ => ErrorKind::Io,
    };
    Error::new(kind, format!("the zip of a view cannot be written ({error}); free space on the disk and try again"))
        .caused_by(error)
}
