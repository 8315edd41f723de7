//! What README.txt says.

use super::*;

#[test]
fn images_that_the_program_cannot_open_are_told() {
    let mut scan = scan();
    let told = |scan: &BundleScan, layout| {
        let entries = plan(layout, scan).expect("a bundle");
        texts(&entries)["README.txt"].contains("cannot open")
    };
    assert!(Layout::ALL.into_iter().all(|layout| !told(&scan, layout)), "images of 8 bits suit all programs");
    scan.views[2].bit_depth = 16;
    let cannot: Vec<Layout> = Layout::ALL.into_iter().filter(|layout| told(&scan, *layout)).collect();
    assert_eq!(cannot, [Layout::Colmap, Layout::Openmvg]);
    let entries = plan(Layout::Colmap, &scan).expect("a bundle");
    let readme = texts(&entries)["README.txt"];
    assert!(readme.contains("1 view has 16 bits per sample") && readme.contains("{\"bit_depth\": 8}"), "{readme}");
}

#[test]
fn a_readme_tells_of_masks_only_if_there_are_some() {
    let readme = |layout, change: fn(&mut BundleScan)| {
        let mut scan = scan();
        change(&mut scan);
        let entries = plan(layout, &scan).expect("a bundle");
        texts(&entries)["README.txt"].to_owned()
    };
    let bare = |scan: &mut BundleScan| scan.views.iter_mut().for_each(|view| view.has_mask = false);
    let blind = |scan: &mut BundleScan| {
        scan.views.iter_mut().for_each(|view| view.has_mask = false);
        scan.intrinsics = None;
    };
    for layout in [Layout::Metashape, Layout::Meshroom] {
        let whole = readme(layout, |scan| scan.views[1].has_mask = false);
        let word = if layout == Layout::Metashape { "Import Masks" } else { "masksFolder=" };
        assert!(whole.contains(word), "{whole}");
        for change in [bare as fn(&mut BundleScan), blind] {
            let text = readme(layout, change);
            assert!(text.contains("There are no masks"), "{text}");
            assert!(["Import Masks", "Apply masks", "masksFolder"].iter().all(|word| !text.contains(word)), "{text}");
        }
    }
    let steps =
        |text: &str| text.lines().filter_map(|line| line.split_once(". ")?.0.parse().ok()).collect::<Vec<u32>>();
    assert_eq!(steps(&readme(Layout::Metashape, |_| {})), [1, 2, 3, 4, 5]);
    assert_eq!(steps(&readme(Layout::Metashape, bare)), [1, 2, 3, 4]);
    assert_eq!(steps(&readme(Layout::Metashape, blind)), [1, 2, 3]);
    assert!(readme(Layout::Meshroom, bare).contains("--output mesh\n\nThe node CameraInit"));
}

#[test]
fn nerfstudio_gets_masks_for_all_frames_or_for_none() {
    let mut scan = scan();
    let frames_with_mask = |scan: &BundleScan| {
        let entries = plan(Layout::Nerfstudio, scan).expect("a bundle");
        let transforms: serde_json::Value = serde_json::from_str(texts(&entries)["transforms.json"]).expect("JSON");
        let frames = transforms["frames"].as_array().expect("frames");
        frames.iter().filter(|frame| frame.get("mask_path").is_some()).count()
    };
    assert_eq!(frames_with_mask(&scan), 4);
    scan.views[2].has_mask = false;
    assert_eq!(frames_with_mask(&scan), 0, "nerfstudio stops when some frames have none");
    for layout in [Layout::Nerfstudio, Layout::Colmap] {
        let entries = plan(layout, &scan).expect("a bundle");
        assert!(texts(&entries)["README.txt"].contains("1 view has no mask"), "{layout:?}");
    }
}

#[test]
fn without_a_camera_openmvg_lists_the_images_itself() {
    let scan = BundleScan { intrinsics: None, ..scan() };
    let entries = plan(Layout::Openmvg, &scan).expect("a bundle");
    let readme = texts(&entries)["README.txt"];
    assert!(readme.contains("openMVG_main_SfMInit_ImageListing -i images -o matches -f 972\n"), "{readme}");
    assert!(readme.contains("-i matches/sfm_data.json") && !readme.contains("refine_intrinsic_config"), "{readme}");
}

#[test]
fn a_focal_length_is_fixed_only_if_it_is_known_to_half_a_percent() {
    let with = |layout, sigma| {
        let mut scan = scan();
        let camera = scan.intrinsics.as_mut().expect("known");
        camera.principal_distance_sigma_mm = sigma;
        plan(layout, &scan).expect("a bundle")
    };
    // the file, and what it holds with a fixed focal length and with a start
    for (layout, file, fixed, start) in [
        (Layout::Colmap, "README.txt", "ba_refine_focal_length 0", "ba_refine_focal_length 1"),
        (Layout::Metashape, "README.txt", "fix all parameters", "fix all but f"),
        (Layout::Meshroom, "cameras.sfm", "\"scaleLocked\": \"1\"", "\"scaleLocked\": \"0\""),
        (
            Layout::Realitycapture,
            "images/pan000_tilt00.xmp",
            "CalibrationPrior=\"exact\"",
            "CalibrationPrior=\"initial\"",
        ),
        (Layout::Odm, "README.txt", "scan --use-fixed-camera-params\n", "scan\n"),
        (Layout::Openmvg, "README.txt", "refine_intrinsic_config NONE", "refine_intrinsic_config ADJUST_FOCAL_LENGTH"),
        (Layout::Nerfstudio, "README.txt", "Keep these values fixed", "nerfstudio does not refine"),
    ] {
        for (sigma, is_fixed) in [(Some(0.6), true), (Some(0.61), false), (Some(12.0), false), (None, false)] {
            let entries = with(layout, sigma);
            let files = texts(&entries);
            let (word, other) = if is_fixed { (fixed, start) } else { (start, fixed) };
            assert!(
                files[file].contains(word) && !files[file].contains(other),
                "{layout:?} {sigma:?}: {}",
                files[file]
            );
            let readme = files["README.txt"];
            assert_eq!(readme.contains("Keep these values fixed"), is_fixed, "{layout:?} {sigma:?}: {readme}");
            assert_eq!(readme.contains("it is a start"), !is_fixed, "{layout:?} {sigma:?}: {readme}");
        }
    }
}
