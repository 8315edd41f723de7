//! The zip, read by the `zip` crate.

use std::io::{Cursor, Read};

use super::*;
use crate::store::{SpoolFile, Store};

async fn store_with(files: &[(&str, &[u8])]) -> (tempfile::TempDir, Store) {
    let folder = tempfile::tempdir().expect("a folder for the test");
    let store = crate::store::open(folder.path()).await.expect("open");
    for (key, bytes) in files {
        let path = store.workspace.new_path("test").expect("a path");
        std::fs::write(&path, bytes).expect("write");
        store.blobs.put(key, SpoolFile::temporary(path)).await.expect("put");
    }
    (folder, store)
}

fn blob(path: &str, key: &str, bytes: &[u8]) -> ZipEntry {
    let content = EntryContent::Blob {
        key: key.into(),
        bytes: bytes.len() as u64,
        crc32: crc32fast::hash(bytes),
        sha256: hex(&Sha256::digest(bytes)),
    };
    ZipEntry { path: path.into(), content }
}

fn text(path: &str, text: &str) -> ZipEntry {
    ZipEntry { path: path.into(), content: EntryContent::Text(Bytes::from(text.to_owned())) }
}

async fn read(zip: &StoredZip, store: &Store, first: u64, length: u64) -> Vec<u8> {
    let chunks: Vec<Bytes> =
        zip.stream(Arc::clone(&store.blobs), first, length).try_collect().await.expect("all blobs are there");
    chunks.concat()
}

#[tokio::test]
async fn another_reader_finds_every_member_and_any_range_is_a_part_of_the_whole() {
    let (one, two) = (b"first image".as_slice(), [7u8; 5000].as_slice());
    let (_folder, store) = store_with(&[("results/a/1/image.png", one), ("results/b/1/image.png", two)]).await;
    let entries = vec![
        text("README.txt", "read me"),
        blob("images/a.png", "results/a/1/image.png", one),
        text("empty.txt", ""),
        blob("images/käfer.png", "results/b/1/image.png", two),
    ];
    let time: Timestamp = "2026-11-23T09:30:10Z".parse().expect("a time");
    let zip = StoredZip::new(entries, time);
    let whole = read(&zip, &store, 0, zip.length()).await;
    assert_eq!(whole.len() as u64, zip.length());
    let mut archive = zip::ZipArchive::new(Cursor::new(&whole)).expect("a zip");
    let names: Vec<String> = archive.file_names().map(|name| name.expect("UTF-8").into_owned()).collect();
    assert_eq!(names, ["README.txt", "images/a.png", "empty.txt", "images/käfer.png"]);
    let expected: [&[u8]; 4] = [b"read me", one, b"", two];
    for (at, expected) in expected.into_iter().enumerate() {
        let mut member = archive.by_index(at).expect("a member");
        let mut bytes = Vec::new();
        member.read_to_end(&mut bytes).expect("with the right CRC");
        assert_eq!(bytes, expected);
        let time = member.last_modified().expect("a time");
        assert_eq!((time.year(), time.month(), time.hour(), time.second()), (2026, 11, 9, 10));
    }
    for first in (0..zip.length()).step_by(97) {
        for length in [1, 30, 700, zip.length()] {
            let part = read(&zip, &store, first, length).await;
            let from = first as usize;
            let to = (first + length).min(zip.length()) as usize;
            assert_eq!(part, &whole[from..to], "{first} {length}");
        }
    }
}

#[test]
fn the_tag_depends_on_names_and_contents() {
    let tag = |entries| StoredZip::new(entries, Timestamp::UNIX_EPOCH).tag().to_owned();
    let one = tag(vec![text("a", "x")]);
    assert_eq!(one, tag(vec![text("a", "x")]));
    assert_ne!(one, tag(vec![text("a", "y")]));
    assert_ne!(one, tag(vec![text("b", "x")]));
}

/// The layout of a zip beyond 4 GiB, read back from its headers alone: the members are sparse.
#[test]
fn large_zips_have_zip64_records() {
    let large = |path: &str, bytes| {
        let content = EntryContent::Blob { key: "results/x".into(), bytes, crc32: 0, sha256: String::new() };
        ZipEntry { path: path.into(), content }
    };
    let zip = StoredZip::new(vec![large("a", 5 << 30), large("b", 10), large("c", 10)], Timestamp::UNIX_EPOCH);
    let mut file = tempfile::tempfile().expect("a file");
    file.set_len(zip.length()).expect("a sparse file");
    for segment in &zip.segments {
        if let SegmentSource::Memory(bytes) = &segment.source {
            use std::os::unix::fs::FileExt;
            file.write_all_at(bytes, segment.offset).expect("write");
        }
    }
    let mut archive = zip::ZipArchive::new(&mut file).expect("a zip");
    let sizes: Vec<u64> = (0..3).map(|at| archive.by_index_raw(at).expect("a member").size()).collect();
    assert_eq!(sizes, [5 << 30, 10, 10]);
    assert!(archive.by_index_raw(2).expect("a member").header_start() > u64::from(u32::MAX));
    let many = (0..70_000).map(|at| text(&format!("{at}"), "")).collect();
    let zip = StoredZip::new(many, Timestamp::UNIX_EPOCH);
    let bytes: Vec<u8> = zip
        .segments
        .iter()
        .flat_map(|segment| match &segment.source {
            SegmentSource::Memory(bytes) => bytes.to_vec(),
            SegmentSource::Blob(_) => Vec::new(),
        })
        .collect();
    assert_eq!(zip::ZipArchive::new(Cursor::new(bytes)).expect("a zip").len(), 70_000);
}
