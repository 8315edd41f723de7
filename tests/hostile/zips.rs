//! Builds zips byte by byte, so that every field can be wrong.

use std::io::Write;

/// A member and its declared fields.
#[derive(Clone, Default)]
pub struct Member {
    pub name: String,
    /// The bytes as stored.
    pub data: Vec<u8>,
    /// 0 stored, 8 deflated.
    pub method: u16,
    pub crc: u32,
    /// Declared uncompressed size, bytes.
    pub size: u64,
    /// Sizes in a zip64 field: uncompressed and compressed, bytes.
    pub zip64: Option<(u64, u64)>,
    /// Has the offset of this earlier member.
    pub lies_at: Option<usize>,
}

/// A stored member.
pub fn stored(name: &str, data: &[u8]) -> Member {
    Member { name: name.into(), data: data.to_vec(), crc: crc32(data), size: data.len() as u64, ..Member::default() }
}

/// A deflated member with the data that `write` writes.
pub fn deflated(name: &str, write: impl Fn(&mut dyn Write)) -> Member {
    // the zip crate deflates; its member is taken out of its zip
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
    zip.start_file("m", options.large_file(false)).expect("a member");
    write(&mut zip);
    let bytes = zip.finish().expect("a zip").into_inner();
    let mut read = zip::ZipArchive::new(std::io::Cursor::new(&bytes)).expect("a zip");
    let entry = read.by_index_raw(0).expect("a member");
    let (start, packed) = (entry.data_start().expect("read") as usize, entry.compressed_size() as usize);
    let data = bytes[start..start + packed].to_vec();
    Member { name: name.into(), data, method: 8, crc: entry.crc32(), size: entry.size(), ..Member::default() }
}

/// The zip of these members.
pub fn zip(members: &[Member]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut places = Vec::new();
    for member in members {
        match member.lies_at {
            Some(earlier) => places.push(places[earlier]),
            None => {
                places.push(out.len() as u32);
                out.extend(b"PK\x03\x04");
                out.extend(fields(member));
                out.extend(member.name.as_bytes());
                out.extend(extra(member));
                out.extend(&member.data);
            }
        }
    }
    let directory = out.len() as u32;
    for (member, place) in members.iter().zip(&places) {
        out.extend(b"PK\x01\x02\x14\x03");
        out.extend(fields(member));
        out.extend([0; 6]);
        out.extend((0o100_644_u32 << 16).to_le_bytes());
        out.extend(place.to_le_bytes());
        out.extend(member.name.as_bytes());
        out.extend(extra(member));
    }
    let length = out.len() as u32 - directory;
    let count = (members.len() as u16).to_le_bytes();
    out.extend(b"PK\x05\x06\0\0\0\0");
    out.extend(count);
    out.extend(count);
    out.extend(length.to_le_bytes());
    out.extend(directory.to_le_bytes());
    out.extend([0, 0]);
    out
}

/// The fields common to the local and the central header.
fn fields(member: &Member) -> Vec<u8> {
    let mut out = Vec::new();
    out.extend(20_u16.to_le_bytes());
    out.extend(0_u16.to_le_bytes());
    out.extend(member.method.to_le_bytes());
    out.extend([0, 0, 0x21, 0]);
    out.extend(member.crc.to_le_bytes());
    let sizes = match member.zip64 {
        Some(_) => [u32::MAX; 2],
        None => [member.data.len() as u32, member.size as u32],
    };
    sizes.iter().for_each(|size| out.extend(size.to_le_bytes()));
    out.extend((member.name.len() as u16).to_le_bytes());
    out.extend((extra(member).len() as u16).to_le_bytes());
    out
}

fn extra(member: &Member) -> Vec<u8> {
    let Some((unpacked, packed)) = member.zip64 else { return Vec::new() };
    let mut out = vec![1, 0, 16, 0];
    out.extend(unpacked.to_le_bytes());
    out.extend(packed.to_le_bytes());
    out
}

/// CRC of zip and PNG.
pub fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0_u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 })
    })
}
