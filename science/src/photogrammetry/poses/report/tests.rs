//! Surfaces and scales that cannot be measured.

use super::*;
use crate::{
    photogrammetry::poses::{Distance, KnownScale, Pose, PoseFormat},
    types::view::ViewAngles,
};

/// Views at these pans and tilts, on a sphere of radius 2.
fn views(angles: &[(f64, f64)]) -> PoseFile {
    let pose = |&(pan_deg, tilt_deg): &(f64, f64)| {
        let angles = ViewAngles { pan_deg, tilt_deg };
        let centre = angles.direction().map(|part| 2.0 * part);
        Pose { name: angles.file_stem(), centre, rotation: None, commanded_deg: Some([pan_deg, tilt_deg]) }
    };
    PoseFile {
        format: PoseFormat::Csv,
        poses: angles.iter().map(pose).collect(),
        unregistered: Vec::new(),
        focal_px: Vec::new(),
    }
}

fn ring(tilt_deg: f64) -> PoseFile {
    views(&[0.0, 40.0, 80.0, 120.0, 160.0, 200.0, 240.0, 280.0, 320.0].map(|pan| (pan, tilt_deg)))
}

fn with_radius(file: &PoseFile) -> PoseReport {
    let scale = Some(KnownScale::Radius { mm: 141.0 });
    report(file, &PoseOptions { scale, ..PoseOptions::default() }).expect("a report")
}

fn told<'a>(report: &'a PoseReport, code: &str) -> &'a str {
    let found = report.findings.iter().find(|finding| finding.code == code);
    found.unwrap_or_else(|| panic!("{code} in {:?}", report.findings)).detail.as_str()
}

#[test]
fn a_ring_beyond_the_pole_has_a_scale_and_one_at_the_pole_has_none() {
    for tilt in [60.0, 120.0, -100.0] {
        let report = with_radius(&ring(tilt));
        assert_eq!(report.scale.source, ScaleSource::KnownRadius, "{tilt}");
        assert!((report.scale.per_file_unit - 70.5).abs() < 1e-6, "{tilt}: {:?}", report.scale);
    }
    for tilt in [89.5, 90.5, -89.0] {
        let report = with_radius(&ring(tilt));
        assert_eq!((report.scale.unit, report.scale.source), (LengthUnit::Radius, ScaleSource::None), "{tilt}");
        assert!((report.surface.expect("a circle").radius - 1.0).abs() < 1e-9, "{tilt}");
        assert!(told(&report, "no_scale").contains("give pair_from, pair_to and pair_mm"), "{tilt}");
    }
}

#[test]
fn centres_on_one_line_or_at_one_point_are_told() {
    for step in [0.0, 1.0] {
        for count in [3, 6] {
            let mut file = views(&vec![(0.0, 0.0); count]);
            for (at, pose) in file.poses.iter_mut().enumerate() {
                pose.name = format!("view {at}");
                pose.centre = [1.0 + step * at as f64, 2.0, 3.0];
            }
            let report = with_radius(&file);
            let detail = told(&report, "no_surface");
            assert!(
                detail.starts_with("the camera centres lie on one line or at one point"),
                "{step} {count}: {detail}"
            );
        }
    }
    let two = with_radius(&views(&[(0.0, 0.0), (20.0, 0.0)]));
    assert!(told(&two, "no_surface").starts_with("a sphere needs at least 4 camera centres, and there are 2"));
}

#[test]
fn three_views_have_a_circle_and_angles_only_at_one_tilt() {
    let two_tilts = with_radius(&views(&[(0.0, 0.0), (20.0, 0.0), (0.0, 20.0)]));
    assert_eq!(two_tilts.surface.expect("a circle").kind, SurfaceKind::Circle);
    let wanted = "only 3 views are registered, so a circle is fitted instead of a sphere: register at least 4 views";
    assert_eq!(told(&two_tilts, "one_ring"), wanted);
    assert_eq!((two_tilts.pan_steps, two_tilts.axis, two_tilts.pan_is_clockwise), (None, None, None));
    assert!(two_tilts.views.iter().all(|view| view.pan_deg.is_none() && view.tangential_residual.is_none()));
    assert!(told(&two_tilts, "no_axis").contains("several tilts in one plane"));
    let one_tilt = with_radius(&views(&[(0.0, 20.0), (20.0, 20.0), (40.0, 20.0)]));
    assert_eq!(told(&one_tilt, "one_ring"), wanted);
    assert_eq!(one_tilt.pan_steps.map(|steps| steps.count), Some(2));
    // four on the meridian: the circle has the radius of the sphere, but no pan
    let meridian = with_radius(&views(&[(0.0, 0.0), (0.0, 20.0), (0.0, 40.0), (180.0, 30.0)]));
    assert!(told(&meridian, "one_ring").starts_with("all cameras are in one plane"));
    assert!(meridian.pan_steps.is_none() && meridian.views.iter().all(|view| view.pan_residual_deg.is_none()));
}

#[test]
fn a_pair_with_an_unknown_view_says_what_to_name() {
    let scale = Some(KnownScale::Pair { from: "pan000_tilt00".into(), to: "lost".into(), mm: 3.0 });
    let error = report(&ring(0.0), &PoseOptions { scale, ..PoseOptions::default() }).expect_err("no such view");
    let wanted = "the view 'lost' is not registered, so it cannot give the scale; name two views that the file has";
    assert_eq!(error.detail, wanted);
}

fn with_focal(found: [f64; 2], camera: Option<[f64; 2]>) -> PoseReport {
    let distance = |[px, sigma]: [f64; 2]| Distance { px, sigma_px: (sigma > 0.0).then_some(sigma) };
    let options = PoseOptions {
        focal_length: Some(distance(found)),
        principal_distance: camera.map(distance),
        ..PoseOptions::default()
    };
    report(&ring(0.0), &options).expect("a report")
}

#[test]
fn the_focal_length_is_compared_with_the_camera_as_far_as_both_are_known() {
    // of 6500 px: within 2 %, beyond them, within three standard deviations, beyond those
    for (found, camera, differs) in [
        ([6600.0, 0.0], [6500.0, 10.0], false),
        ([6700.0, 0.0], [6500.0, 10.0], true),
        ([6700.0, 70.0], [6500.0, 10.0], false),
        ([5200.0, 70.0], [6500.0, 10.0], true),
    ] {
        let report = with_focal(found, Some(camera));
        let compared = report.focal_length.expect("compared");
        assert!((compared.difference_percent - 100.0 * (found[0] / camera[0] - 1.0)).abs() < 1e-9);
        assert_eq!(report.findings.iter().any(|f| f.code == "focal_length_disagrees"), differs, "{found:?}");
        assert_eq!(report.not_checked, None);
        assert!(report.text().contains("of the camera 6500.0"), "{}", report.text());
    }
    assert!(
        with_focal([6600.0, 0.0], Some([6500.0, 10.0]))
            .text()
            .contains("6600.0 +- unknown, of the camera 6500.0 +- 10.0")
    );
    let wrong = with_focal([7800.0, 0.0], Some([6500.0, 10.0]));
    let detail = told(&wrong, "focal_length_disagrees");
    assert!(detail.contains("7800.0 px") && detail.contains("6500.0 px: +20.0 %"), "{detail}");
}

#[test]
fn what_leaves_the_focal_length_unchecked_is_said() {
    let said = |report: PoseReport| report.not_checked.expect("nothing checks it");
    for (report, what) in [
        (report(&ring(0.0), &PoseOptions::default()).expect("a report"), "is not known here"),
        (with_focal([6500.0, 0.0], None), "is not known here"),
        (with_focal([6500.0, 0.0], Some([6500.0, 10.0])), "which the program did not change"),
        (with_focal([6000.0, 0.0], Some([6500.0, 850.0])), "is known to 13 % only"),
        (with_focal([6600.0, 0.0], Some([6500.0, 0.0])), "of the camera is unknown, so 2 % are allowed"),
    ] {
        assert!(report.findings.iter().all(|f| f.code != "focal_length_disagrees"), "{what}");
        let sentence = said(report);
        assert!(
            sentence.starts_with("the poses do not check the focal length") && sentence.contains(what),
            "{sentence}"
        );
    }
    let distance = Some(Distance { px: 6500.0, sigma_px: None });
    let options = PoseOptions { principal_distance: distance, ..PoseOptions::default() };
    assert!(
        said(report(&ring(0.0), &options).expect("a report"))
            .contains("(focal_px; of COLMAP, send a zip of the folder of the model)")
    );
}

#[test]
fn a_principal_distance_without_uncertainty_is_not_taken_as_exact() {
    for (found, differs) in [(6600.0, false), (6700.0, true)] {
        let report = with_focal([found, 0.0], Some([6500.0, 0.0]));
        assert_eq!(report.focal_length.expect("compared").camera_sigma_px, None);
        assert!(report.text().contains("of the camera 6500.0 +- unknown"), "{}", report.text());
        assert_eq!(report.findings.iter().any(|f| f.code == "focal_length_disagrees"), differs, "{found}");
        let sentence = report.not_checked.expect("nothing checks it");
        assert!(sentence.contains("the uncertainty of the principal distance of the camera is unknown"), "{sentence}");
    }
}

#[test]
fn the_focal_length_of_the_file_is_used_unless_one_is_given() {
    let mut file = ring(0.0);
    file.focal_px = vec![6500.0, 6500.0, 6600.0, 6400.0, 6500.0];
    let camera = Some(Distance { px: 6480.0, sigma_px: Some(10.0) });
    let options = PoseOptions { principal_distance: camera, ..PoseOptions::default() };
    let of_file = report(&file, &options).expect("a report");
    assert_eq!(of_file.focal_length.expect("compared").reconstruction_px, 6500.0);
    assert_eq!(of_file.not_checked, None);
    let several = told(&of_file, "several_cameras");
    assert!(several.contains("of 6400.0 to 6600.0 px") && several.contains("6500.0 px, is compared"), "{several}");
    let given = PoseOptions { focal_length: Some(Distance { px: 6450.0, sigma_px: Some(5.0) }), ..options.clone() };
    let given = report(&file, &given).expect("a report");
    assert_eq!(given.focal_length.expect("compared").reconstruction_px, 6450.0);
    assert!(given.findings.iter().all(|f| f.code != "several_cameras"));
    file.focal_px = vec![6500.0; 9];
    let one = report(&file, &options).expect("a report");
    assert!(one.findings.iter().all(|f| f.code != "several_cameras"), "{:?}", one.findings);
}

/// A reconstruction with a focal length `k` times too long: cameras `k` times too far from the object, and a length of
/// the object of 10 mm.
fn with_known_length(k: f64, scale: Option<KnownScale>) -> Result<PoseReport, Error> {
    let mut file = ring(0.0);
    // 70.5 mm per unit of the file where the focal length is right
    for pose in &mut file.poses {
        pose.centre = pose.centre.map(|part| k * part);
    }
    let known_length = Some(([[0.1, 0.2, 0.3], [0.1, 0.2 + 10.0 / 70.5, 0.3]], 10.0));
    report(&file, &PoseOptions { scale, known_length, ..PoseOptions::default() })
}

#[test]
fn a_known_length_checks_the_focal_length_that_a_known_radius_does_not() {
    let pair = KnownScale::Pair {
        from: "pan000_tilt00".into(),
        to: "pan040_tilt00".into(),
        mm: 282.0 * 20_f64.to_radians().sin(),
    };
    for scale in [KnownScale::Radius { mm: 141.0 }, pair] {
        for (k, wrong) in [(1.0, None), (1.015, None), (1.2, Some("too long")), (0.9, Some("too short"))] {
            let report = with_known_length(k, Some(scale.clone())).expect("a report");
            let known = report.known_length.expect("compared");
            assert!((known.reconstruction_mm - 10.0 / k).abs() < 1e-9 && known.known_mm == 10.0, "{k}: {known:?}");
            assert!((known.difference_percent - 100.0 * (1.0 / k - 1.0)).abs() < 1e-9, "{k}: {known:?}");
            assert_eq!(report.not_checked, None, "the length checks it");
            assert!(report.text().contains(", on the object 10.000 ("), "{}", report.text());
            match wrong {
                None => assert!(report.findings.iter().all(|f| f.code != "known_length_disagrees"), "{k}"),
                Some(wrong) => {
                    assert!(told(&report, "known_length_disagrees").contains(wrong), "{k}: {:?}", report.findings)
                }
            }
        }
    }
    let long = with_known_length(1.2, Some(KnownScale::Radius { mm: 141.0 })).expect("a report");
    let wanted =
        "the known length is 10.000 mm on the object and 8.333 mm in the reconstruction: -16.7 %, and 2.0 % is allowed";
    assert!(told(&long, "known_length_disagrees").starts_with(wanted), "{:?}", long.findings);
}

#[test]
fn a_known_length_without_a_scale_says_what_to_give() {
    let error = with_known_length(1.0, None).expect_err("nothing to compare with");
    assert_eq!(
        error.detail,
        "a known length is compared with a scale: give radius_mm, or pair_from, pair_to and pair_mm"
    );
}
