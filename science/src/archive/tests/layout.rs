//! Which light a slice is of, and in which order slices are: folders and the manifest.

use super::*;

#[test]
fn a_manifest_tells_the_order() {
    let mut entries = pictures(&["s/front/a.png", "s/front/b.png", "s/back/a.png", "s/back/b.png"]);
    let text = br#"{"front": ["b.png", "front/a.png"], "back": ["back\\b.png", "s/back/A.PNG"], "note": 1}"#;
    entries.push(entry("s/manifest.json", text));
    let archive = open_bytes(&zip(&entries)).unwrap();
    assert_eq!(archive.layout().front, ["s/front/b.png", "s/front/a.png"]);
    assert_eq!(archive.layout().back, ["s/back/b.png", "s/back/a.png"]);
    assert_eq!(archive.warnings(), []);

    for text in [
        r#"{"front": ["a.png"], "back": ["a.png", "b.png"]}"#,
        r#"{"front": ["a.png", "a.png", "b.png"], "back": ["a.png", "b.png"]}"#,
        r#"{"front": ["a.png", "x.png"], "back": ["a.png", "b.png"]}"#,
        r#"{"front": ["a.png", "../b.png"], "back": ["a.png", "b.png"]}"#,
        r#"{"front": "a.png"}"#,
        "front: a.png",
    ] {
        entries[4] = entry("s/manifest.json", text.as_bytes());
        assert_eq!(refused(&entries).kind, ErrorKind::InvalidArchive, "{text}");
    }
    entries[4] = entry("manifest.json", br#"{"version": 3}"#);
    let archive = open_bytes(&zip(&entries)).unwrap();
    assert_eq!(archive.warnings()[0].code, "manifest_passed_over");
}

#[test]
fn a_manifest_can_make_slices_of_any_folders() {
    let mut entries = pictures(&["one/a.png", "two/a.png"]);
    entries.push(entry("manifest.json", br#"{"front": ["two/a.png", "one/a.png"]}"#));
    assert_eq!(open_bytes(&zip(&entries)).unwrap().layout().front, ["two/a.png", "one/a.png"]);
}

#[test]
fn pictures_in_the_root_are_front_light_and_folders_around_everything_are_looked_through() {
    for names in [
        ["a.png", "b.png"],
        ["Stack 7/a.png", "Stack 7/b.png"],
        ["2024/käfer/FrontLight/a.png", "2024/käfer/FrontLight/b.png"],
        ["x/front/session/a.png", "x/front/session/b.png"],
        ["front\\a.png", "front\\b.png"],
    ] {
        let archive = opened(&names);
        assert_eq!(archive.layout().front, names.map(|name| name.replace('\\', "/")));
        assert!(archive.layout().back.is_empty());
        assert_eq!(archive.warnings(), []);
    }
    let archive = opened(&["w/a.png", "w/b.png", "w/Back_Light/1.png", "w/Back_Light/2.png"]);
    assert_eq!(archive.layout().front, ["w/a.png", "w/b.png"]);
    assert_eq!(archive.layout().back, ["w/Back_Light/1.png", "w/Back_Light/2.png"]);
    let archive = opened(&["fg/a.png", "fg/b.png", "bg/a.png", "bg/b.png"]);
    assert_eq!((archive.layout().front.len(), archive.layout().back.len()), (2, 2));
}

#[test]
fn folders_that_do_not_tell_the_light_are_refused() {
    for names in [
        &["front/a.png", "front/b.png", "c.png"][..],
        &["one/a.png", "two/b.png"],
        &["other/a.png", "other/b.png", "back/a.png", "back/b.png"],
        &["front/1/a.png", "front/2/b.png"],
        &["a.png", "thumbs/a.png"],
    ] {
        assert_eq!(refused(&pictures(names)).kind, ErrorKind::InvalidArchive, "{names:?}");
    }
}
