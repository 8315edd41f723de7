//! Zips over 4 GB without zip64 records, as the Finder of macOS makes them.
//!
//! They hold sizes and offsets modulo 2^32, and the number of members modulo 2^16. The members follow each other in the
//! order of the directory, so the true values can be found: the offset of a member is the first position behind the
//! member before it that has the stored remainder and the local header of that name. [`rebuilt`] shows the file with a
//! directory that has zip64 records.

use std::{io, sync::Arc};

use super::{
    disk_failure::unreadable,
    member_count::{EndRecord, MEMBER, ZIP64_END, ZIP64_LOCATOR, ZIP64_LOCATOR_BYTES, directory_budget, number},
};
use crate::{
    archive::ArchiveLimits,
    types::{Error, ErrorKind, ReadAt},
};

const LOCAL: &[u8] = b"PK\x03\x04";
/// Lengths of the headers of a member without name, extra field and comment, bytes.
const LOCAL_BYTES: usize = 30;
const MEMBER_BYTES: usize = 46;
/// The header of the extra field with values of zip64: its number and its length of three values.
const ZIP64_EXTRA: [u8; 4] = [1, 0, 24, 0];
/// What sizes and offsets are stored modulo.
const WRAP: u64 = 1 << 32;
/// What the number of members is stored modulo.
const COUNT_WRAP: u64 = 1 << 16;

/// A file up to `at`, and another end.
struct WithDirectory {
    source: Arc<dyn ReadAt>,
    at: u64,
    directory: Vec<u8>,
}

impl ReadAt for WithDirectory {
    fn length(&self) -> io::Result<u64> {
        Ok(self.at + self.directory.len() as u64)
    }

    fn read_at(&self, buffer: &mut [u8], at: u64) -> io::Result<usize> {
        match self.at.checked_sub(at).filter(|&before| before > 0) {
            Some(before) => {
                let most = usize::try_from(before).unwrap_or(usize::MAX).min(buffer.len());
                self.source.read_at(&mut buffer[..most], at)
            }
            None => self.directory.read_at(buffer, at - self.at),
        }
    }
}

/// The zip with a directory that has zip64 records; `None` for a zip that needs no other. `tail` holds the last bytes
/// of the file of `length` bytes.
///
/// # Errors
/// [`ErrorKind::InvalidArchive`] when the members are not found; [`ErrorKind::ArchiveTooLarge`] for too large a
/// directory; [`ErrorKind::ResourcesExhausted`] when the file cannot be read.
pub(super) fn rebuilt(
    source: &Arc<dyn ReadAt>,
    tail: &[u8],
    length: u64,
    limits: &ArchiveLimits,
) -> Result<Option<Arc<dyn ReadAt>>, Error> {
    let Some((end, position)) = EndRecord::last(tail, length) else { return Ok(None) };
    let Some(start) = position.checked_sub(end.directory_bytes) else { return Ok(None) };
    let has_many = end.directory_bytes >= MEMBER_BYTES as u64 * (end.members + COUNT_WRAP);
    if !end.is_of_one_file() || start % WRAP != end.directory_at || (start < WRAP && !has_many) {
        return Ok(None);
    }
    let mut before = [0; ZIP64_LOCATOR.len()];
    source.read_exact_at(&mut before, position.saturating_sub(ZIP64_LOCATOR_BYTES)).map_err(unreadable)?;
    if before == ZIP64_LOCATOR {
        return Ok(None);
    }
    if end.directory_bytes > directory_budget(limits) {
        let detail = "the directory of the zip is too large; make the zip again with fewer files and without comments";
        return Err(Error::new(ErrorKind::ArchiveTooLarge, detail));
    }
    let mut stored = vec![0; end.directory_bytes as usize];
    source.read_exact_at(&mut stored, start).map_err(unreadable)?;
    let found = members(&stored).filter(|members| members.len() as u64 % COUNT_WRAP == end.members);
    if start < WRAP && found.as_ref().is_none_or(|members| members.len() as u64 == end.members) {
        return Ok(None);
    }
    let directory = match found {
        Some(members) => directory(&**source, &members, start).map_err(unreadable)?,
        None => None,
    };
    let Some(directory) = directory else {
        let detail = "the zip is over 4 GB without zip64 records, as the Finder of macOS makes it, and its members are \
                      not where they should be; make the zip with another program (for example 7-Zip or zip), or send \
                      the folder itself with `pinstack push` or the page Send";
        return Err(Error::new(ErrorKind::InvalidArchive, detail));
    };
    Ok(Some(Arc::new(WithDirectory { source: Arc::clone(source), at: start, directory })))
}

/// The headers of the members in a directory; `None` for anything else in it.
fn members(mut stored: &[u8]) -> Option<Vec<&[u8]>> {
    let mut members = Vec::new();
    while !stored.is_empty() {
        let variable: u64 = [28, 30, 32].into_iter().map(|at| number(stored, at, 2)).sum::<Option<u64>>()?;
        let (member, rest) = stored.split_at_checked(MEMBER_BYTES + variable as usize)?;
        members.push(Some(member).filter(|member| member.starts_with(MEMBER))?);
        stored = rest;
    }
    Some(members)
}

/// The directory of `members`, which begins at `start`, with zip64 records; `None` when a member is not found.
fn directory(source: &dyn ReadAt, members: &[&[u8]], start: u64) -> io::Result<Option<Vec<u8>>> {
    // of each member: the offset, and the end by its stored size
    let mut places: Vec<(u64, u64)> = Vec::with_capacity(members.len());
    for member in members {
        let after = places.last().map_or(0, |(_, end)| *end);
        let Some(place) = place(source, member, after, start)? else { return Ok(None) };
        places.push(place);
    }
    let mut out = Vec::new();
    let following = places.iter().skip(1).map(|(offset, _)| *offset).chain([start]);
    for ((member, &(offset, end)), next) in members.iter().zip(&places).zip(following) {
        // a member of more than 4 GB leaves a gap to the next one
        let more = next.saturating_sub(end) / WRAP * WRAP;
        let size = |at| number(member, at, 4).unwrap_or_default() + more;
        let (fixed, variable) = member.split_at(MEMBER_BYTES);
        let [name, extra] = [28, 30].map(|at| number(member, at, 2).unwrap_or_default() as usize);
        let (before, comment) = variable.split_at(name + extra);
        let mut fixed = fixed.to_vec();
        fixed[20..28].fill(0xFF);
        fixed[30..32].copy_from_slice(&((extra + ZIP64_EXTRA.len() + 24) as u16).to_le_bytes());
        fixed[42..46].fill(0xFF);
        let values = [size(24), size(20), offset].map(u64::to_le_bytes).concat();
        out.extend([&fixed[..], before, &ZIP64_EXTRA, &values, comment].concat());
    }
    let (count, bytes) = (members.len() as u64, out.len() as u64);
    let end_at = start + bytes;
    out.extend([ZIP64_END, &44u64.to_le_bytes(), &[45, 0, 45, 0, 0, 0, 0, 0, 0, 0, 0, 0]].concat());
    out.extend([count, count, bytes, start].map(u64::to_le_bytes).concat());
    out.extend([ZIP64_LOCATOR, &[0; 4], &end_at.to_le_bytes(), &[1, 0, 0, 0]].concat());
    out.extend([&b"PK\x05\x06\0\0\0\0"[..], &[0xFF; 12], &[0, 0]].concat());
    Ok(Some(out))
}

/// The offset of a member that begins at `after` or later and before `limit`, and where it ends by its stored size.
fn place(source: &dyn ReadAt, member: &[u8], after: u64, limit: u64) -> io::Result<Option<(u64, u64)>> {
    let stored = |at, length| number(member, at, length).unwrap_or_default();
    let name = &member[MEMBER_BYTES..][..stored(28, 2) as usize];
    let mut at = after + stored(42, 4).wrapping_sub(after) % WRAP;
    let mut local = vec![0; LOCAL_BYTES + name.len()];
    while at + local.len() as u64 <= limit {
        source.read_exact_at(&mut local, at)?;
        if local.starts_with(LOCAL) && local.ends_with(name) {
            let extra = number(&local, 28, 2).unwrap_or_default();
            return Ok(Some((at, at + local.len() as u64 + extra + stored(20, 4))));
        }
        at += WRAP;
    }
    Ok(None)
}
