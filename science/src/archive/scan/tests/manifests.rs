//! Which `manifest.json` is that of the scan, and how views and counts are told.

use super::*;

const VIEWS: [&str; 4] = ["bee/a/1.png", "bee/a/2.png", "bee/b/1.png", "bee/b/2.png"];

/// The views of a scan with a file `manifest` beside [`VIEWS`] and a result.
fn with_manifest(manifest: &str, content: &str) -> Result<ScanArchive, Error> {
    let mut members = pictures(&VIEWS);
    members.push(("stacked/a.png".to_owned(), picture(9)));
    members.push((manifest.to_owned(), content.into()));
    grouped(&members, &ScanRules::default())
}

#[test]
fn a_manifest_in_a_folder_that_does_not_enclose_the_scan_is_ignored() {
    for content in ["no JSON", r#"{"views": []}"#, r#"{"views": [{"front": ["x.png"]}]}"#] {
        for name in ["bee/viewer/manifest.json", "viewer/manifest.json", "bee/a/manifest.json", "be/manifest.json"] {
            let scan = with_manifest(name, content).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!(scan.views().len(), 2, "{name}");
            let ignored = scan.ignored().iter().find(|file| file.name == name).expect("it is told");
            assert!(ignored.reason.contains("nor the manifest of the scan"), "{}", ignored.reason);
        }
    }
}

#[test]
fn a_manifest_in_the_root_or_around_everything_is_read() {
    for name in ["manifest.json", "bee/Manifest.JSON"] {
        let error = with_manifest(name, "no JSON").err().expect("it is read");
        assert!(error.detail.starts_with(&format!("{name} is not JSON")), "{}", error.detail);
        let listed = r#"{"views": [{"label": "one", "front": ["bee/a/1.png", "bee/b/2.png"]}]}"#;
        let scan = with_manifest(name, listed).expect(name);
        assert_eq!(told(&scan), [(Some("one"), None, None, 2, 0)], "{name}");
    }
}

#[test]
fn the_content_of_another_manifest_among_names_is_ignored() {
    let names = |manifest: &str| VIEWS.iter().copied().chain([manifest]).map(str::to_owned).collect::<Vec<_>>();
    let of = |manifest: &str, listed: Option<&[u8]>| group_names(&names(manifest), listed, &ScanRules::default());
    for listed in [None, Some(&b"no JSON"[..])] {
        assert_eq!(of("bee/viewer/manifest.json", listed).expect("views").views.len(), 2);
        assert!(of("bee/manifest.json", listed).is_err(), "this one is read");
    }
    assert!(of("bee/notes.txt", Some(b"{}")).is_err(), "a content without a name");
}

#[test]
fn equal_views_are_told_by_what_is_equal_and_counts_in_the_right_number() {
    let refused = |names: &[&str]| opened(names).err().expect("it is refused").detail;
    let angles = refused(&["pan20_tilt0/1.png", "pan20_tilt0/2.png", "pan020_tilt0/1.png", "pan020_tilt0/2.png"]);
    assert!(angles.contains(" have the same angles; "), "{angles}");
    let mut members = pictures(&VIEWS);
    let listed = r#"{"views": [{"label": "A", "front": ["bee/a/1.png", "bee/a/2.png"]},
                               {"label": "a", "front": ["bee/b/1.png", "bee/b/2.png"]}]}"#;
    members.push(("manifest.json".to_owned(), listed.into()));
    let name = grouped(&members, &ScanRules::default()).err().expect("it is refused").detail;
    assert!(name.contains("A and a have the same name; "), "{name}");
    let lone = refused(&["a/back/1.png", "b/1.png", "b/2.png"]);
    assert!(lone.starts_with("a has 1 back-light slice and no front-light slices"), "{lone}");

    let warning = |names: &[&str]| opened(names).expect("a scan").warnings()[0].detail.clone();
    let one = warning(&["a/1.png", "a/2.png", "b/1.png", "b/2.png", "c/1.png", "c/2.png", "c/3.png"]);
    assert!(one.starts_with("c differs from the other views"), "{one}");
}
