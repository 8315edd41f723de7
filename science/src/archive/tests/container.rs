//! What is wrong with the zip itself: damage, compressions, hostile names, limits.

use std::io::Cursor;

use super::*;

#[test]
fn what_is_no_zip_is_told_from_a_zip_that_ends_early() {
    let whole = zip(&pictures(&["a.png", "b.png"]));
    for (bytes, expected) in [
        (&b""[..], "empty"),
        (b"PK\x03\x04 and no more", "ends early"),
        (&whole[..whole.len() - 30], "ends early"),
        (b"7z\xBC\xAF\x27\x1C", "7z"),
        (b"hello world, no zip here", "not a zip"),
    ] {
        let fault = open_bytes(bytes).err().unwrap();
        assert_eq!(fault.kind, ErrorKind::InvalidArchive);
        assert!(fault.detail.contains(expected), "{:?} lacks {expected:?}", fault.detail);
    }
}

#[test]
fn a_wrong_crc_names_the_member() {
    for make in [|e| e, |e| deflated(e, 8)] {
        let mut entries = pictures(&["front/a.png", "front/b.png"]);
        entries[1].crc = Some(1);
        let entries: Vec<Entry> = entries.into_iter().map(make).collect();
        let fault = open_bytes(&zip(&entries)).and_then(|archive| archive.front().load(1)).unwrap_err();
        assert_eq!(fault.kind, ErrorKind::InvalidArchive);
        assert!(fault.detail.contains("front/b.png"), "{}", fault.detail);
        assert_eq!(fault.locations[0].file.as_deref(), Some("front/b.png"));
        assert_eq!(fault.locations[0].slice, Some(1));
    }
}

#[test]
fn deflate_and_deflate64_are_read_and_other_methods_refused_by_name() {
    for method in [8, 9] {
        let entries: Vec<Entry> =
            pictures(&["a.png", "b.png"]).into_iter().map(|entry| deflated(entry, method)).collect();
        let archive = open_bytes(&zip(&entries)).unwrap();
        assert_eq!(archive.front().load(1).unwrap(), raster(1), "method {method}");
    }
    for (method, name) in [(12, "Bzip2"), (14, "Lzma"), (93, "Zstd"), (98, "Ppmd"), (77, "77")] {
        let mut entries = pictures(&["front/a.png", "front/b.png"]);
        entries[0].method = method;
        let fault = refused(&entries);
        assert_eq!(fault.kind, ErrorKind::UnsupportedArchive);
        assert!(fault.detail.contains(name) && fault.detail.contains("front/a.png"), "{}", fault.detail);
    }
}

#[test]
fn a_deflate64_zip_of_another_program_is_read() {
    let archive = open_bytes(include_bytes!("../testdata/deflate64.zip")).unwrap();
    assert_eq!(archive.layout().front, ["img_1.tif", "img_2.tif"]);
    assert_eq!((archive.layout().width, archive.layout().height), (40, 30));
    let expected = (0..40 * 30).map(|i| ((i % 40 / 4 * 16 + i / 40 / 3 * 10 + 40) % 256) as u8).collect();
    assert_eq!(archive.front().load(1).unwrap(), Raster::eight(40, 30, 1, expected));
}

#[test]
fn encrypted_members_are_refused() {
    let mut entries = pictures(&["front/a.png", "front/b.png"]);
    entries[1].flags = 1;
    let fault = refused(&entries);
    assert_eq!(fault.kind, ErrorKind::UnsupportedArchive);
    assert!(fault.detail.contains("front/b.png is encrypted"), "{}", fault.detail);
}

#[test]
fn hostile_names_are_refused() {
    for name in
        ["../a.png", "front/../../b.png", "/a.png", "C:\\a.png", "front/a\0.png", "..\\..\\a.png", "x/a\u{1b}[2J.png"]
    {
        let mut entries = pictures(&["front/a.png", "front/b.png"]);
        entries.push(entry(name, &png(9)));
        assert_eq!(refused(&entries).kind, ErrorKind::InvalidArchive, "{name:?}");
    }
    let mut entries = pictures(&["front/a.png", "front/b.png", "front/c.png"]);
    entries[2].mode = 0o120_777;
    let fault = refused(&entries);
    assert_eq!(fault.kind, ErrorKind::InvalidArchive);
    assert!(fault.detail.contains("symbolic link"));
}

#[test]
fn duplicate_names_are_refused_also_when_only_case_or_slashes_differ() {
    for other in ["front/a.png", "Front/A.PNG", "front\\a.png", "./front/a.png"] {
        let mut entries = pictures(&["front/a.png", "front/b.png"]);
        entries.push(entry(other, &png(9)));
        assert_eq!(refused(&entries).kind, ErrorKind::InvalidArchive, "{other}");
    }
}

#[test]
fn overlapping_members_are_refused() {
    let mut entries = pictures(&["front/a.png", "front/a.png"]);
    entries[1].name = b"front/b.png".to_vec();
    entries[1].data = entries[0].data.clone();
    entries[1].same_as = Some(0);
    let fault = refused(&entries);
    assert_eq!(fault.kind, ErrorKind::InvalidArchive);
    assert!(fault.detail.contains("overlap"), "{}", fault.detail);
}

#[test]
fn limits_are_kept_and_a_member_that_is_larger_than_it_says_is_refused() {
    let bytes = zip(&pictures(&["a.png", "b.png", "c.png"]));
    let size = png(0).len() as u64;
    let defaults = ArchiveLimits::default();
    for limits in [
        ArchiveLimits { max_members: 2, ..defaults },
        ArchiveLimits { max_member_bytes: size / 2, ..defaults },
        ArchiveLimits { max_total_bytes: size * 2, ..defaults },
        ArchiveLimits { max_directory_bytes: 64, ..defaults },
    ] {
        let fault = open_within(&bytes, &limits).err().unwrap();
        assert_eq!(fault.kind, ErrorKind::ArchiveTooLarge, "{limits:?}: {fault}");
    }
    let small = codec::Limits { max_pixels: 100, ..codec::Limits::default() };
    let fault = open_within(&bytes, &ArchiveLimits { image: small, ..defaults }).err().unwrap();
    assert_eq!(fault.kind, ErrorKind::InvalidImage);

    let mut entries = pictures(&["a.png", "b.png"]);
    entries[1].size = Some(entries[1].data.len() as u32 - 9);
    entries[1] = deflated(entries[1].clone(), 8);
    let fault = open_bytes(&zip(&entries)).and_then(|archive| archive.front().load(1)).unwrap_err();
    assert_eq!(fault.kind, ErrorKind::InvalidArchive, "{fault}");
}

#[test]
fn a_directory_far_larger_than_its_members_need_is_refused() {
    let names: Vec<String> = (0..20).map(|i| format!("{i:060000}.png")).collect();
    let bytes = zip(&pictures(&names.iter().map(String::as_str).collect::<Vec<_>>()));
    let limits = ArchiveLimits { max_members: 20, ..ArchiveLimits::default() };
    let fault = open_within(&bytes, &limits).err().unwrap();
    assert_eq!(fault.kind, ErrorKind::ArchiveTooLarge, "{fault}");
    assert!(fault.detail.starts_with("the directory of the zip is too large; make the zip again"), "{fault}");
}

/// A zip of two pictures, the second of which is at `offset` according to the zip64 field of its header.
fn with_zip64_offset(offset: u64) -> Vec<u8> {
    let mut bytes = zip(&pictures(&["a.png", "b.png"]));
    let end = bytes.len() - 22;
    let header = bytes.windows(4).rposition(|window| window == b"PK\x01\x02").unwrap();
    let field = [&[1, 0, 8, 0][..], &offset.to_le_bytes()].concat();
    bytes[header + 30..header + 32].copy_from_slice(&(field.len() as u16).to_le_bytes());
    bytes[header + 42..header + 46].copy_from_slice(&u32::MAX.to_le_bytes());
    let size = u32::from_le_bytes(bytes[end + 12..end + 16].try_into().unwrap()) + field.len() as u32;
    bytes[end + 12..end + 16].copy_from_slice(&size.to_le_bytes());
    bytes.splice(end..end, field);
    bytes
}

#[test]
fn a_member_beyond_the_end_of_the_file_is_a_fault_of_the_zip() {
    let local = zip(&pictures(&["a.png", "b.png"])).windows(4).rposition(|window| window == b"PK\x03\x04").unwrap();
    assert!(open_bytes(&with_zip64_offset(local as u64)).is_ok(), "the field is read");
    for offset in [1 << 20, 1 << 62, 1 << 63] {
        let fault = open_bytes(&with_zip64_offset(offset)).err().unwrap();
        assert_eq!(fault.kind, ErrorKind::InvalidArchive, "offset {offset}: {fault}");
    }
}

#[test]
fn a_tiff_with_its_directory_at_the_end_is_probed_from_a_compressed_member() {
    let tiff = |seed| {
        let mut out = Cursor::new(Vec::new());
        codec::encode_tiff(&mut out, &sized(1800, 900, seed), &Metadata::default()).unwrap();
        out.into_inner()
    };
    let entries = [deflated(entry("a.tif", &tiff(0)), 8), deflated(entry("b.tif", &tiff(1)), 9)];
    let archive = open_bytes(&zip(&entries)).unwrap();
    assert_eq!((archive.layout().width, archive.layout().height), (1800, 900));
    assert_eq!(archive.front().load(1).unwrap(), sized(1800, 900, 1));
}

#[test]
fn what_pack_writes_is_read_and_is_the_same_every_time() {
    let members = || [("front/a.png", 0), ("front/b.png", 1)].map(|(name, seed)| (name.to_owned(), png(seed)));
    let packed = || {
        let mut out = Cursor::new(Vec::new());
        pack(&mut out, members().into_iter()).unwrap();
        out.into_inner()
    };
    assert_eq!(packed(), packed());
    let archive = open_bytes(&packed()).unwrap();
    assert_eq!(archive.front().load(1).unwrap(), raster(1));
}

#[test]
fn files_of_one_folder_are_read_by_their_names() {
    let members = [
        entry("README.txt", b"read me"),
        entry("sparse/0/b.txt", b"2"),
        entry("sparse/0/a.txt", b"1"),
        entry("sparse/0/d.txt", b"4"),
    ];
    let wanted = [["a.txt", "b.txt"], ["c.txt", "README"]];
    let limits = ArchiveLimits::default();
    let found = read_files(zip(&members), wanted, &limits).unwrap();
    assert_eq!(found, [Some(("sparse/0/a.txt".into(), b"1".to_vec())), None]);
    let scattered = read_files(zip(&[&members[..], &[entry("c.txt", b"3")]].concat()), wanted, &limits).unwrap_err();
    assert_eq!(scattered.kind, ErrorKind::InvalidArchive);
    assert_eq!(scattered.detail, "the zip has sparse/0/b.txt and c.txt in two folders; zip one folder");
}
