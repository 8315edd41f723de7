//! Every layout, read back by a reader of its own: a point of the world must appear at the same pixel through the
//! camera and the pose of each file.

mod readers;
mod readmes;

use std::collections::HashMap;

use super::*;
use crate::types::{
    intrinsics::{ImageDistortion, Intrinsics},
    view::ViewAngles,
};
use readers::READERS;

const WIDTH: u32 = 810;
const HEIGHT: u32 = 540;

fn scan() -> BundleScan {
    let view = |pan_deg: f64, tilt_deg: f64| {
        let angles = ViewAngles { pan_deg, tilt_deg };
        BundleView {
            stem: angles.file_stem(),
            extension: "png".into(),
            bit_depth: 8,
            has_mask: true,
            angles: Some(angles),
        }
    };
    let views = [(0.0, 0.0), (20.0, 0.0), (340.0, 12.0), (130.0, -33.0)].map(|(pan, tilt)| view(pan, tilt));
    BundleScan {
        name: "bee-42".into(),
        width: WIDTH,
        height: HEIGHT,
        intrinsics: Some(Intrinsics {
            principal_distance_px: 2712.5,
            principal_distance_mm: 120.55,
            principal_distance_sigma_mm: Some(0.3),
            pixel_pitch_mm: 0.044_442_4,
            principal_point_px: Some([401.25, 271.75]),
            distortion: None,
        }),
        canvas_centre_px: [404.5, 269.5],
        radius_mm: Some(141.0),
        pan_is_clockwise: false,
        views: views.to_vec(),
    }
}

/// Where the point appears by the definition: [`ViewAngles`] and the intrinsics. The centre of the top-left pixel is
/// (0, 0).
fn truth(scan: &BundleScan, view: usize, point: [f64; 3]) -> [f64; 2] {
    let angles = scan.views[view].angles.expect("all have angles");
    let pan_deg = if scan.pan_is_clockwise { -angles.pan_deg } else { angles.pan_deg };
    let angles = ViewAngles { pan_deg, ..angles };
    let centre = angles.direction().map(|d| d * scan.radius_mm.unwrap_or(1.0));
    let along = angles.rotation().map(|row| (0..3).map(|k| row[k] * (point[k] - centre[k])).sum::<f64>());
    let camera = scan.intrinsics.expect("known");
    let ideal = [along[0] / along[2], along[1] / along[2]];
    let (k1, k2) = camera.distortion.map_or((0.0, 0.0), |lens| (lens.k1, lens.k2));
    let square = ideal[0] * ideal[0] + ideal[1] * ideal[1];
    let factor = 1.0 + k1 * square + k2 * square * square;
    let centre =
        camera.distortion.map(|lens| lens.centre_px).or(camera.principal_point_px).unwrap_or(scan.canvas_centre_px);
    [0, 1].map(|axis| centre[axis] + camera.principal_distance_px * factor * ideal[axis])
}

fn texts(entries: &[Entry]) -> HashMap<&str, &str> {
    entries
        .iter()
        .filter_map(|entry| match &entry.content {
            Content::Text(text) => Some((entry.path.as_str(), text.as_str())),
            _ => None,
        })
        .collect()
}

#[test]
fn a_point_of_the_world_appears_at_the_same_pixel_in_every_layout() {
    let lens = ImageDistortion { k1: -0.8, k2: 12.0, centre_px: [399.0, 268.5] };
    let distorted = |scan: BundleScan| {
        let intrinsics = scan.intrinsics.map(|camera| Intrinsics { distortion: Some(lens), ..camera });
        BundleScan { intrinsics, ..scan }
    };
    let unknown_centre = |scan: BundleScan| {
        let intrinsics = scan.intrinsics.map(|camera| Intrinsics { principal_point_px: None, ..camera });
        BundleScan { intrinsics, radius_mm: None, ..scan }
    };
    let clockwise = BundleScan { pan_is_clockwise: true, ..scan() };
    for scan in [scan(), clockwise, distorted(scan()), unknown_centre(scan())] {
        let reach = scan.radius_mm.unwrap_or(1.0) / 20.0;
        for (layout, reader) in READERS {
            let entries = plan(layout, &scan).expect("a bundle");
            let seen = reader(&texts(&entries), &scan);
            for (at, seen) in seen.iter().enumerate() {
                for point in [[0.0; 3], [1.0, 0.3, -0.5], [-0.2, 0.9, 0.7]].map(|p: [f64; 3]| p.map(|v| v * reach)) {
                    let (found, expected) = (seen.project(point), truth(&scan, at, point));
                    let off = (found[0] - expected[0]).hypot(found[1] - expected[1]);
                    assert!(off < 1e-6, "{layout:?} view {at}: {found:?} instead of {expected:?}");
                }
            }
        }
    }
}

#[test]
fn images_and_masks_have_the_names_that_each_program_looks_for() {
    let mut scan = scan();
    scan.views[3].has_mask = false;
    for (layout, mask) in [
        (Layout::Colmap, "masks/pan000_tilt00.png.png"),
        (Layout::Meshroom, "masks/pan000_tilt00.png"),
        (Layout::Metashape, "masks/pan000_tilt00_mask.png"),
        (Layout::Realitycapture, "images/pan000_tilt00.png.mask.png"),
        (Layout::Odm, "images/pan000_tilt00_mask.png"),
        (Layout::Openmvg, "images/pan000_tilt00_mask.png"),
        (Layout::Nerfstudio, "masks/pan000_tilt00.png"),
    ] {
        let entries = plan(layout, &scan).expect("a bundle");
        let content = |path: &str| entries.iter().find(|entry| entry.path == path).map(|entry| entry.content.clone());
        assert_eq!(content("images/pan000_tilt00.png"), Some(Content::Image(0)), "{layout:?}");
        assert_eq!(content(mask), Some(Content::Mask(0)), "{layout:?}");
        let masks = entries.iter().filter(|entry| matches!(entry.content, Content::Mask(_)));
        assert_eq!(masks.count(), 3, "{layout:?}");
        let mut paths: Vec<&str> = entries.iter().map(|entry| entry.path.as_str()).collect();
        assert_eq!(paths[0], "README.txt");
        assert!(paths.iter().all(|path| !["ps_", "hdr_", "rig"].iter().any(|bad| path.starts_with(bad))));
        paths.sort_unstable();
        paths.dedup();
        assert_eq!(paths.len(), entries.len(), "{layout:?}: names are unique");
    }
}

#[test]
fn the_camera_of_opendronemap_is_relative_to_the_longer_side_and_for_all_images() {
    let entries = plan(Layout::Odm, &scan()).expect("a bundle");
    let files = texts(&entries);
    // --cameras refuses ids that are not those of the images' EXIF; OpenSfM knows `all`
    assert!(!files.contains_key("cameras.json") && !files["README.txt"].contains("--cameras"));
    let cameras = files["opensfm/camera_models_overrides.json"];
    let cameras: serde_json::Value = serde_json::from_str(cameras).expect("JSON");
    assert_eq!(cameras["all"]["projection_type"], "brown");
    let value = |name: &str| cameras["all"][name].as_f64().expect(name) * f64::from(WIDTH);
    assert!((value("focal_x") - 2712.5).abs() < 1e-9);
    assert!((value("c_x") - (401.25 + 0.5 - 405.0)).abs() < 1e-9);
    assert!((value("c_y") - (271.75 + 0.5 - 270.0)).abs() < 1e-9);
}

#[test]
fn colmap_gets_its_camera_its_pairs_and_ids_by_name() {
    let mut scan = scan();
    scan.views.swap(0, 3);
    let entries = plan(Layout::Colmap, &scan).expect("a bundle");
    let files = texts(&entries);
    let readme = files["README.txt"];
    assert!(
        readme.contains("--ImageReader.camera_model PINHOLE --ImageReader.camera_params 2712.5,2712.5,401.75,272.25")
    );
    assert!(
        readme.contains("--ImageReader.mask_path masks") && readme.contains("ba_refine_focal_length 0"),
        "{readme}"
    );
    let names: Vec<&str> =
        files["sparse/0/images.txt"].lines().skip(2).step_by(2).filter_map(|line| line.rsplit(' ').next()).collect();
    let mut sorted = names.clone();
    sorted.sort_unstable();
    assert_eq!(names, sorted, "ids go by name");
    assert_eq!(files["pairs.txt"].lines().count(), 6, "each of four with each");
}

#[test]
fn what_is_unknown_is_left_out_and_said() {
    let mut scan = scan();
    scan.intrinsics = None;
    scan.views[2].angles = None;
    for layout in Layout::ALL {
        let entries = plan(layout, &scan).expect("a bundle");
        let files = texts(&entries);
        assert!(files["README.txt"].contains("Camera: unknown") && files["README.txt"].contains("Poses: none"));
        let left_out = [
            "sparse/0/cameras.txt",
            "pairs.txt",
            "calibration.xml",
            "transforms.json",
            "sfm_data.json",
            "opensfm/camera_models_overrides.json",
        ];
        assert!(left_out.iter().all(|path| !files.contains_key(path)), "{layout:?}");
    }
    let empty = BundleScan { views: Vec::new(), ..scan };
    assert!(plan(Layout::Colmap, &empty).is_err());
}

#[test]
fn an_image_that_would_be_taken_for_a_mask_is_refused() {
    let mut scan = scan();
    scan.views[0].stem = "head".into();
    for stem in ["head_mask", "Head_Mask", "mask"] {
        scan.views[1].stem = stem.into();
        for layout in Layout::ALL {
            let planned = plan(layout, &scan);
            match layout {
                Layout::Odm | Layout::Openmvg => {
                    let error = planned.expect_err("refused").to_string();
                    assert!(error.contains(stem) && error.contains(layout.name()), "{error}");
                }
                _ => assert!(planned.is_ok(), "{layout:?}"),
            }
        }
    }
}
