//! Decodes the picture in a member.

use std::io::{self, BufReader, Read};

use super::{Container, damaged, not_decompressed};
use crate::{
    archive::{ArchiveLimits, members::Member},
    imaging::{
        Raster,
        codec::{self, ImageFault},
    },
    types::Error,
};

impl Container {
    /// Decodes the picture in a member. The size and the CRC of the member are checked. 8-bit samples may be in the
    /// memory of `buffer`.
    ///
    /// A PNG or TIFF that is stored without compression is read while it is decoded: with 16 bits a file is as large as
    /// its picture, and need not be in memory beside it.
    pub(in crate::archive) fn decode(
        &self,
        member: &Member,
        limits: &ArchiveLimits,
        buffer: Vec<u8>,
    ) -> Result<Raster, Error> {
        self.failure.explain(self.decode_member(member, limits, buffer))
    }

    fn decode_member(&self, member: &Member, limits: &ArchiveLimits, buffer: Vec<u8>) -> Result<Raster, Error> {
        self.refuse_unreadable(member, limits)?;
        let picture_error = |fault: ImageFault| fault.in_file(&member.name, None);
        let mut zip = self.zip.clone();
        // only members without compression can be read from anywhere
        if let Ok(entry) = zip.by_index_seek(member.index) {
            let decoded = codec::decode_while_reading(BufReader::new(entry), member.size, &limits.image);
            if !matches!(decoded, Ok(None)) {
                // a damaged member is the cause of whatever is wrong with its picture
                self.check(member)?;
            }
            if let Some(raster) = decoded.map_err(picture_error)? {
                return Ok(raster);
            }
        }
        codec::decode_into(self.read_whole(member, limits)?, &limits.image, buffer).map_err(picture_error)
    }

    /// Reads a member to its end, for its size and its CRC.
    fn check(&self, member: &Member) -> Result<(), Error> {
        let mut zip = self.zip.clone();
        let entry = zip.by_index(member.index).map_err(|error| not_decompressed(&member.name, error))?;
        // one byte more than declared reveals a member that is larger than declared
        let mut entry = BufReader::with_capacity(64 << 10, entry.take(member.size.saturating_add(1)));
        let read = io::copy(&mut entry, &mut io::sink()).map_err(|error| not_decompressed(&member.name, error))?;
        match read == member.size {
            true => Ok(()),
            false => Err(damaged(&member.name, &"its size differs from the size in the directory")),
        }
    }
}
