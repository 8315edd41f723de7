//! Names alone, grouped before anything is zipped.

use super::*;

fn by_names(names: &[&str]) -> NameGrouping {
    let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
    group_names(&names, None, &ScanRules::default()).expect("a grouping")
}

#[test]
fn names_alone_are_grouped_as_their_zip() {
    for names in [
        &[
            "without_backlight/x=6/y=120/b.png",
            "without_backlight/x=6/y=120/a.png",
            "with_backlight/x=6/y=120/a.png",
            "with_backlight/x=6/y=120/b.png",
            "without_backlight/x=6/y=0/a.png",
            "without_backlight/x=6/y=0/b.png",
            "notes.txt",
            "calibration/1.png",
        ][..],
        &[
            "_x_00190_y_00000_step_00400_.png",
            "_x_00190_y_00000_step_-0400_.png",
            "_x_00190_y_00100_step_00400_.png",
            "_x_00190_y_00100_step_-0400_.png",
        ],
        &["s/a_1/1.png", "s/a_1/2.png", "s/a_1_back/1.png", "s/a_1_back/2.png", "s/b/1.png", "s/b/2.png"],
    ] {
        let (zip, alone) = (opened(names).expect("a scan"), by_names(names));
        let shown = |front: &Vec<String>, back: &Vec<String>| (front.clone(), back.clone());
        let of_zip: Vec<_> = zip.views().iter().map(|v| (v.angles(), shown(&v.front, &v.back))).collect();
        let of_names: Vec<_> = alone
            .views
            .iter()
            .map(|v| {
                (
                    v.pan_deg.zip(v.tilt_deg).map(|(pan_deg, tilt_deg)| ViewAngles { pan_deg, tilt_deg }),
                    shown(&v.front, &v.back),
                )
            })
            .collect();
        assert_eq!(of_names, of_zip);
        assert_eq!(alone.ignored, zip.ignored());
        assert!(alone.views.iter().all(|view| view.problem.is_none()), "{alone:?}");
    }
}

#[test]
fn a_view_that_is_not_complete_hides_no_other() {
    let names = [
        "day/bee/front/1.jpg",
        "day/bee/front/2.jpg",
        "day/bee/back/1.jpg",
        "day/bee/back/2.jpg",
        "day/ant/front/1.jpg",
        "day/fly/1.jpg",
        "day/fly/1.tif",
        "day/fly/2.jpg",
        "day/wasp/1.nef",
        "day/front/x/back/1.jpg",
        "day/fly/Thumbs.db",
    ];
    let grouping = by_names(&names);
    let problems: Vec<_> =
        grouping.views.iter().map(|view| (view.name.as_str(), view.problem.as_deref().unwrap_or(""))).collect();
    assert_eq!(problems[1], ("day/bee", ""));
    assert!(problems[0].0 == "day/ant" && problems[0].1.contains("one front-light slice"), "{problems:?}");
    assert!(problems[2].0 == "day/fly" && problems[2].1.contains("two formats"), "{problems:?}");
    let ignored: Vec<_> = grouping.ignored.iter().map(|file| file.name.as_str()).collect();
    assert_eq!(ignored, ["day/front/x/back/1.jpg", "day/wasp/1.nef"]);
}

#[test]
fn one_view_and_no_view_are_groupings_too() {
    let lone = by_names(&["pan020_tilt05/1.jpg", "pan020_tilt05/2.jpg"]);
    assert_eq!((lone.views[0].name.as_str(), lone.views[0].pan_deg), ("pan020_tilt05", Some(20.0)));
    let one = by_names(&["front/1.jpg", "front/2.jpg"]);
    assert_eq!((one.views[0].name.as_str(), one.views[0].front.len(), &one.views[0].problem), ("", 2, &None));
    assert!(by_names(&[]).views.is_empty());
    assert_eq!(by_names(&["a.txt"]).ignored.len(), 1);
}

#[test]
fn a_manifest_among_names_needs_its_content() {
    let names: Vec<String> = ["d/manifest.json", "d/1.jpg", "d/2.jpg", "d/3.jpg"].map(str::to_owned).into();
    let of = |listed: Option<&[u8]>| group_names(&names, listed, &ScanRules::default());
    assert!(of(None).expect_err("content").to_string().contains("content"));
    let listed = br#"{"views": [{"label": "side", "pan_deg": 20, "tilt_deg": 5, "front": ["2.jpg", "1.jpg"]}]}"#;
    let grouping = of(Some(listed)).expect("a grouping");
    assert_eq!(
        (grouping.views[0].front.as_slice(), grouping.views[0].pan_deg),
        (&names[1..3].iter().rev().cloned().collect::<Vec<_>>()[..], Some(20.0))
    );
    assert_eq!(grouping.ignored[0].name, "d/3.jpg");
    assert!(group_names(&names[1..], Some(listed), &ScanRules::default()).is_err());
    assert!(of(Some(br#"{"views": [{"front": ["9.jpg"]}]}"#)).is_err());
}

#[test]
fn hostile_names_are_refused_and_many_are_cheap() {
    for wrong in ["../1.jpg", "/1.jpg", "C:\\1.jpg", "a\u{0}.jpg", &"x".repeat(2000)] {
        assert!(group_names(&[wrong.to_owned()], None, &ScanRules::default()).is_err(), "{wrong}");
    }
    let same = ["a/1.jpg".to_owned(), "A\\1.JPG".to_owned()];
    assert!(group_names(&same, None, &ScanRules::default()).is_err());
    let many: Vec<String> = (0..60_000).map(|k| format!("{}/{}/{}.jpg", k % 7, k % 997, k)).collect();
    let slices: usize =
        group_names(&many, None, &ScanRules::default()).expect("views").views.iter().map(|v| v.front.len()).sum();
    assert_eq!(slices, 60_000);
}
