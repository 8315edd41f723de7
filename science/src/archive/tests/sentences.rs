//! What messages say of names, folders and counts.

use super::*;

fn told(names: &[&str]) -> String {
    refused(&pictures(names)).detail
}

#[test]
fn a_name_in_the_manifest_that_no_member_can_have_is_a_fault_of_the_manifest() {
    let long = "x".repeat(2_000);
    for (name, reason) in [
        ("../b.png", "points outside of the zip (\"..\")"),
        ("/b.png", "is an absolute path"),
        ("", "is empty"),
        ("b\\u0007.png", "contains control characters"),
        (long.as_str(), "is longer than 1024 bytes"),
    ] {
        let mut entries = pictures(&["a.png", "b.png"]);
        entries.push(entry("manifest.json", format!(r#"{{"front": ["a.png", "{name}"]}}"#).as_bytes()));
        let fault = refused(&entries);
        assert_eq!(fault.kind, ErrorKind::InvalidArchive);
        assert_eq!(fault.locations[0].file.as_deref(), Some("manifest.json"), "{name:?}");
        let end = format!(": the name {reason}; correct the list");
        assert!(fault.detail.starts_with("manifest.json lists \"") && fault.detail.ends_with(&end), "{}", fault.detail);
    }
    // the same name of a member is a fault of the zip
    assert!(told(&["a.png", "../b.png"]).contains("make the zip from within the folder"));
}

#[test]
fn one_thing_is_told_in_the_singular() {
    let one = told(&["front/a.png", "front/b.png", "back/a.png"]);
    assert!(one.starts_with("the zip has 2 front-light slices and 1 back-light slice; both"), "{one}");
    let one = told(&["back/a.png"]);
    assert!(one.starts_with("the zip has 1 back-light slice and no front-light slices"), "{one}");
    let one = told(&["other/a.png", "other/b.png", "back/c.png"]);
    assert!(one.contains("in a folder that is neither front nor back (other);"), "{one}");
    let one = told(&["front/a.png", "front/b.png", "uv/c.png"]);
    assert!(one.starts_with("the further light uv has 1 slice and the front light 2;"), "{one}");
    let two = told(&["one/a.png", "two/b.png"]);
    assert!(two.contains("in folders that are neither front nor back (one, two);"), "{two}");
}

#[test]
fn too_many_slices_are_told_with_their_light() {
    // the number is checked before the pictures are read
    let many = |light: &str, count: usize| -> Vec<Entry> {
        (0..count).map(|i| entry(&format!("{light}/{i}.png"), b"")).collect()
    };
    let counts: [(usize, usize, &str); 2] = [(1_001, 2, "1001 front-light"), (2, 1_002, "1002 back-light")];
    for (front, back, expected) in counts {
        let entries: Vec<Entry> = [many("front", front), many("back", back)].concat();
        let fault = refused(&entries);
        assert_eq!(fault.kind, ErrorKind::ArchiveTooLarge);
        let start = format!("the zip has {expected} slices; at most 1000 of one light are allowed");
        assert!(fault.detail.starts_with(&start), "{}", fault.detail);
    }
}
