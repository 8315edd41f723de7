//! Zips with whole scans, as labs make them.

mod manifests;
mod names;

use std::{
    collections::BTreeMap,
    io::{Cursor, Write},
};

use proptest::prelude::*;
use zip::{CompressionMethod, ZipWriter, write::SimpleFileOptions};

use super::*;
use crate::{
    archive::{StackArchive, open},
    imaging::{Raster, codec},
    types::view::ViewAngles,
};

/// A small picture, different for each seed.
fn picture(seed: usize) -> Vec<u8> {
    let samples = (0..24 * 18).map(|i| ((i * 7 + seed * 31) % 251) as u8).collect();
    let mut out = Vec::new();
    codec::encode_png(&mut out, &Raster::eight(24, 18, 1, samples), &codec::Metadata::default()).expect("a PNG");
    out
}

fn zipped(members: &[(String, Vec<u8>)], method: CompressionMethod) -> tempfile::NamedTempFile {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in members {
        zip.start_file(name.as_str(), SimpleFileOptions::default().compression_method(method)).expect("a member");
        zip.write_all(bytes).expect("a member");
    }
    let mut file = tempfile::NamedTempFile::new().expect("a file");
    file.write_all(&zip.finish().expect("a zip").into_inner()).expect("written");
    file
}

fn pictures(names: &[&str]) -> Vec<(String, Vec<u8>)> {
    names.iter().enumerate().map(|(at, name)| ((*name).to_owned(), picture(at))).collect()
}

fn opened(names: &[&str]) -> Result<ScanArchive, Error> {
    grouped(&pictures(names), &ScanRules::default())
}

fn grouped(members: &[(String, Vec<u8>)], rules: &ScanRules) -> Result<ScanArchive, Error> {
    let file = zipped(members, CompressionMethod::Stored);
    open_scan(file.path(), &ArchiveLimits::scan(), rules)
}

/// Label, pan, tilt and numbers of slices of a view.
type Told<'a> = (Option<&'a str>, Option<f64>, Option<f64>, usize, usize);

fn told(scan: &ScanArchive) -> Vec<Told<'_>> {
    scan.views()
        .iter()
        .map(|view| (view.label.as_deref(), view.pan_deg, view.tilt_deg, view.front.len(), view.back.len()))
        .collect()
}

#[test]
fn a_folder_per_view_with_folders_of_the_lights() {
    let names: Vec<String> = ["pan020_tilt00", "pan000_tilt00", "head"]
        .iter()
        .flat_map(|view| {
            ["front", "Back"].iter().flat_map(move |light| (1..=3).map(move |k| format!("bee/{view}/{light}/{k}.png")))
        })
        .collect();
    let scan = opened(&names.iter().map(String::as_str).collect::<Vec<_>>()).expect("a scan");
    let expected =
        [(None, Some(0.0), Some(0.0), 3, 3), (None, Some(20.0), Some(0.0), 3, 3), (Some("head"), None, None, 3, 3)];
    assert_eq!(told(&scan), expected);
    assert_eq!(scan.views()[1].angles(), Some(ViewAngles { pan_deg: 20.0, tilt_deg: 0.0 }));
    assert_eq!(scan.views()[0].folder, "bee/pan000_tilt00/front");
    assert!(scan.ignored().is_empty() && scan.warnings().is_empty());
}

#[test]
fn two_parallel_trees_of_tilt_and_pan() {
    let names = [
        "without_backlight/x=6/y=120/b.png",
        "without_backlight/x=6/y=120/a.png",
        "without_backlight/x=-6/y=0/a.png",
        "without_backlight/x=-6/y=0/b.png",
        "with_backlight/x=6/y=120/a.png",
        "with_backlight/x=6/y=120/b.png",
        "with_backlight/x=-6/y=0/a.png",
        "with_backlight/x=-6/y=0/b.png",
    ];
    let scan = opened(&names).expect("a scan");
    assert_eq!(told(&scan), [(None, Some(0.0), Some(-6.0), 2, 2), (None, Some(120.0), Some(6.0), 2, 2)]);
}

#[test]
fn an_angle_that_all_views_have_is_read_from_the_folder_around_them() {
    let names = ["day/x=6/y=0/1.png", "day/x=6/y=0/2.png", "day/x=6/y=120/1.png", "day/x=6/y=120/2.png"];
    let scan = opened(&names).expect("a scan");
    assert_eq!(told(&scan), [(None, Some(0.0), Some(6.0), 2, 0), (None, Some(120.0), Some(6.0), 2, 0)]);
    // the name of a view wins over that of the folder
    let names = ["pan5/pan0/1.png", "pan5/pan0/2.png", "pan5/pan9/1.png", "pan5/pan9/2.png"];
    assert_eq!(opened(&names).expect("a scan").views()[1].pan_deg, Some(9.0));
}

#[test]
fn focus_steps_with_signs_in_one_folder() {
    let names = [
        "RAW/_x_00190_y_00000_step_00000_.png",
        "RAW/_x_00190_y_00000_step_-00400_.png",
        "RAW/_x_00190_y_00000_step_00400_.png",
        "RAW/_x_00190_y_00100_step_00000_.png",
        "RAW/_x_00190_y_00100_step_-00400_.png",
        "RAW/_x_00190_y_00100_step_00400_.png",
    ];
    let scan = opened(&names).expect("a scan");
    assert_eq!(told(&scan)[0], (Some("x_00190_y_00000"), None, None, 3, 0), "steps of a motor are no angles");
    assert_eq!(scan.views()[0].front, [names[1], names[0], names[2]]);
    let axis = |angle, per_unit| AxisRule { angle, degrees_per_unit: Some(per_unit), zero: 0.0 };
    let rules = ScanRules { x: axis(Angle::Tilt, 0.1), y: axis(Angle::Pan, 0.225) };
    let scan = grouped(&pictures(&names), &rules).expect("a scan");
    assert_eq!(told(&scan)[1], (None, Some(22.5), Some(19.0), 3, 0));
}

#[test]
fn names_of_other_programs() {
    for (names, labels) in [
        (
            ["scan01_001_fs03.png", "scan01_001_fs04.png", "scan01_002_fs03.png", "scan01_002_fs04.png"],
            ["scan01_001", "scan01_002"],
        ),
        (
            [
                "angle_001_focus_001.png",
                "angle_001_focus_002.png",
                "angle_002_focus_001.png",
                "angle_002_focus_002.png",
            ],
            ["angle_001", "angle_002"],
        ),
        (["a/1.png", "a/2.png", "b/1.png", "b/2.png"], ["a", "b"]),
    ] {
        let scan = opened(&names).expect(names[0]);
        let found: Vec<_> = scan.views().iter().filter_map(|view| view.label.as_deref()).collect();
        assert_eq!(found, labels);
    }
}

#[test]
fn a_back_light_beside_its_view_or_in_the_file_names() {
    let beside = [
        "s/v1/a.png",
        "s/v1/b.png",
        "s/v1_back/a.png",
        "s/v1_back/b.png",
        "s/v2/a.png",
        "s/v2/b.png",
        "s/v2_back/a.png",
        "s/v2_back/b.png",
    ];
    let in_names = [
        "view01_front_03.png",
        "view01_front_04.png",
        "view01_back_03.png",
        "view01_back_04.png",
        "view02_front_03.png",
        "view02_front_04.png",
        "view02_back_03.png",
        "view02_back_04.png",
    ];
    for names in [beside, in_names] {
        let scan = opened(&names).expect(names[0]);
        let counts: Vec<_> = told(&scan).iter().map(|view| (view.3, view.4)).collect();
        assert_eq!(counts, [(2, 2), (2, 2)], "{names:?}");
    }
}

#[test]
fn a_manifest_names_the_views_when_names_say_nothing() {
    let mut members = pictures(&["bee/3.png", "bee/1.png", "bee/2.png", "bee/4.png", "bee/5.png"]);
    let manifest = r#"{"views": [
        {"label": "side", "pan_deg": 20, "tilt_deg": -6.5, "front": ["3.png", "1.png"], "back": ["bee/2.png", "4.PNG"]}
    ]}"#;
    members.push(("bee/manifest.json".into(), manifest.into()));
    let scan = grouped(&members, &ScanRules::default()).expect("a scan");
    assert_eq!(told(&scan), [(Some("side"), Some(20.0), Some(-6.5), 2, 2)]);
    assert_eq!(scan.views()[0].front, ["bee/3.png", "bee/1.png"], "in the order of the list");
    assert_eq!(scan.ignored(), [Ignored { name: "bee/5.png".into(), reason: "not in the manifest".into() }]);
    let stack = written(&scan, 0);
    assert_eq!(stack.layout().front, ["front/3.png", "front/1.png"]);

    members[5].1 = br#"{"views": [{"front": ["3.png", "9.png"]}]}"#.to_vec();
    let error = grouped(&members, &ScanRules::default()).err().expect("9.png is missing");
    assert!(error.detail.contains("lists 9.png in view 1"), "{}", error.detail);
}

/// View `index` written to a zip of its own, and opened.
fn written(scan: &ScanArchive, index: usize) -> StackArchive {
    let mut bytes = Cursor::new(Vec::new());
    scan.write_view(index, &mut bytes).expect("written");
    let bytes = bytes.into_inner();
    assert!(bytes.len() as u64 <= scan.views()[index].bytes, "the bound holds");
    let mut file = tempfile::NamedTempFile::new().expect("a file");
    file.write_all(&bytes).expect("written");
    open(file.path(), &ArchiveLimits::default()).expect("a stack")
}

#[test]
fn the_zip_of_a_view_holds_its_slices_byte_by_byte() {
    let names = ["a/front/2.png", "a/front/10.png", "a/back/2.png", "a/back/10.png", "b/front/1.png", "b/front/2.png"];
    let members = pictures(&names);
    for method in [CompressionMethod::Stored, CompressionMethod::Deflated, CompressionMethod::Deflate64] {
        if method == CompressionMethod::Deflate64 {
            // the zip crate cannot write it
            continue;
        }
        let file = zipped(&members, method);
        let scan = open_scan(file.path(), &ArchiveLimits::scan(), &ScanRules::default()).expect("a scan");
        let stack = written(&scan, 0);
        assert_eq!(stack.layout().front, ["front/2.png", "front/10.png"]);
        assert_eq!(stack.layout().back, ["back/2.png", "back/10.png"]);
        for (index, expected) in [(0, &members[0].1), (1, &members[1].1)] {
            assert_eq!(&stack.front_bytes(index).expect("the bytes"), expected);
        }
        assert_eq!(written(&scan, 1).layout().back.len(), 0);
    }
}

#[test]
fn a_damaged_member_is_named_when_its_view_is_written() {
    let members = pictures(&["a/1.png", "a/2.png", "b/1.png", "b/2.png"]);
    let file = zipped(&members, CompressionMethod::Stored);
    let mut bytes = std::fs::read(file.path()).expect("read");
    let at = bytes.windows(members[2].1.len()).position(|part| part == members[2].1).expect("the member");
    bytes[at + 40] ^= 0xFF;
    std::fs::write(file.path(), bytes).expect("written");
    let scan = open_scan(file.path(), &ArchiveLimits::scan(), &ScanRules::default()).expect("its directory is sound");
    assert!(scan.write_view(0, Cursor::new(Vec::new())).is_ok());
    let error = scan.write_view(1, Cursor::new(Vec::new())).expect_err("the CRC differs");
    assert_eq!(error.kind, ErrorKind::InvalidArchive);
    assert!(error.detail.contains("b/1.png"), "{}", error.detail);
}

#[test]
fn what_is_wrong_is_told_with_the_view() {
    let refused = |names: &[&str]| {
        let error = opened(names).err().unwrap_or_else(|| panic!("{names:?} is accepted"));
        (error.kind, error.detail)
    };
    let (kind, detail) = refused(&["front/1.png", "front/2.png", "back/1.png", "back/2.png"]);
    assert!(kind == ErrorKind::InvalidArchive && detail.contains("/v1/stacks"), "{detail}");
    let (kind, detail) = refused(&["a/1.png", "a/2.png", "b/1.png"]);
    assert!(kind == ErrorKind::SliceCountMismatch && detail.starts_with("b has one front-light slice"), "{detail}");
    let (_, detail) = refused(&["a/front/1.png", "a/front/2.png", "a/back/1.png", "b/1.png", "b/2.png"]);
    assert!(detail.starts_with("a has 2 front-light slices and 1 back-light slice; both need"), "{detail}");
    let (kind, detail) =
        refused(&["pan020_tilt0/1.png", "pan020_tilt0/2.png", "pan20_tilt00/1.png", "pan20_tilt00/2.png"]);
    assert!(kind == ErrorKind::InvalidArchive && detail.contains("pan020_tilt0 and pan20_tilt00"), "{detail}");
    let (_, detail) = refused(&["stacked/1.png", "stacked/2.png"]);
    assert!(detail.contains("folders of results"), "{detail}");
    assert!(
        opened(&["a/1.png", "a/2.png", "b/1.png", "b/2.png", "b/3.png"]).expect("a scan").warnings()[0].code
            == "views_differ"
    );
}

#[test]
fn results_and_other_files_are_ignored_with_the_reason() {
    let mut members =
        pictures(&["a/1.png", "a/2.png", "b/1.png", "b/2.png", "stacked/a.png", "Thumbs.db", "__MACOSX/a/._1.png"]);
    members.push(("notes.txt".into(), b"x".to_vec()));
    let scan = grouped(&members, &ScanRules::default()).expect("a scan");
    let ignored: BTreeMap<&str, &str> = scan.ignored().iter().map(|i| (i.name.as_str(), i.reason.as_str())).collect();
    assert_eq!(ignored.keys().copied().collect::<Vec<_>>(), ["notes.txt", "stacked/a.png"]);
    assert_eq!(scan.views().len(), 2);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    /// Whatever the names are, each picture is in one view or among the ignored ones.
    #[test]
    fn no_picture_is_lost_or_doubled(
        names in prop::collection::btree_set("(v[0-9]/)?(front/|back/|x=[0-3]/)?([ab]_)?(focus_)?[0-9]{1,3}", 1..24)
    ) {
        let members: Vec<_> = names.iter().map(|name| (format!("{name}.png"), Vec::new())).collect();
        let Ok(scan) = grouped(&members, &ScanRules::default()) else { return Ok(()) };
        let mut seen: Vec<String> = scan.views().iter().flat_map(|v| v.front.iter().chain(&v.back)).cloned().collect();
        seen.extend(scan.ignored().iter().map(|file| file.name.clone()));
        seen.sort();
        let mut all: Vec<String> = members.into_iter().map(|(name, _)| name).collect();
        all.sort();
        prop_assert_eq!(seen, all);
    }
}
