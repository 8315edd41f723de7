//! The order of slices by the names that cameras, programs and people give them, and by their times of capture.

use proptest::prelude::*;

use super::*;
use crate::{archive::slice_order::settle, imaging::codec::CaptureTime};

/// The order of `names` without times, and the codes of the warnings.
fn ordered(names: &[&str]) -> (Vec<String>, Vec<String>) {
    let none = vec![None; names.len()];
    timed(names, &none)
}

/// The order of `names` that were taken at `times`, and the codes of the warnings.
fn timed(names: &[&str], times: &[Option<u64>]) -> (Vec<String>, Vec<String>) {
    // they come in another order than they are to be in
    let mut sent: Vec<(&str, Option<u64>)> = names.iter().copied().zip(times.iter().copied()).collect();
    sent.sort_by_key(|(name, _)| name.bytes().fold(7u32, |hash, byte| hash.wrapping_mul(31) ^ u32::from(byte)));
    let all: Vec<String> = sent.iter().map(|(name, _)| format!("front/{name}")).collect();
    let times: Vec<Option<CaptureTime>> = sent.iter().map(|(_, time)| time.map(CaptureTime)).collect();
    let settled = settle(&all, &times, false);
    let names = settled.order.iter().map(|&at| sent[at].0.to_owned()).collect();
    (names, settled.warnings.iter().map(|warning| warning.code.as_str().to_owned()).collect())
}

/// Names in the order in which they were taken, of which nothing is said.
const PLAIN: &[&[&str]] = &[
    &["img_1.jpg", "img_2.jpg", "img_10.jpg"],
    &["_x_1_step_-08000_.jpg", "_x_1_step_-00400_.jpg", "_x_1_step_00000_.jpg", "_x_1_step_00400_.jpg"],
    &["IMG-0001.jpg", "img-0002.JPG", "IMG-0010.jpg"],
    &["DSC_0001.JPG", "DSC_0002.JPG", "DSC_0010.JPG"],
    &["f99999999999999999999.png", "f100000000000000000000.png"],
    &["2024-01-02_5.jpg", "2024-01-10_1.jpg"],
    &["2024.01.02_5.jpg", "2024.01.10_1.jpg", "2024.10.02_1.jpg"],
    &["20240102-101500-9.jpg", "20240102-101500-10.jpg"],
    &["angle_001_focus_001.tiff", "angle_001_focus_002.tiff", "angle_002_focus_001.tiff"],
    &["a.jpg", "a1.jpg", "b.jpg"],
    &["-2.jpg", "-1.jpg", "0.jpg", "1.jpg"],
    &["v1.8.jpg", "v1.9.jpg", "v1.10.jpg", "v1.11.jpg"],
    &["v1.9.jpg", "v1.10.jpg"],
    &["v1.2.9.jpg", "v1.2.10.jpg", "v1.10.1.jpg"],
    &["2.1.jpg", "2.2.jpg", "2.10.jpg", "10.1.jpg", "10.2.jpg"],
    &["s1p8.jpg", "s1p9.jpg", "s1p10.jpg", "s2p1.jpg"],
    // decimals
    &["z0.jpg", "z0.25.jpg", "z0.5.jpg", "z0.75.jpg", "z1.0.jpg", "z1.25.jpg"],
    &["z0,5.jpg", "z0,75.jpg", "z1,0.jpg", "z1,25.jpg"],
    &["z0p25.jpg", "z0p5.jpg", "z0p75.jpg", "z1p0.jpg"],
    &["bee_1.125mm.jpg", "bee_1.25mm.jpg", "bee_1.5mm.jpg", "bee_1.75mm.jpg"],
    &["0.05.jpg", "0.1.jpg", "0.15.jpg", "0.2.jpg"],
    &["9.5 mm.jpg", "9.75 mm.jpg", "10 mm.jpg", "10.25 mm.jpg"],
    &["z0.13.jpg", "z0.5.jpg", "z0.77.jpg", "z1.2.jpg"],
    &["IMG-0001_z0.125.jpg", "IMG-0002_z0.25.jpg", "IMG-0003_z0.5.jpg"],
    // signs
    &["z-4.jpg", "z-3.jpg", "z-2.jpg", "z-1.jpg", "z0.jpg", "z1.jpg", "z2.jpg"],
    &["focus -2.jpg", "focus -1.jpg", "focus 0.jpg", "focus 1.jpg"],
    &["z-2.jpg", "z-1.jpg", "z+0.jpg", "z+1.jpg", "z+2.jpg"],
    &["z--2.jpg", "z--1.jpg", "z-0.jpg", "z-1.jpg"],
    &["z(-2).jpg", "z(-1).jpg", "z(0).jpg", "z(1).jpg"],
    &["z\u{2212}2.jpg", "z\u{2212}1.jpg", "z0.jpg", "z1.jpg"],
    &["z_-0.75.jpg", "z_-0.5.jpg", "z_-0.25.jpg", "z_0.0.jpg", "z_0.25.jpg"],
    &["z-0.75.jpg", "z-0.5.jpg", "z-0.25.jpg", "z0.jpg", "z0.25.jpg"],
    &["IMG-0003_z-1.jpg", "IMG-0003_z0.jpg", "IMG-0003_z1.jpg"],
    &["IMG-0001_z-1.jpg", "IMG-0002_z0.jpg", "IMG-0003_z1.jpg"],
    // letters in two normal forms
    &["Käfer_1.jpg", "Ka\u{308}fer_2.jpg", "Käfer_3.jpg", "Ka\u{308}fer_10.jpg"],
    // numbers with gaps that no counter leaves
    &["s_0001.jpg", "s_4000.jpg", "s_8000.jpg", "s_9999.jpg"],
    &["IMG_0001.JPG", "IMG_0002.JPG", "IMG_5300.JPG"],
    &["z_00001.jpg", "z_50000.jpg", "z_99999.jpg"],
    &["f0.jpg", "f50.jpg", "f99.jpg"],
    &["f00.jpg", "f10.jpg", "f20.jpg", "f90.jpg", "f99.jpg"],
    &["a_0001.jpg", "b_9999.jpg"],
    &["IMG_1001.jpg", "IMG_1002.jpg", "IMG_1098.jpg", "IMG_1099.jpg"],
    &["P1000998.jpg", "P1000999.jpg", "P1010001.jpg"],
    &["IMG_9999.jpg", "IMG_10000.jpg"],
    // no copies
    &["IMG (1).jpg", "IMG (2).jpg", "IMG (3).jpg", "IMG (10).jpg"],
    &["bee (8).jpg", "bee (9).jpg", "bee (10).jpg"],
    &["capture.jpg", "capture (1).jpg", "capture (2).jpg", "capture (3).jpg"],
    &["bee 1.jpg", "bee 2.jpg", "bee 3.jpg"],
    &["1-edit.jpg", "2-edit.jpg", "3-edit.jpg"],
];

/// The same of counters that started again.
const RESTARTED: &[&[&str]] = &[
    &["IMG_9998.JPG", "IMG_9999.JPG", "IMG_0001.JPG", "IMG_0002.JPG"],
    &["DSC09997.JPG", "DSC09998.JPG", "DSC09999.JPG", "DSC00001.JPG", "DSC00002.JPG"],
    &["P1009998.JPG", "P1009999.JPG", "P1000001.JPG", "P1000002.JPG"],
    &["P2309999.JPG", "P2300001.JPG"],
    &["cam_99998.png", "cam_99999.png", "cam_00000.png", "cam_00001.png"],
    &["shot997.png", "shot998.png", "shot999.png", "shot000.png", "shot001.png"],
    &["P100998.png", "P100999.png", "P100000.png", "P100001.png"],
    &["s98.png", "s99.png", "s00.png", "s01.png"],
    &["DSC_9998_bee.png", "DSC_9999_bee.png", "DSC_0001_bee.png"],
    &["2026-11-28_9998_x1.png", "2026-11-28_9999_x1.png", "2026-11-28_0001_x1.png"],
    &["9998.png", "9999.png", "1.png", "2.png"],
    // the pictures in between belong to the back light
    &["IMG_9994.JPG", "IMG_9996.JPG", "IMG_9998.JPG", "IMG_0001.JPG", "IMG_0003.JPG"],
    &["9999999.png", "0000000.png", "0000001.png"],
];

#[test]
fn names_that_tell_their_order_are_in_this_order_and_nothing_is_said() {
    for names in PLAIN {
        assert_eq!(ordered(names), (names.iter().map(|name| (*name).to_owned()).collect(), Vec::new()));
    }
}

#[test]
fn a_counter_that_started_again_is_followed_and_told() {
    for names in RESTARTED {
        let expected: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
        assert_eq!(ordered(names), (expected, vec!["counter_rollover".to_owned()]));
    }
    let names = ["DSC09998.JPG", "DSC09999.JPG", "DSC09999 (1).JPG", "DSC00001.JPG", "DSC00002.JPG"];
    let (order, warnings) = ordered(&names);
    assert_eq!(order, names, "a copy hides no counter");
    assert_eq!(warnings, ["counter_rollover", "copied_file_name"]);
}

#[test]
fn the_times_decide_where_names_are_ambiguous() {
    let with = |names: &[&str], times: &[u64]| timed(names, &times.iter().map(|&time| Some(time)).collect::<Vec<_>>());
    // a counter that started again far from its ends
    let far = ["IMG_9600.JPG", "IMG_9601.JPG", "IMG_0300.JPG", "IMG_0301.JPG"];
    assert_eq!(with(&far, &[1, 2, 3, 4]), (far.map(String::from).into(), vec!["counter_rollover".to_owned()]));
    assert_eq!(with(&far, &[4, 3, 2, 1]).0, far, "taken from its last slice to its first");
    // a clock at midnight
    let clock = ["t_235958.jpg", "t_235959.jpg", "t_000001.jpg", "t_000002.jpg"];
    assert_eq!(with(&clock, &[1, 2, 3, 4]).0, clock);
    // one that did not start again, whatever it looks like
    let sorted = ["IMG_0001.JPG", "IMG_0002.JPG", "IMG_9998.JPG", "IMG_9999.JPG"];
    assert_eq!(with(&sorted, &[1, 2, 3, 4]), (sorted.map(String::from).into(), vec!["counter_rollover".to_owned()]));
    // equal times decide nothing
    assert_eq!(with(RESTARTED[0], &[5, 5, 5, 5]).0, RESTARTED[0]);
    // points
    let parts = ["1.5.jpg", "1.7.jpg", "1.9.jpg", "1.11.jpg", "1.13.jpg"];
    assert_eq!(with(&parts, &[1, 2, 3, 4, 5]), (parts.map(String::from).into(), vec![]));
    let values = ["1.11.jpg", "1.13.jpg", "1.5.jpg", "1.7.jpg", "1.9.jpg"];
    assert_eq!(with(&values, &[1, 2, 3, 4, 5]), (values.map(String::from).into(), vec![]));
}

#[test]
fn plain_names_are_kept_when_the_times_contradict_them_and_it_is_said() {
    let names = ["s1.jpg", "s2.jpg", "s3.jpg", "s4.jpg"];
    let told = vec!["order_contradicts_times".to_owned()];
    for times in [[1, 2, 4, 3], [3, 4, 1, 2], [4, 3, 1, 2]] {
        assert_eq!(timed(&names, &times.map(Some)), (names.map(String::from).into(), told.clone()), "{times:?}");
    }
    // times of some slices are enough to contradict
    assert_eq!(timed(&names, &[Some(5), None, Some(9), Some(7)]).1, told);
    assert_eq!(timed(&names, &[Some(5), None, None, Some(7)]).1, [""; 0]);
    let rotated = timed(RESTARTED[0], &[Some(1), Some(3), Some(2), Some(4)]);
    assert_eq!(rotated.1, ["counter_rollover", "order_contradicts_times"]);
}

/// The last name is the copy.
#[test]
fn copies_and_edits_are_named() {
    for names in [
        &["IMG_0001.JPG", "IMG_0002.JPG", "IMG_0001 (2).JPG"][..],
        &["IMG_1.png", "IMG_3.png", "IMG_2 (2).png"],
        &["1.jpg", "2.jpg", "1 - Copy.jpg"],
        &["1.jpg", "2.jpg", "1 - Kopie (2).jpg"],
        &["1.jpg", "2.jpg", "1 copy 2.jpg"],
        &["1.jpg", "2.jpg", "Copy of 1.jpg"],
        &["1.jpg", "2.jpg", "Kopie von 1.jpg"],
        &["1.jpg", "2.jpg", "2.sync-conflict-20240101-101010-ABCDEFG.jpg"],
        &["1.jpg", "2.jpg", "2 (conflicted copy 2024-01-01 101010).jpg"],
        &["1.jpg", "2.jpg", "2 (lab-pc's conflicted copy 2024-01-01).jpg"],
        &["1.jpg", "2.jpg", "2 (In Konflikt stehende Kopie von lab 2024-01-01).jpg"],
        &["1.jpg", "3.jpg", "2_lab-pc_Jan-01-101010-2024_Conflict.jpg"],
        &["1.jpg", "2.jpg", "2_conflict-20240101-101010.jpg"],
        &["1.jpg", "2.jpg", "2 (SFConflict a@b.c 2024-01-01-10-10-10).jpg"],
        &["IMG_2001.JPG", "IMG_2002.JPG", "IMG_E2002.JPG"],
        &["a_1.tif", "a_2.tif", "a_2-Edit.tif"],
        &["a_1.tif", "a_2.tif", "a_2-Edit-2.tif"],
        &["a_1.jpg", "a_2.jpg", "a_2-bearbeitet.jpg"],
        &["a_1.jpg", "a_2.jpg", "a_2 (edited).jpg"],
        &["a_1.jpg", "a_2.jpg", "a_2~2.jpg"],
        &["a_1.jpg", "a_2.jpg", "a_2(1).jpg"],
        &["a_1.jpg", "a_2.jpg", "a_2 2.jpg"],
        &["Käfer_1.jpg", "Käfer_2.jpg", "Ka\u{308}fer_2 (2).jpg"],
    ] {
        let all: Vec<String> = names.iter().map(|name| format!("front/{name}")).collect();
        assert_eq!(copies(&all), [all.last().unwrap().as_str()], "{names:?}");
        assert_eq!(ordered(names).1, ["copied_file_name"], "{names:?}");
    }
    let pairs = ["1.jpg", "1 copy.jpg", "2.jpg", "2 copy.jpg"].map(String::from);
    assert_eq!(copies(&pairs), ["1 copy.jpg", "2 copy.jpg"]);
}

#[test]
fn a_picture_that_is_named_unlike_all_slices_is_told() {
    for names in [
        &["IMG_1.jpg", "IMG_2.jpg", "IMG_3.jpg", "output.jpg"][..],
        &["IMG_1.jpg", "IMG_2.jpg", "IMG_3.jpg", "ZS PMax.jpg"],
        &["z-0.5.tif", "z0.tif", "z0,5.tif", "2024-01-01 (A,Radius8,Smoothing4).tif"],
        &["_DSC0009.jpg", "_DSC0010.jpg", "_DSC0011.jpg", "DSC0008 stacked.jpg"],
    ] {
        let all: Vec<String> = names.iter().map(|name| format!("front/{name}")).collect();
        let odd = all.last().unwrap();
        assert_eq!(copies(&all), [odd.as_str()], "{names:?}");
        assert!(copied(&all).is_some_and(|clause| clause.starts_with(&format!("{odd} is named unlike"))), "{names:?}");
        assert_eq!(ordered(names).1, ["copied_file_name"], "{names:?}");
    }
    for names in [
        // a series that begins without a number
        &["a.jpg", "a (1).jpg", "a (2).jpg", "a (3).jpg"][..],
        &["burst.jpg", "burst_1.jpg", "burst_2.jpg", "burst_3.jpg"],
        &["z-1.jpg", "z0.jpg", "z1.jpg", "z1.5.jpg"],
        // too few, or no series
        &["IMG_1.jpg", "IMG_2.jpg", "near.jpg"],
        &["near.jpg", "middle.jpg", "far.jpg", "end.jpg"],
        &["IMG_1.jpg", "IMG_2.jpg", "IMG_3.jpg", "x.jpg", "y.jpg"],
    ] {
        let all: Vec<String> = names.iter().map(|name| format!("front/{name}")).collect();
        assert_eq!(copies(&all), [""; 0], "{names:?}");
    }
}

#[test]
fn a_stack_in_a_zip_is_in_the_order_of_its_names_and_times() {
    let archive = opened(&["front/z0.5.png", "front/z0.25.png", "front/z-0.5.png", "front/z0.png"]);
    assert_eq!(archive.layout().front, ["front/z-0.5.png", "front/z0.png", "front/z0.25.png", "front/z0.5.png"]);
    assert_eq!(archive.overruled_order(), None);
    // far from the ends of the counter, so that only the times tell
    let names = ["IMG_9600.png", "IMG_9601.png", "IMG_0300.png"];
    let entries: Vec<Entry> = (1..).zip(names).map(|(second, name)| entry(name, &taken_at(second))).collect();
    let archive = open_bytes(&zip(&entries)).unwrap();
    assert_eq!(archive.layout().front, names);
    assert_eq!(archive.warnings()[0].code, "counter_rollover");
    let expected = "the camera's counter started again within the stack: IMG_0300.png is taken to follow IMG_9601.png";
    assert_eq!(archive.warnings()[0].detail, expected);
    assert_eq!(archive.front().load(2).unwrap(), raster(3));

    let entries: Vec<Entry> = [1, 3, 2].iter().map(|&s| entry(&format!("s{s}.png"), &taken_at(9 - s / 2))).collect();
    assert_eq!(open_bytes(&zip(&entries)).unwrap().overruled_order(), None, "equal times are in order");
    let times = [("a1.png", 1), ("a2.png", 4), ("a3.png", 2), ("a4.png", 5)];
    let entries: Vec<Entry> = times.iter().map(|&(name, second)| entry(name, &taken_at(second))).collect();
    let archive = open_bytes(&zip(&entries)).unwrap();
    assert_eq!(archive.overruled_order(), Some(&[0, 2, 1, 3][..]));
    assert_eq!(archive.reversed().overruled_order(), Some(&[3, 1, 2, 0][..]));
    // the times decide, and the names are kept for the pictures to judge
    let names = ["IMG_0001.png", "IMG_0002.png", "IMG_9998.png", "IMG_9999.png"];
    let entries: Vec<Entry> = (1..).zip(names).map(|(second, name)| entry(name, &taken_at(second))).collect();
    let archive = open_bytes(&zip(&entries)).unwrap();
    assert_eq!(
        (&archive.layout().front[..], archive.overruled_order()),
        (&names.map(String::from)[..], Some(&[2, 3, 0, 1][..]))
    );
    let expected = "by the names the camera's counter started again after IMG_9999.png, but by the EXIF times \
                    IMG_0001.png was taken earlier: the times give the order";
    assert!(archive.warnings()[0].detail.starts_with(expected), "{}", archive.warnings()[0].detail);
}

#[test]
fn the_time_of_a_tiff_is_that_of_its_exif_data_or_its_own() {
    use ::tiff::tags::Tag;
    let tiff = |second: u8, in_exif: bool| {
        let mut out = std::io::Cursor::new(Vec::new());
        let mut encoder = ::tiff::encoder::TiffEncoder::new(&mut out).unwrap();
        let exif = in_exif.then(|| {
            let mut directory = encoder.extra_directory().unwrap();
            let text = format!("2026:05:01 10:00:{second:02}");
            directory.write_tag(Tag::Unknown(0x9003), text.as_str()).unwrap();
            directory.finish_with_offsets().unwrap()
        });
        let mut image = encoder.new_image::<::tiff::encoder::colortype::Gray8>(20, 16).unwrap();
        match exif {
            Some(exif) => {
                image.encoder().write_tag(Tag::ExifDirectory, exif.offset).unwrap();
                // when the file was written, in the reverse order
                let text = format!("2026:06:01 10:00:{:02}", 50 - second);
                image.encoder().write_tag(Tag::DateTime, text.as_str()).unwrap();
            }
            None => {
                let text = format!("2026:05:01 10:00:{second:02}");
                image.encoder().write_tag(Tag::DateTime, text.as_str()).unwrap();
            }
        }
        image.write_data(&[second; 320]).unwrap();
        out.into_inner()
    };
    for in_exif in [true, false] {
        let names = ["P1009600.tif", "P1009601.tif", "P1000300.tif"];
        let entries: Vec<Entry> = (1..).zip(names).map(|(second, name)| entry(name, &tiff(second, in_exif))).collect();
        let archive = open_bytes(&zip(&entries)).unwrap();
        assert_eq!(archive.layout().front, names);
        assert_eq!(archive.warnings()[0].code, "counter_rollover");
        let far: Vec<Entry> = [1, 3, 2].iter().map(|&s| entry(&format!("s{s}.tif"), &tiff(9 - s, in_exif))).collect();
        assert_eq!(open_bytes(&zip(&far)).unwrap().warnings(), []);
    }
}

proptest! {
    #[test]
    fn the_order_does_not_depend_on_the_order_of_the_zip(
        names in proptest::collection::btree_set("[-_+a1B09 .,pä\u{308}]{0,9}", 2..9),
        shift in 0usize..8,
        times in proptest::collection::vec(proptest::option::of(0u64..4), 8),
    ) {
        let names: Vec<String> = names.into_iter().map(|name| format!("{name}.jpg")).collect();
        let settled = |names: &[String], times: &[Option<u64>]| -> (Vec<String>, usize) {
            let times: Vec<Option<CaptureTime>> = times.iter().map(|time| time.map(CaptureTime)).collect();
            let settled = settle(names, &times, false);
            let mut places = settled.order.clone();
            places.sort_unstable();
            assert!(places.into_iter().eq(0..names.len()), "every slice once");
            (settled.order.iter().map(|&at| names[at].clone()).collect(), settled.warnings.len())
        };
        let times = &times[..names.len()];
        let expected = settled(&names, times);
        let (mut turned, mut turned_times) = (names.clone(), times.to_vec());
        turned.rotate_left(shift % names.len());
        turned_times.rotate_left(shift % names.len());
        assert_eq!(settled(&turned, &turned_times), expected);
        turned.reverse();
        turned_times.reverse();
        assert_eq!(settled(&turned, &turned_times), expected);
    }

    #[test]
    fn a_run_of_a_camera_is_in_its_order_wherever_it_begins(
        start in 1u32..10_000, count in 2u32..30,
        (prefix, width) in prop_oneof![Just(("IMG_", 4)), Just(("DSC", 5)), Just(("P100", 4)), Just(("DSC-", 4))],
    ) {
        let number = |k: u32| (start - 1 + k) % 9_999 + 1;
        let names: Vec<String> = (0..count).map(|k| format!("{prefix}{:0width$}.JPG", number(k))).collect();
        let shown: Vec<&str> = names.iter().map(String::as_str).collect();
        let (order, warnings) = ordered(&shown);
        assert_eq!(order, names);
        let restarts = start + count - 1 > 9_999;
        assert_eq!(warnings, vec!["counter_rollover"; usize::from(restarts)]);
    }

    #[test]
    fn positions_are_in_the_order_of_their_values(
        first in -40i32..40, count in 2i32..30, step in prop_oneof![Just(1), Just(5), Just(25), Just(125)],
        point in prop_oneof![Just('.'), Just(',')],
    ) {
        let name = |k: i32| {
            let value = f64::from((first + k) * step) / 1000.0;
            format!("bee z_{value}.jpg").replace(&format!("{value}"), &format!("{value}").replace('.', &point.to_string()))
        };
        let names: Vec<String> = (0..count).map(name).collect();
        let shown: Vec<&str> = names.iter().map(String::as_str).collect();
        assert_eq!(ordered(&shown).0, names);
    }
}
