//! The report against turntables of known geometry, and every format against the same poses.

mod cameras;
mod formats;

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::*;
use crate::types::view::ViewAngles;

const TILTS: [f64; 5] = [0.0, 6.0, 12.0, 18.0, 24.0];
const RADIUS: f64 = 141.0;

/// Normal noise of standard deviation 1, from a fixed sequence.
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut uniform = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
    };
    move || (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos()
}

/// Rings of 18 views at each tilt, with noise on the centres (mm) and on the rotations (degrees).
fn turntable(tilts: &[f64], sigma_mm: f64, sigma_deg: f64, seed: u64) -> Vec<Pose> {
    let mut noise = noise(seed);
    let mut poses = Vec::new();
    for &tilt_deg in tilts {
        for i in 0..18 {
            let angles = ViewAngles { pan_deg: 20.0 * f64::from(i), tilt_deg };
            let centre = angles.direction().map(|x| RADIUS * x + sigma_mm * noise());
            let turn = Vector3::from_fn(|_, _| sigma_deg.to_radians() * noise());
            let rotation = Rotation3::new(turn).matrix() * matrix(&angles.rotation());
            poses.push(Pose {
                name: format!("images/{}.png", angles.file_stem()),
                centre,
                rotation: Some(rows(&rotation)),
                commanded_deg: None,
            });
        }
    }
    poses
}

fn matrix(rows: &[[f64; 3]; 3]) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| rows[i][j])
}

fn rows(matrix: &Matrix3<f64>) -> [[f64; 3]; 3] {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| matrix[(i, j)]))
}

fn file(poses: Vec<Pose>) -> PoseFile {
    PoseFile { format: PoseFormat::ColmapText, poses, unregistered: Vec::new(), focal_px: Vec::new() }
}

fn reported(poses: Vec<Pose>) -> PoseReport {
    report(&file(poses), &PoseOptions::default()).expect("a report")
}

/// The poses in another world: turned, scaled, moved.
fn moved(poses: &[Pose], turn: Rotation3<f64>, scale: f64, shift: Vector3<f64>) -> Vec<Pose> {
    let place = |pose: &Pose| Pose {
        centre: (turn * Vector3::from(pose.centre) * scale + shift).into(),
        rotation: pose.rotation.map(|rotation| rows(&(matrix(&rotation) * turn.inverse().matrix()))),
        ..pose.clone()
    };
    poses.iter().map(place).collect()
}

fn codes(report: &PoseReport) -> Vec<&str> {
    report.findings.iter().map(|finding| finding.code.as_str()).collect()
}

#[test]
fn the_noise_of_the_centres_is_measured_in_radius_pan_and_tilt() {
    for sigma in [0.112, 0.266] {
        // a step is the difference of two angles
        let step = (sigma / RADIUS).to_degrees() * 2_f64.sqrt();
        let (mut std, mut pan, mut tilt) = (0.0, 0.0, 0.0);
        for seed in 0..8 {
            let report = reported(turntable(&TILTS, sigma, 0.0, seed));
            let surface = report.surface.expect("a sphere");
            std += surface.std_percent / 100.0 * RADIUS / 8.0;
            let steps = report.pan_steps.expect("steps of pan");
            assert!((steps.mean_deg - 20.0).abs() < 1e-9, "around whole rings the mean is exact: {steps:?}");
            assert_eq!((steps.commanded_deg, steps.count), (20.0, 90));
            pan += steps.std_deg / 8.0;
            let steps = report.tilt_steps.expect("steps of tilt");
            assert_eq!((steps.commanded_deg, steps.count), (6.0, 72));
            assert!((steps.mean_deg - 6.0).abs() < 0.2, "{steps:?}");
            tilt += steps.std_deg / 8.0;
            assert_eq!(report.findings, [], "nothing is wrong");
        }
        assert!((std / sigma - 1.0).abs() < 0.08, "{std} for {sigma}");
        assert!((pan / step - 1.0).abs() < 0.12 && (tilt / step - 1.0).abs() < 0.12, "{pan} {tilt} for {sigma}");
    }
}

#[test]
fn the_optical_axes_measure_the_steps_without_the_centres() {
    let report = reported(turntable(&TILTS, 5.0, 0.02, 3));
    let (pan, tilt) = (report.pan_steps_of_axes.expect("steps"), report.tilt_steps_of_axes.expect("steps"));
    // the noise of the rotations, whatever that of the centres is
    assert!(pan.std_deg < 0.04 && tilt.std_deg < 0.04, "{pan:?} {tilt:?}");
    assert!(report.pan_steps.expect("steps").std_deg > 1.0);
}

#[test]
fn another_world_and_another_sense_of_turning_change_nothing() {
    let poses = turntable(&TILTS, 0.112, 0.01, 1);
    let here = reported(poses.clone());
    let turn = Rotation3::from_euler_angles(0.4, -1.1, 2.0);
    let there = reported(moved(&poses, turn, 0.003, Vector3::new(12.0, -7.0, 3.0)));
    let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-6, "{a} {b}");
    let of = |report: &PoseReport| {
        let surface = report.surface.expect("a sphere");
        let (pan, tilt) = (report.pan_steps.expect("steps"), report.tilt_steps.expect("steps"));
        let axes = report.pan_steps_of_axes.expect("steps");
        [surface.std_percent, pan.mean_deg, pan.std_deg, tilt.mean_deg, tilt.std_deg, axes.std_deg]
    };
    of(&here).into_iter().zip(of(&there)).for_each(|(a, b)| close(a, b));
    let axis = Vector3::from(there.axis.expect("an axis"));
    assert!((turn * Vector3::z() - axis).norm() < 0.01, "{axis}");
    // the table turns the other way: names say pan, the camera is at -pan
    let mirrored: Vec<Pose> = poses
        .iter()
        .zip(turntable(&TILTS, 0.112, 0.01, 1))
        .map(|(pose, _)| {
            let ViewAngles { pan_deg, tilt_deg } = ViewAngles::of_name(&pose.name).expect("its name");
            let pan_deg = (360.0 - pan_deg) % 360.0;
            Pose { name: ViewAngles { pan_deg, tilt_deg }.file_stem(), ..pose.clone() }
        })
        .collect();
    let other = reported(mirrored);
    assert_eq!((here.pan_is_clockwise, other.pan_is_clockwise), (Some(false), Some(true)));
    assert_eq!(codes(&other), ["clockwise"]);
    of(&here).into_iter().zip(of(&other)).for_each(|(a, b)| close(a, b));
}

#[test]
fn outliers_and_missing_views_are_named_and_do_not_disturb() {
    let mut poses = turntable(&TILTS, 0.01, 0.0, 2);
    let all: Vec<Commanded> =
        poses.iter().map(|pose| Commanded { name: pose.name.clone(), angles_deg: angles(&pose.name) }).collect();
    poses[40].centre = [300.0, 20.0, 7.0];
    // on the sphere, five degrees beside its place
    poses[60].centre = ViewAngles { pan_deg: 20.0 * 6.0 + 5.0, tilt_deg: 18.0 }.direction().map(|x| RADIUS * x);
    let wrong = [poses[40].name.clone(), poses[60].name.clone()];
    poses.remove(5);
    poses.push(Pose { name: "wasp_12.png".into(), ..poses[0].clone() });
    poses.push(poses[1].clone());
    let options = PoseOptions { commanded: all.clone(), ..PoseOptions::default() };
    let report = report(&file(poses), &options).expect("a report");
    assert_eq!((report.registered, report.expected), (89, Some(90)));
    assert_eq!(report.not_registered, [all[5].name.clone()]);
    assert_eq!(report.unknown, ["wasp_12.png"]);
    assert_eq!(report.duplicates, [all[1].name.clone()]);
    let outliers: Vec<&str> = report.views.iter().filter(|view| view.is_outlier).map(|view| &*view.name).collect();
    assert!(wrong.iter().all(|name| outliers.contains(&name.as_str())), "{outliers:?}");
    assert!(outliers.len() <= 5, "{outliers:?}");
    let surface = report.surface.expect("a sphere");
    assert!((surface.radius / RADIUS * report.scale.per_file_unit.recip() - 1.0).abs() < 1e-3);
    let pan = report.pan_steps.expect("steps");
    assert!((pan.mean_deg - 20.0).abs() < 0.01 && pan.std_deg < 0.02, "{pan:?}");
    assert_eq!(codes(&report), ["not_registered", "unknown_views", "duplicate_views", "outliers"]);
}

fn angles(name: &str) -> Option<[f64; 2]> {
    ViewAngles::of_name(name).map(|angles| [angles.pan_deg, angles.tilt_deg])
}

#[test]
fn a_known_length_gives_the_scale_and_is_named() {
    let poses = moved(&turntable(&TILTS, 0.05, 0.0, 4), Rotation3::identity(), 0.01, Vector3::zeros());
    let with =
        |scale: Option<KnownScale>| report(&file(poses.clone()), &PoseOptions { scale, ..PoseOptions::default() });
    let free = with(None).expect("a report");
    assert_eq!((free.scale.unit, free.scale.source), (LengthUnit::Radius, ScaleSource::None));
    assert!((free.surface.expect("a sphere").radius - 1.0).abs() < 1e-12);
    let known = with(Some(KnownScale::Radius { mm: 141.0 })).expect("a report");
    assert_eq!(known.scale.source, ScaleSource::KnownRadius);
    let surface = known.surface.expect("a sphere");
    assert!((surface.radius - 141.0).abs() < 1e-9 && (surface.std - 0.05).abs() < 0.01, "{surface:?}");
    let (from, to) = ("pan000_tilt00".to_owned(), "PAN180_TILT00.jpg".to_owned());
    let pair = with(Some(KnownScale::Pair { from, to, mm: 282.0 })).expect("a report");
    assert!((pair.surface.expect("a sphere").radius / 141.0 - 1.0).abs() < 0.01);
    assert!(pair.text().contains("the known distance of two views"));
    let (from, to) = ("pan000_tilt00".to_owned(), "pan999_tilt00".to_owned());
    let missing = with(Some(KnownScale::Pair { from, to, mm: 1.0 })).expect_err("no such view");
    assert!(missing.detail.contains("'pan999_tilt00' is not registered"), "{missing}");
}

#[test]
fn one_ring_has_a_circle_and_steps_of_pan() {
    let report = report(
        &file(turntable(&[24.0], 0.112, 0.0, 5)),
        &PoseOptions { scale: Some(KnownScale::Radius { mm: RADIUS }), ..PoseOptions::default() },
    )
    .expect("a report");
    let surface = report.surface.expect("a circle");
    assert_eq!(surface.kind, SurfaceKind::Circle);
    assert!((surface.radius - RADIUS * 24_f64.to_radians().cos()).abs() < 0.2, "{surface:?}");
    assert!((surface.std - 0.112).abs() < 0.06, "{surface:?}");
    let pan = report.pan_steps.expect("steps");
    assert!((pan.mean_deg - 20.0).abs() < 0.01 && (0.02..0.2).contains(&pan.std_deg), "{pan:?}");
    assert_eq!((report.tilt_steps, codes(&report)), (None, vec!["one_ring"]));
    assert!(report.views.iter().all(|view| view.tilt_deg.is_none() && view.pan_residual_deg.is_some()));
}

#[test]
fn the_sense_of_one_ring_comes_from_the_rotations_or_is_unknown() {
    for tilt in [0.0, 24.0] {
        for is_clockwise in [false, true] {
            let poses: Vec<Pose> = turntable(&[tilt], 0.01, 0.1, 21)
                .into_iter()
                .map(|pose| {
                    let ViewAngles { pan_deg, tilt_deg } = ViewAngles::of_name(&pose.name).expect("its name");
                    let pan_deg = if is_clockwise { (360.0 - pan_deg) % 360.0 } else { pan_deg };
                    Pose { name: ViewAngles { pan_deg, tilt_deg }.file_stem(), ..pose }
                })
                .collect();
            let turn = Rotation3::from_euler_angles(2.4, -1.1, 2.0);
            let report = reported(moved(&poses, turn, 0.1, Vector3::new(1.0, 2.0, 3.0)));
            assert_eq!(report.pan_is_clockwise, Some(is_clockwise), "tilt {tilt}");
            let axis = Vector3::from(report.axis.expect("an axis"));
            assert!((axis - turn * Vector3::z()).norm() < 0.01, "tilt {tilt}: {axis}");
            let centres = poses.into_iter().map(|pose| Pose { rotation: None, ..pose }).collect();
            let report = reported(centres);
            assert_eq!((report.pan_is_clockwise, report.axis), (None, None));
            assert!(report.pan_steps.is_some() && codes(&report) == ["one_ring", "no_sense"], "{:?}", report.findings);
        }
    }
}

#[test]
fn what_cannot_be_measured_is_said() {
    let two = reported(turntable(&TILTS, 0.1, 0.0, 6).into_iter().take(2).collect());
    assert_eq!((two.registered, two.surface, two.pan_steps), (2, None, None));
    assert!(codes(&two).contains(&"no_surface"), "{:?}", two.findings);
    let unnamed: Vec<Pose> = turntable(&TILTS, 0.1, 0.0, 6)
        .into_iter()
        .enumerate()
        .map(|(at, pose)| Pose { name: format!("IMG_{at}.JPG"), ..pose })
        .collect();
    let report = reported(unnamed);
    assert!(report.surface.is_some() && report.axis.is_none());
    assert_eq!(codes(&report), ["no_angles"]);
    assert!(report.text().contains("no_angles: the commanded angles are unknown"), "{}", report.text());
}

#[test]
fn the_table_has_the_quantities_of_the_paper() {
    let options =
        PoseOptions { expected: Some(92), scale: Some(KnownScale::Radius { mm: 141.0 }), ..PoseOptions::default() };
    let report = report(&file(turntable(&TILTS, 0.112, 0.01, 7)), &options).expect("a report");
    let (text, latex) = (report.text(), report.latex());
    let not_checked = report.not_checked.as_deref().expect("nothing checks the focal length");
    assert!(not_checked.starts_with("the poses do not check the focal length"), "{not_checked}");
    assert!(text.contains(not_checked) && latex.contains(not_checked), "{text}{latex}");
    for wanted in ["registered", "90 of 92", "radius of the sphere (mm)", "pan step (deg)", "tilt step (deg)"] {
        assert!(text.contains(wanted), "{wanted} in {text}");
    }
    let std = format!("{:.3}", report.surface.expect("a sphere").std);
    assert!(latex.contains(&format!("radius of the sphere (mm) & 141.000 & {std} \\\\")), "{latex}");
    assert!(latex.starts_with("\\begin{tabular}{lrr}") && latex.contains("STD of the radius (\\%)"), "{latex}");
}

#[test]
fn ten_thousand_views_are_reported() {
    let mut noise = noise(11);
    let poses = (0..MAX_VIEWS)
        .map(|at| {
            let angles = ViewAngles { pan_deg: (at % 360) as f64, tilt_deg: 2.0 * (at / 360) as f64 };
            let centre = angles.direction().map(|x| RADIUS * x + 0.1 * noise());
            Pose { name: angles.file_stem(), centre, rotation: Some(angles.rotation()), commanded_deg: None }
        })
        .collect();
    let report = reported(poses);
    assert_eq!(report.registered as usize, MAX_VIEWS);
    assert!((report.surface.expect("a sphere").std_percent / 100.0 * RADIUS - 0.1).abs() < 0.005);
}
