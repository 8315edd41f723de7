//! Whatever bytes come, they are an answer.

use std::{
    io,
    sync::atomic::{AtomicU64, Ordering},
};

use super::*;

/// Opens and loads everything; whatever it is, it is an answer.
fn exercise(bytes: &[u8]) {
    let limits = ArchiveLimits {
        max_member_bytes: 1 << 20,
        max_total_bytes: 4 << 20,
        image: codec::Limits { max_pixels: 1 << 18, ..codec::Limits::default() },
        ..ArchiveLimits::default()
    };
    if let Ok(archive) = open_within(bytes, &limits) {
        for slices in [archive.front(), archive.back()] {
            for index in 0..slices.count() {
                let _ = slices.load(index);
            }
        }
    }
}

/// Pictures of 8 and 16 bits in each format.
fn files() -> Vec<(&'static str, Vec<u8>)> {
    let eight = sized(40, 30, 7);
    let sixteen = Raster::sixteen(20, 30, 3, (0..20 * 30 * 3).map(|i| (i * 7919 % 65_521) as u16).collect());
    let tiff_of = |raster: &Raster| {
        let mut out = io::Cursor::new(Vec::new());
        codec::encode_tiff(&mut out, raster, &Metadata::default()).unwrap();
        out.into_inner()
    };
    let of = |raster: &Raster| [("png", png_of(raster, &Metadata::default())), ("tif", tiff_of(raster))];
    let mut files: Vec<_> = [of(&eight), of(&sixteen)].concat();
    files.push(("jpg", codec::encode_jpeg(&sized(40, 30, 7), 90)));
    files
}

/// What becomes of a file as the first slice of a stack: a picture, or an error in words.
fn loaded(extension: &str, file: &[u8], crc: Option<u32>, make: fn(Entry) -> Entry) -> Result<Raster, String> {
    let slice = Entry { crc, ..entry(&format!("front/a.{extension}"), file) };
    let next = entry(&format!("front/b.{extension}"), file);
    let archive = open_bytes(&zip(&[make(slice), next])).map_err(|error| error.detail)?;
    let picture = archive.front().load(0);
    picture.map_err(|error| {
        assert_eq!(error.locations[0].slice, Some(0), "{}", error.detail);
        error.detail
    })
}

#[test]
fn a_stored_and_a_compressed_member_give_the_same_picture_or_the_same_error() {
    let both = |extension: &str, file: &[u8], crc: Option<u32>| {
        let stored = loaded(extension, file, crc, |entry| entry);
        assert_eq!(stored, loaded(extension, file, crc, |entry| deflated(entry, 8)), "{extension}");
        stored
    };
    for (extension, file) in files() {
        let sound = both(extension, &file, None).expect("a picture");
        assert!(both(extension, &file, Some(1)).is_err_and(|why| why.contains("damaged in the zip")), "{extension}");
        // what follows a file does not matter, but its bytes count for the CRC
        let longer = [&file[..], &[0; 3000]].concat();
        assert_eq!(both(extension, &longer, None).expect("a picture"), sound, "{extension}");
        let mut refused = 0;
        for at in (1..file.len()).step_by(file.len() / 40) {
            let mut torn = file.clone();
            torn[at] ^= 0x55;
            refused += usize::from(both(extension, &torn, None).is_err());
            refused += usize::from(both(extension, &file[..at], None).is_err());
        }
        assert!(refused >= 30, "{extension}: {refused}");
    }
}

/// A disk that counts the bytes that are read.
struct CountingDisk {
    bytes: Vec<u8>,
    read: AtomicU64,
}

impl ReadAt for CountingDisk {
    fn length(&self) -> io::Result<u64> {
        self.bytes.length()
    }

    fn read_at(&self, buffer: &mut [u8], at: u64) -> io::Result<usize> {
        let read = self.bytes.read_at(buffer, at)?;
        self.read.fetch_add(read as u64, Ordering::Relaxed);
        Ok(read)
    }
}

/// A grey TIFF of 1 x `height` px, each in its own strip, by turns at the start and at the end of the file.
fn tiff_of_strips(height: u32) -> Vec<u8> {
    let (offsets, counts) = (8 + 2 + 9 * 12 + 4, 8 + 2 + 9 * 12 + 4 + 4 * height);
    let end = counts + 4 * height;
    let fields = [(256u16, 1, 1), (257, 1, height), (258, 1, 8), (259, 1, 1), (262, 1, 1), (273, height, offsets)];
    let fields = fields.into_iter().chain([(277, 1, 1), (278, 1, 1), (279, height, counts)]);
    let mut out = b"II\x2A\0\x08\0\0\0\x09\0".to_vec();
    for (tag, count, value) in fields {
        out.extend(tag.to_le_bytes());
        out.extend(4u16.to_le_bytes());
        out.extend([count, value].map(u32::to_le_bytes).concat());
    }
    out.extend([0; 4]);
    (0..height).for_each(|y| out.extend((if y % 2 == 0 { 8 } else { end }).to_le_bytes()));
    (0..height).for_each(|_| out.extend(1u32.to_le_bytes()));
    out.push(77);
    out
}

#[test]
fn strips_all_over_a_file_cost_one_small_read_each() {
    const STRIPS: u32 = 20_000;
    let file = tiff_of_strips(STRIPS);
    let bytes = zip(&[entry("a.tif", &file), entry("b.tif", &file)]);
    let (size, read) = (bytes.len() as u64, AtomicU64::new(0));
    let disk = Arc::new(CountingDisk { bytes, read });
    let archive = open_shared(disk.clone(), &ArchiveLimits::default()).unwrap();
    disk.read.store(0, Ordering::Relaxed);
    assert_eq!(archive.front().load(0).unwrap().height, STRIPS as usize);
    let read = disk.read.load(Ordering::Relaxed);
    assert!(read <= 8192 * u64::from(STRIPS) + 8 * size, "{read} bytes");
}

#[test]
fn too_many_members_are_refused_before_the_directory_is_read() {
    let members: Vec<Entry> = (0..20_000).map(|i| entry(&format!("{i:05}.png"), b"")).collect();
    let disk = Arc::new(CountingDisk { bytes: zip(&members), read: AtomicU64::new(0) });
    let fault = open_shared(disk.clone(), &ArchiveLimits::default()).err().unwrap();
    assert_eq!(fault.kind, ErrorKind::ArchiveTooLarge);
    assert_eq!(fault.detail, "the zip has 20000 members; at most 2500 are allowed");
    let read = disk.read.load(Ordering::Relaxed);
    assert!(read < 200_000, "{read} bytes of a directory of {} bytes", 20_000 * (46 + 9));
}

fn sound() -> Vec<u8> {
    let mut entries = pictures(&["w/front/a.png", "w/front/b.png", "w/back/a.png", "w/back/b.png"]);
    entries[1] = deflated(entries[1].clone(), 8);
    entries[2] = deflated(entries[2].clone(), 9);
    entries.push(entry("w/manifest.json", br#"{"front": ["a.png", "b.png"], "back": ["a.png", "b.png"]}"#));
    zip(&entries)
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig::with_cases(300))]

    #[test]
    fn damaged_zips_never_panic(flips in proptest::collection::vec((0..100_000usize, 1..=255u8), 1..6), cut in 0..4000usize) {
        let mut bytes = sound();
        for (at, flip) in flips {
            let at = at % bytes.len();
            bytes[at] ^= flip;
        }
        if cut < 1000 {
            bytes.truncate(bytes.len() * cut / 1000);
        }
        exercise(&bytes);
    }

    #[test]
    fn damage_to_the_directory_never_panics(flips in proptest::collection::vec((0..600usize, 1..=255u8), 1..8)) {
        let mut bytes = sound();
        let length = bytes.len();
        for (back, flip) in flips {
            bytes[length - 1 - back % length] ^= flip;
        }
        exercise(&bytes);
    }

    #[test]
    fn random_bytes_never_panic(mut bytes in proptest::collection::vec(proptest::num::u8::ANY, 0..400), tail: bool) {
        if tail {
            bytes.extend(b"PK\x05\x06\0\0\0\0\x02\0\x02\0");
            bytes.extend([40, 0, 0, 0, 1, 0, 0, 0, 0, 0]);
        }
        exercise(&bytes);
    }
}

#[test]
fn every_cut_of_a_sound_zip_is_refused() {
    let bytes = sound();
    assert!(open_bytes(&bytes).is_ok());
    for cut in 0..bytes.len() {
        assert!(open_bytes(&bytes[..cut]).is_err(), "{cut} of {}", bytes.len());
    }
}
