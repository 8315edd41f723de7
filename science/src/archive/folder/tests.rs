use std::{
    ffi::OsStr,
    fs::File,
    os::unix::{ffi::OsStrExt, fs::symlink},
    sync::Arc,
};

use tempfile::TempDir;

use super::*;
use crate::{
    archive::{ScanRules, StackArchive, holds_scan, open_in_memory, open_scan_shared, open_shared, pack},
    imaging::{Raster, Slices, codec::Metadata},
    types::{NoControl, ReadAt},
};

fn png(seed: u8) -> Vec<u8> {
    let mut out = Vec::new();
    let samples = (0..20 * 16).map(|i| (i as u8).wrapping_mul(3).wrapping_add(seed)).collect();
    codec::encode_png(&mut out, &Raster::eight(20, 16, 1, samples), &Metadata::default()).unwrap();
    out
}

/// A folder with pictures of these names, all different.
fn folder(names: &[&str]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (seed, name) in names.iter().enumerate() {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, png(seed as u8)).unwrap();
    }
    folder
}

fn opened(path: &Path) -> StackArchive {
    let zip = Folder::list(path).unwrap().zip(&NoControl).unwrap();
    open_shared(Arc::new(zip), &ArchiveLimits::default()).unwrap()
}

fn refused(path: &Path) -> Error {
    Folder::list(path).map(|_| ()).unwrap_err()
}

#[test]
fn a_folder_opens_as_the_zip_of_its_files_does() {
    let names = ["Käfer/front/10.png", "Käfer/front/9.png", "Käfer/back/甲虫 1.png", "Käfer/back/甲虫 2.png"];
    let folder = folder(&names);
    for other in ["notes.txt", "Käfer/Thumbs.db", "Käfer/front/@eaDir/9.png", "Käfer/front/._9.png", "Käfer/9.xmp"]
    {
        let path = folder.path().join(other);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, "no picture").unwrap();
    }
    let found = opened(folder.path());
    let mut zip = std::io::Cursor::new(Vec::new());
    let mut members: Vec<_> = names.iter().zip(0..).map(|(name, seed)| ((*name).to_owned(), png(seed))).collect();
    members.extend(["notes.txt", "Käfer/9.xmp"].map(|name| (name.to_owned(), b"no picture".to_vec())));
    members.sort();
    pack(&mut zip, members.into_iter()).unwrap();
    let zipped = open_in_memory(zip.into_inner(), &ArchiveLimits::default()).unwrap();
    assert_eq!((found.layout(), found.warnings()), (zipped.layout(), zipped.warnings()));
    assert_eq!(found.warnings()[0].code, "files_passed_over");
    for index in 0..2 {
        assert_eq!(found.front().load(index), zipped.front().load(index));
        assert_eq!(found.back().load(index), zipped.back().load(index));
    }
}

#[test]
fn members_may_be_beyond_4_gb_and_large_files_that_are_no_pictures_are_not_read() {
    let folder = folder(&["front/1.png", "front/2.png"]);
    File::create(folder.path().join("a.mov")).unwrap().set_len(5 << 30).unwrap();
    let zip = Folder::list(folder.path()).unwrap().zip(&NoControl).unwrap();
    assert!(zip.length().unwrap() > 5 << 30);
    let stack = open_shared(Arc::new(zip), &ArchiveLimits::default()).unwrap();
    assert_eq!(stack.front().load(1).unwrap(), codec::decode(&png(1), &codec::Limits::default()).unwrap());
}

#[test]
fn a_file_that_changes_or_disappears_while_it_is_read_is_named() {
    let folder = folder(&["1.png", "2.png", "3.png"]);
    let stack = opened(folder.path());
    let [first, second] = ["1.png", "2.png"].map(|name| folder.path().join(name));
    // another program is still writing it
    fs::write(&first, [png(0), b"more".to_vec()].concat()).unwrap();
    let changed = stack.front().load(0).unwrap_err().detail;
    assert!(changed.starts_with(&format!("{} was changed while it was read", first.display())), "{changed}");
    let stack = opened(folder.path());
    fs::remove_file(&second).unwrap();
    let gone = stack.front().load(1);
    // it may still be open
    assert!(gone.is_ok() || gone.unwrap_err().detail.starts_with(&format!("cannot read {}", second.display())));
    let listed = Folder::list(folder.path()).unwrap();
    fs::write(&first, "torn").unwrap();
    let error = listed.zip(&NoControl).unwrap_err();
    assert!(matches!(error, Interrupted::Failed(error) if error.detail.contains("1.png was changed")));
}

#[test]
fn links_are_followed_unless_they_lead_back_or_nowhere() {
    let target = folder(&["1.png", "2.png"]);
    let folder = folder(&["front/0.png"]);
    let front = folder.path().join("front");
    symlink(target.path().join("1.png"), front.join("1.png")).unwrap();
    symlink(target.path(), folder.path().join("back")).unwrap();
    let stack = opened(folder.path());
    assert_eq!(stack.layout().front, ["front/0.png", "front/1.png"]);
    assert_eq!(stack.layout().back, ["back/1.png", "back/2.png"]);
    symlink(folder.path(), front.join("again")).unwrap();
    assert!(refused(folder.path()).detail.contains("leads back to a folder that encloses it"));
    fs::remove_file(front.join("again")).unwrap();
    symlink("nowhere.png", front.join("2.png")).unwrap();
    let nowhere = refused(folder.path()).detail;
    assert!(
        nowhere.starts_with(&format!("cannot read the target of the link {}", front.join("2.png").display())),
        "{nowhere}"
    );
}

#[test]
fn names_of_any_bytes_are_read_and_empty_or_missing_folders_are_refused() {
    let folder = folder(&["a1.png"]);
    fs::write(folder.path().join(OsStr::from_bytes(b"a\xFF2.png")), png(7)).unwrap();
    let stack = opened(folder.path());
    assert_eq!(stack.layout().front, ["a1.png", "a\u{FFFD}2.png"]);
    assert_eq!(stack.front().load(1).unwrap(), codec::decode(&png(7), &codec::Limits::default()).unwrap());
    let empty = tempfile::tempdir().unwrap();
    fs::create_dir(empty.path().join("front")).unwrap();
    assert!(refused(empty.path()).detail.ends_with("is empty; add the slices"));
    assert_eq!(refused(&empty.path().join("none")).kind, ErrorKind::Io);
}

#[test]
fn front_and_back_light_may_be_in_two_folders() {
    let (front, back) = (folder(&["1.png", "2.png"]), folder(&["x/1.png", "x/2.png"]));
    let both = Folder::of_lights(Folder::list(front.path()).unwrap(), Folder::list(back.path()).unwrap());
    let stack = open_shared(Arc::new(both.zip(&NoControl).unwrap()), &ArchiveLimits::default()).unwrap();
    assert_eq!(stack.layout().front, ["front/1.png", "front/2.png"]);
    assert_eq!(stack.layout().back, ["back/x/1.png", "back/x/2.png"]);
}

#[test]
fn each_view_of_a_scan_is_a_zip_of_its_own() {
    let views = ["pan000_tilt10", "pan020_tilt10"];
    let names: Vec<String> =
        views.iter().flat_map(|view| [1, 2, 10].map(|i| format!("bee/{view}/front/{i}.png"))).collect();
    let folder = folder(&names.iter().map(String::as_str).collect::<Vec<_>>());
    let listed = Folder::list(folder.path()).unwrap();
    let limits = ArchiveLimits::scan();
    assert!(holds_scan(Arc::new(listed.names()), &limits).unwrap());
    let scan = open_scan_shared(Arc::new(listed.names()), &limits, &ScanRules::default()).unwrap();
    assert_eq!(scan.views()[1].pan_deg, Some(20.0));
    let zip = listed.view(&scan.view_files(1).unwrap(), &NoControl).unwrap();
    let view = open_shared(Arc::new(zip), &ArchiveLimits::default()).unwrap();
    assert_eq!(view.layout().front, ["front/1.png", "front/2.png", "front/10.png"]);
    // the same slices from the zip of the whole scan
    let whole = Arc::new(listed.zip(&NoControl).unwrap());
    let scan = open_scan_shared(whole, &limits, &ScanRules::default()).unwrap();
    let inside = scan.open_view(1).unwrap();
    assert_eq!(inside.layout().front[2], "bee/pan020_tilt10/front/10.png");
    for index in 0..3 {
        assert_eq!(view.front().load(index), inside.front().load(index));
    }
}

#[test]
fn folders_of_views_are_told_from_those_of_one_stack() {
    let more = [
        (vec!["front/1.png", "uv/1.png", "left/1.png"], false),
        (vec!["bee/front/1.png", "bee/uv/1.png", "bee/left/1.png"], false),
        (vec!["a/front/1.png", "a/uv/1.png", "b/front/1.png", "b/uv/1.png"], true),
    ];
    let two = [
        (["1.png", "2.png"], false),
        (["front/1.png", "back/1.png"], false),
        (["bee/front/1.png", "bee/back/1.png"], false),
        (["1.png", "moved/1.png"], false),
        (["1.png", "thumbnails/1.png"], false),
        (["a/1.png", "b/1.png"], true),
        (["a/front/1.png", "a/back/1.png"], false),
        (["a/front/1.png", "b/front/1.png"], true),
        (["front/a/1.png", "front/b/1.png"], true),
        (["front/a/1.png", "back/a/1.png"], false),
    ];
    for (names, is_scan) in more.into_iter().chain(two.map(|(names, is_scan)| (names.to_vec(), is_scan))) {
        let folder = folder(&names);
        let listed = Folder::list(folder.path()).unwrap();
        assert_eq!(holds_scan(Arc::new(listed.names()), &ArchiveLimits::scan()).unwrap(), is_scan, "{names:?}");
    }
}
