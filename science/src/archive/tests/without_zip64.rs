//! Zips over 4 GB and of many members, with sizes and offsets modulo 2^32 and the number of members modulo 2^16.

use std::io;

use super::*;
use crate::types::ReadAt;

/// A file of which only some parts are not zero.
#[derive(Default)]
struct Sparse {
    parts: Vec<(u64, Vec<u8>)>,
    length: u64,
}

impl Sparse {
    fn push(&mut self, bytes: Vec<u8>) {
        let at = self.length;
        self.length += bytes.len() as u64;
        self.parts.push((at, bytes));
    }
}

impl ReadAt for Sparse {
    fn length(&self) -> io::Result<u64> {
        Ok(self.length)
    }

    fn read_at(&self, buffer: &mut [u8], at: u64) -> io::Result<usize> {
        let length = (self.length.saturating_sub(at)).min(buffer.len() as u64) as usize;
        buffer[..length].fill(0);
        let first = self.parts.partition_point(|(start, bytes)| start + bytes.len() as u64 <= at);
        for (start, bytes) in self.parts[first..].iter().take_while(|(start, _)| *start < at + length as u64) {
            let (from, to) = ((*start).max(at), (start + bytes.len() as u64).min(at + length as u64));
            if from < to {
                buffer[(from - at) as usize..(to - at) as usize]
                    .copy_from_slice(&bytes[(from - start) as usize..(to - start) as usize]);
            }
        }
        Ok(length)
    }
}

/// A member: bytes, or a number of zeros.
enum Content {
    Bytes(Vec<u8>),
    Zeros(u64),
}
use Content::{Bytes, Zeros};

/// A zip as the Finder makes it: pictures deflated, with data descriptors; no zip64 records.
fn of_the_finder(members: &[(String, Content)]) -> Sparse {
    let mut file = Sparse::default();
    let mut directory = Vec::new();
    let u32s = |values: [u64; 3]| values.map(|value| (value as u32).to_le_bytes()).concat();
    for (name, content) in members {
        let at = file.length;
        let (packed, size, crc, flags) = match content {
            Bytes(bytes) => {
                let entry = deflated(entry(name, bytes), 8);
                (entry.data, bytes.len() as u64, entry.crc.unwrap(), 8u8)
            }
            Zeros(length) => (Vec::new(), *length, 0, 0),
        };
        let method = if flags == 8 { 8u8 } else { 0 };
        let packed_size = if flags == 8 { packed.len() as u64 } else { size };
        let sizes = u32s([crc.into(), packed_size, size]);
        let lengths = [(name.len() as u16).to_le_bytes(), [4, 0]].concat();
        let fixed = [20, 0, flags, 0, method, 0, 0, 0, 0x21, 0];
        let local_sizes = if flags == 8 { vec![0; 12] } else { sizes.clone() };
        let extra = [0x55, 0x58, 0, 0];
        file.push([b"PK\x03\x04", &fixed[..], &local_sizes, &lengths, name.as_bytes(), &extra].concat());
        match content {
            Bytes(_) => file.push([&packed[..], b"PK\x07\x08", &sizes].concat()),
            Zeros(length) => file.length += length,
        }
        let rest = [&[0; 8][..], &[0, 0, 0xA4, 0x81], &(at as u32).to_le_bytes()].concat();
        let rest = &rest[2..];
        directory
            .extend([b"PK\x01\x02", &[21, 3][..], &fixed, &sizes, &lengths, rest, name.as_bytes(), &extra].concat());
    }
    let (at, length) = (file.length as u32, directory.len() as u32);
    let count = (members.len() as u16).to_le_bytes();
    directory.extend([b"PK\x05\x06\0\0\0\0", &count[..], &count].concat());
    directory.extend([length.to_le_bytes(), at.to_le_bytes()].concat());
    directory.extend([0, 0]);
    file.push(directory);
    file
}

fn slices(fillers: &[u64]) -> Vec<(String, Content)> {
    let picture = |seed: u8| (format!("front/{seed}.png"), Bytes(png(seed)));
    let mut members = vec![picture(0)];
    members.extend(fillers.iter().enumerate().map(|(i, &length)| (format!("front/notes{i}.txt"), Zeros(length))));
    members.extend([picture(1), ("__MACOSX/front/._1.png".to_owned(), Bytes(vec![5; 200])), picture(2)]);
    members
}

#[test]
fn a_zip_over_4_gb_of_the_finder_is_read() {
    const GB: u64 = 1 << 30;
    for fillers in [
        &[100][..],
        &[GB, GB, GB, GB, GB],
        // members of more than 4 and 8 GB, and a zip of more than 16
        &[5 * GB],
        &[9 * GB + 7, 100, 4 * GB, 4 * GB - 1],
    ] {
        let file = Arc::new(of_the_finder(&slices(fillers)));
        let archive = open_shared(file, &ArchiveLimits::default()).unwrap();
        assert_eq!(archive.layout().front, ["front/0.png", "front/1.png", "front/2.png"], "{fillers:?}");
        for seed in 0..3 {
            assert_eq!(archive.front().load(seed).unwrap(), raster(seed as u8), "{fillers:?}");
        }
    }
}

#[test]
fn more_members_than_16_bits_count_are_all_seen() {
    let many: Vec<u64> = vec![0; 65_540];
    let file = Arc::new(of_the_finder(&slices(&many)));
    let limits = ArchiveLimits::scan();
    let archive = open_shared(Arc::clone(&file) as Arc<dyn ReadAt>, &limits).unwrap();
    assert_eq!(archive.layout().front.len(), 3);
    let fault = open_shared(file, &ArchiveLimits::default()).err().unwrap();
    assert_eq!(fault.kind, ErrorKind::ArchiveTooLarge);
    assert!(fault.detail.starts_with("the directory of the zip is too large"), "{}", fault.detail);
}

#[test]
fn a_zip_over_4_gb_whose_members_are_not_found_names_the_finder_and_a_way_out() {
    let mut file = of_the_finder(&slices(&[5 << 30]));
    let broken = file.parts.iter_mut().rev().find(|(_, bytes)| bytes.starts_with(b"PK\x03\x04")).unwrap();
    broken.1[0] = 0;
    let fault = open_shared(Arc::new(file), &ArchiveLimits::default()).err().unwrap();
    assert_eq!(fault.kind, ErrorKind::InvalidArchive);
    assert!(fault.detail.contains("Finder") && fault.detail.contains("pinstack push"), "{}", fault.detail);
}
