//! Folders beside front and back: further lights.

use super::*;

/// Two slices in each folder.
fn in_folders(folders: &[&str]) -> Vec<Entry> {
    let names: Vec<String> = folders.iter().flat_map(|folder| [1, 2].map(|k| format!("{folder}/{k}.png"))).collect();
    pictures(&names.iter().map(String::as_str).collect::<Vec<_>>())
}

fn lights(archive: &StackArchive) -> Vec<(&str, Vec<&str>)> {
    let of_layout = archive.layout().lights.iter();
    of_layout.map(|light| (light.name.as_str(), light.slices.iter().map(String::as_str).collect())).collect()
}

#[test]
fn folders_beside_front_are_further_lights_in_the_order_of_their_names() {
    let archive = open_bytes(&zip(&in_folders(&["s/uv", "s/front", "s/back", "s/Left_45", "s/led-2"]))).unwrap();
    let expected = [
        ("led-2", vec!["s/led-2/1.png", "s/led-2/2.png"]),
        ("Left_45", vec!["s/Left_45/1.png", "s/Left_45/2.png"]),
        ("uv", vec!["s/uv/1.png", "s/uv/2.png"]),
    ];
    assert_eq!(lights(&archive), expected);
    assert_eq!((archive.layout().front.len(), archive.layout().back.len(), archive.warnings().len()), (2, 2, 0));
    assert_eq!(archive.lights()[2].1.load(1).unwrap(), raster(1));

    let reversed = archive.reversed();
    assert_eq!(reversed.layout().lights[2].slices, ["s/uv/2.png", "s/uv/1.png"]);
    assert_eq!(reversed.lights()[2].1.load(0).unwrap(), raster(1));
}

#[test]
fn a_manifest_can_list_further_lights() {
    let mut entries = pictures(&["front/a.png", "front/b.png", "uv/a.png", "uv/b.png", "x 1.png", "x 2.png"]);
    let listed =
        r#"{"front": ["b.png", "a.png"], "lights": {"uv": ["uv/b.png", "a.png"], "left": ["x 2.png", "x 1.png"]}}"#;
    entries.push(entry("manifest.json", listed.as_bytes()));
    let archive = open_bytes(&zip(&entries)).unwrap();
    assert_eq!(lights(&archive), [("left", vec!["x 2.png", "x 1.png"]), ("uv", vec!["uv/b.png", "uv/a.png"])]);
    assert_eq!(archive.layout().front, ["front/b.png", "front/a.png"]);
    for (name, said) in [("pan020_tilt06", "like a view of a scan"), ("u v", "letters from a to z")] {
        entries[6].data = listed.replace("left", name).into_bytes();
        let fault = refused(&entries);
        assert!(fault.kind == ErrorKind::InvalidArchive && fault.detail.contains(said), "{fault}");
    }
}

#[test]
fn folders_that_are_no_further_lights_are_refused_by_name() {
    for (folder, said) in [
        ("pan020_tilt06", "named like a view of a scan"),
        ("thumbs", "holds results"),
        ("Fused", "holds results"),
        ("target", "/v1/calibrations"),
        ("u v", "letters from a to z"),
        ("ultraviolett\u{e4}", "letters from a to z"),
        ("x=6", "letters from a to z"),
        ("uv.", "letters from a to z"),
        ("uv%2Fa", "letters from a to z"),
        ("a2345678901234567890123456789012_", "1 to 32 letters"),
    ] {
        let fault = refused(&in_folders(&["front", folder]));
        assert_eq!(fault.kind, ErrorKind::InvalidArchive, "{folder}");
        assert!(fault.detail.contains(folder) && fault.detail.contains(said), "{folder}: {}", fault.detail);
        assert!(fault.locations[0].file.as_deref().is_some_and(|file| file.starts_with(folder)), "{fault:?}");
    }
    let apart = refused(&pictures(&["front/1.png", "front/2.png", "uv/a/1.png", "uv/b/2.png"]));
    assert!(apart.detail.contains("further light uv are in several folders (uv/a, uv/b)"), "{apart}");
    let many: Vec<String> = (0..17).map(|k| format!("led_{k}")).collect();
    let many: Vec<&str> = std::iter::once("front").chain(many.iter().map(String::as_str)).collect();
    let fault = refused(&in_folders(&many));
    assert!(fault.detail.contains("17 folders") && fault.detail.contains("at most 16"), "{fault}");
    assert_eq!(open_bytes(&zip(&in_folders(&many[..17]))).unwrap().lights().len(), 16);
}

#[test]
fn without_a_folder_for_the_front_light_no_folder_is_a_further_light() {
    for names in
        [&["1.png", "2.png", "uv/1.png", "uv/2.png"][..], &["uv/1.png", "uv/2.png", "back/1.png", "back/2.png"]]
    {
        let fault = refused(&pictures(names));
        assert_eq!(fault.kind, ErrorKind::InvalidArchive);
        assert!(fault.detail.contains("uv") && fault.detail.contains("beside a folder front/"), "{fault}");
    }
}

#[test]
fn a_further_light_with_another_number_or_size_of_slices_is_refused() {
    let mut entries = in_folders(&["front", "uv"]);
    entries.push(entry("front/3.png", &png(3)));
    let fault = refused(&entries);
    assert_eq!(fault.kind, ErrorKind::SliceCountMismatch);
    assert!(fault.detail.contains("light uv has 2 slices and the front light 3"), "{fault}");
    assert!(fault.detail.contains("there is no uv slice for front/3.png"), "{fault}");
    assert!(fault.detail.contains("remove the folder"), "{fault}");

    let mut entries = in_folders(&["front", "uv"]);
    entries[2].data = png_of(&sized(30, 16, 1), &Metadata::default());
    entries[3].data = png_of(&sized(30, 16, 2), &Metadata::default());
    let fault = refused(&entries);
    assert_eq!((fault.kind, fault.locations[0].file.as_deref()), (ErrorKind::SizeMismatch, Some("uv/1.png")));
    assert!(fault.detail.contains("light uv have 30 x 16 px (uv/1.png), and the others 20 x 16 px"), "{fault}");
}

#[test]
fn a_further_light_counts_for_the_depth_and_the_size_of_the_stack() {
    let mut entries = in_folders(&["front", "uv"]);
    let sixteen = Raster::sixteen(20, 16, 3, (0..960).map(|at| at * 60).collect());
    entries[2].data = png_of(&sixteen, &Metadata::default());
    let archive = open_bytes(&zip(&entries)).unwrap();
    assert_eq!((archive.layout().bit_depth, archive.layout().channels), (16, 3));
    assert_eq!(archive.layout().largest_file_bytes, entries[2].data.len() as u64);
}
