//! The folder of the moved target of a calibration.

use super::*;

#[test]
fn pictures_in_a_folder_for_the_moved_target_are_no_slices() {
    let opened_zip = |names: &[&str]| opened(names).layout().clone();
    for folder in ["moved", "t/Moved Target", "Verschoben", "t/front/déplacé", "x/moved/front"] {
        let moved = [format!("{folder}/10.png"), format!("{folder}/9.png")];
        let layout = opened_zip(&["t/front/1.png", "t/front/2.png", &moved[0], &moved[1]]);
        assert_eq!(
            (layout.front, layout.moved),
            (vec!["t/front/1.png".into(), "t/front/2.png".into()], {
                let [ten, nine] = moved;
                vec![nine, ten]
            })
        );
    }
    let one = opened_zip(&["1.png", "2.png", "back/1.png", "back/2.png", "moved/a.png"]);
    assert_eq!((one.front.len(), one.back.len(), one.moved), (2, 2, vec!["moved/a.png".to_owned()]));
    // a folder that encloses all pictures says nothing
    let enclosed = opened_zip(&["moved/1.png", "moved/2.png"]);
    assert_eq!((enclosed.front.len(), enclosed.moved.len()), (2, 0));

    let mut entries = pictures(&["a.png", "b.png", "moved/a.png"]);
    entries.push(entry("manifest.json", br#"{"front": ["b.png", "a.png"]}"#));
    let listed = open_bytes(&zip(&entries)).unwrap();
    assert_eq!((&listed.layout().front[..], listed.moved().count()), (&["b.png".into(), "a.png".into()][..], 1));
    assert_eq!(listed.moved().load(0).unwrap(), raster(2));
}

#[test]
fn a_moved_target_of_another_size_or_in_two_folders_is_refused() {
    let mut entries = pictures(&["1.png", "2.png"]);
    entries.push(entry("moved/1.png", &png_of(&sized(30, 16, 1), &Metadata::default())));
    let other = refused(&entries);
    assert_eq!((other.kind, other.locations[0].file.as_deref()), (ErrorKind::SizeMismatch, Some("moved/1.png")));
    assert!(other.detail.contains("30 x 16 px (moved/1.png), and the others 20 x 16 px"), "{other}");
    let apart = refused(&pictures(&["1.png", "2.png", "a/moved/1.png", "b/moved/1.png"]));
    assert_eq!(apart.kind, ErrorKind::InvalidArchive);
    assert!(apart.detail.contains("in several folders (a/moved, b/moved)"), "{apart}");
}
