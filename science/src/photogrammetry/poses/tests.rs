//! The report against turntables of known geometry, and every format against the same poses.

use nalgebra::{Matrix3, Rotation3, Vector3};
use proptest::prelude::*;

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
    PoseFile { format: PoseFormat::ColmapText, poses, unregistered: Vec::new() }
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
    for wanted in ["registered", "90 of 92", "radius of the sphere (mm)", "pan step (deg)", "tilt step (deg)"] {
        assert!(text.contains(wanted), "{wanted} in {text}");
    }
    let std = format!("{:.3}", report.surface.expect("a sphere").std);
    assert!(latex.contains(&format!("radius of the sphere (mm) & 141.000 & {std} \\\\")), "{latex}");
    assert!(latex.starts_with("\\begin{tabular}{lrr}") && latex.contains("STD of the radius (\\%)"), "{latex}");
}

/// Every format, written from the same poses.
fn written(format: PoseFormat, poses: &[Pose]) -> Vec<u8> {
    let rotation = |pose: &Pose| pose.rotation.expect("a rotation");
    let quaternion = |pose: &Pose| {
        let turn = Rotation3::from_matrix_unchecked(matrix(&rotation(pose)));
        let q = nalgebra::UnitQuaternion::from_rotation_matrix(&turn);
        [q.w, q.i, q.j, q.k]
    };
    let translation = |pose: &Pose| -> [f64; 3] { (-(matrix(&rotation(pose)) * Vector3::from(pose.centre))).into() };
    let joined = |values: &[f64], by: &str| values.iter().map(f64::to_string).collect::<Vec<_>>().join(by);
    let flat = |rows: [[f64; 3]; 3]| rows.concat();
    let transposed = |rows: [[f64; 3]; 3]| [0, 1, 2].map(|j| rows.map(|row| row[j]));
    match format {
        PoseFormat::ColmapText => {
            let mut out = "# Image list with two lines of data per image:\n".to_owned();
            for (at, pose) in poses.iter().enumerate() {
                let (q, t) = (joined(&quaternion(pose), " "), joined(&translation(pose), " "));
                out.push_str(&format!("{} {q} {t} 1 {}\n1.5 2.5 -1 7 8 12\n", at + 1, pose.name));
            }
            out.into()
        }
        PoseFormat::ColmapBinary => {
            let mut out = (poses.len() as u64).to_le_bytes().to_vec();
            for (at, pose) in poses.iter().enumerate() {
                out.extend(u32::try_from(at).expect("few").to_le_bytes());
                quaternion(pose).iter().chain(&translation(pose)).for_each(|x| out.extend(x.to_le_bytes()));
                out.extend(1_u32.to_le_bytes());
                out.extend(pose.name.as_bytes());
                out.push(0);
                out.extend(2_u64.to_le_bytes());
                out.extend([0; 48]);
            }
            out
        }
        PoseFormat::Alicevision => {
            let text = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>();
            // ids of poses differ from those of views
            let view = |(at, pose): (usize, &Pose)| serde_json::json!({ "viewId": format!("{at}"), "poseId": format!("{}", at + 500), "path": pose.name });
            let pose = |(at, pose): (usize, &Pose)| {
                let rotation = text(&flat(transposed(rotation(pose))));
                let transform = serde_json::json!({ "rotation": rotation, "center": text(&pose.centre) });
                serde_json::json!({ "poseId": format!("{}", at + 500), "pose": { "transform": transform, "locked": "0" } })
            };
            let views: Vec<_> = poses.iter().enumerate().map(view).collect();
            let poses: Vec<_> = poses.iter().enumerate().map(pose).collect();
            serde_json::json!({ "version": ["1", "2", "8"], "views": views, "intrinsics": "", "poses": poses })
                .to_string()
                .into()
        }
        PoseFormat::Openmvg => {
            let view = |(at, pose): (usize, &Pose)| {
                let data = serde_json::json!({ "local_path": "", "filename": pose.name, "width": 10, "height": 10, "id_view": at, "id_intrinsic": 0, "id_pose": at });
                serde_json::json!({ "key": at, "value": { "polymorphic_id": 1073741824, "ptr_wrapper": { "id": 1, "data": data } } })
            };
            let extrinsic = |(at, pose): (usize, &Pose)| serde_json::json!({ "key": at, "value": { "rotation": rotation(pose), "center": pose.centre } });
            let views: Vec<_> = poses.iter().enumerate().map(view).collect();
            let extrinsics: Vec<_> = poses.iter().enumerate().rev().map(extrinsic).collect();
            serde_json::json!({ "sfm_data_version": "0.3", "root_path": "", "views": views, "extrinsics": extrinsics })
                .to_string()
                .into()
        }
        PoseFormat::Metashape => {
            // a chunk of its own size and place, in which the cameras are
            let (turn, scale, shift) = (Rotation3::from_euler_angles(0.3, 0.2, 0.1), 2.5, Vector3::new(1.0, 2.0, 3.0));
            let mut out =
                "<?xml version=\"1.0\"?>\n<document version=\"1.5.0\"><chunk label=\"a\"><cameras><group>".to_owned();
            for (at, pose) in poses.iter().enumerate() {
                let centre = turn.inverse() * (Vector3::from(pose.centre) - shift) / scale;
                let from_camera = turn.inverse().matrix() * matrix(&rotation(pose)).transpose();
                let line = |i: usize| [from_camera[(i, 0)], from_camera[(i, 1)], from_camera[(i, 2)], centre[i]];
                let values = [line(0), line(1), line(2), [0.0, 0.0, 0.0, 1.0]].concat();
                out.push_str(&format!(
                    "<camera id=\"{at}\" sensor_id=\"0\" component_id=\"0\" label=\"{}\"><transform>{}</transform></camera>\n",
                    pose.name,
                    joined(&values, " ")
                ));
            }
            let transform = format!(
                "<transform><rotation>{}</rotation><translation>{}</translation><scale>{scale}</scale></transform>",
                joined(&flat(rows(turn.matrix())), " "),
                joined(shift.as_slice(), " ")
            );
            out.push_str(&format!("<camera id=\"999\" label=\"lost.png\"/></group></cameras><components><component id=\"0\">{transform}</component></components></chunk></document>"));
            out.into()
        }
        PoseFormat::Csv => {
            let mut out = "\u{feff}#Label;Z;Y;X\r\n".to_owned();
            for pose in poses {
                let [x, y, z] = pose.centre;
                out.push_str(&format!("{};{z};{y};{x}\r\n", pose.name));
            }
            out.push_str("lost.png;;;\r\n");
            out.into()
        }
    }
}

const FORMATS: [PoseFormat; 6] = [
    PoseFormat::ColmapText,
    PoseFormat::ColmapBinary,
    PoseFormat::Alicevision,
    PoseFormat::Metashape,
    PoseFormat::Openmvg,
    PoseFormat::Csv,
];

#[test]
fn every_format_is_recognised_and_gives_the_same_poses() {
    let poses = turntable(&[0.0, 12.0], 0.1, 1.0, 8);
    for format in FORMATS {
        let found = read(&written(format, &poses), None).unwrap_or_else(|error| panic!("{format:?}: {error}"));
        assert_eq!((found.format, found.poses.len()), (format, poses.len()));
        for (found, pose) in found.poses.iter().zip(&poses) {
            assert_eq!(found.name, pose.name);
            let apart = Vector3::from(found.centre) - Vector3::from(pose.centre);
            assert!(apart.norm() < 1e-9, "{format:?}: {apart}");
            if let Some(rotation) = found.rotation {
                let wrong = matrix(&rotation) - matrix(&pose.rotation.expect("a rotation"));
                assert!(wrong.norm() < 1e-9, "{format:?}: {wrong}");
            }
            assert_eq!(found.rotation.is_none(), format == PoseFormat::Csv);
        }
        if matches!(format, PoseFormat::Csv | PoseFormat::Metashape) {
            assert_eq!(found.unregistered, ["lost.png"]);
        }
    }
}

#[test]
fn views_of_alicevision_and_openmvg_without_a_pose_are_not_registered() {
    let lost = r#"{ "views": [{ "viewId": 1, "poseId": 1, "path": "/a/b.jpg" }], "poses": [] }"#;
    let error = read(lost.as_bytes(), None).expect_err("no poses");
    assert_eq!(error.kind, ErrorKind::InvalidPoses);
    assert!(error.detail.contains("it lists 1 views without one"), "{error}");
}

#[test]
fn a_csv_may_bring_its_angles_and_names_the_line_that_is_wrong() {
    let rows: String = turntable(&[0.0, 12.0], 0.0, 0.0, 9)
        .iter()
        .map(|pose| {
            let [pan, tilt] = angles(&pose.name).expect("its name");
            let [x, y, z] = pose.centre;
            format!("IMG {pan}-{tilt},{tilt},{x},{y},{z},{pan}\n")
        })
        .collect();
    let text = format!("name,tilt_deg,x,y,z,pan_deg\n{rows}");
    let found = reported(read(text.as_bytes(), None).expect("poses").poses);
    assert_eq!(found.pan_steps.map(|steps| steps.count), Some(36));
    let wrong = text.replacen("\nIMG 20-0,0,", "\nIMG 20-0,0,x", 1);
    let error = read(wrong.as_bytes(), None).expect_err("not a number");
    assert!(error.detail.starts_with("line 3: x is 'x"), "{error}");
    let error = read(b"image,x,y\na,1,2\n", None).expect_err("no z");
    assert_eq!(error.detail, "the CSV has no column 'z'; its first line must name the columns");
}

#[test]
fn a_file_of_another_kind_is_refused_with_what_to_send() {
    let cameras = "# Camera list\n1 PINHOLE 100 100 50 50 50 50\n";
    let error = read(cameras.as_bytes(), None).expect_err("no poses");
    assert!(error.detail.contains("send images and not cameras"), "{error}");
    let binary = [1_u64.to_le_bytes().as_slice(), &[7; 40]].concat();
    assert!(read(&binary, None).expect_err("truncated").detail.contains("send images.bin"), "truncated");
    for empty in ["", " \n", "<a/>", "{}", "# nothing\n"] {
        assert_eq!(read(empty.as_bytes(), None).expect_err("empty").kind, ErrorKind::InvalidPoses);
    }
    let nan = "1 1 0 0 0 NaN 0 0 1 a.png\n\n";
    let error = read(nan.as_bytes(), Some(PoseFormat::ColmapText)).expect_err("not finite");
    assert!(error.detail.contains("the centre of 'a.png' is not finite"), "{error}");
}

#[test]
fn what_would_cost_much_is_refused() {
    let many = "1 1 0 0 0 0 0 0 1 a.png\n\n".repeat(MAX_VIEWS + 1);
    assert!(read(many.as_bytes(), None).expect_err("too many").detail.contains("more than 10000 views"));
    let many = format!("{{\"views\":[{}]}}", vec!["{\"viewId\":1}"; MAX_VIEWS + 1].join(","));
    assert!(read(many.as_bytes(), None).expect_err("too many").detail.contains("10000"));
    let deep = format!("<document>{}", "<a>".repeat(200_000));
    assert_eq!(read(deep.as_bytes(), None).expect_err("deep").kind, ErrorKind::InvalidPoses);
    // nested chunks must not be searched again at every level: this took minutes
    let nested = 300_000;
    let deep = format!("<document>{}{}</document>", "<chunk>".repeat(nested), "</chunk>".repeat(nested));
    assert_eq!(read(deep.as_bytes(), None).expect_err("no cameras").kind, ErrorKind::InvalidPoses);
    let entities = "<!DOCTYPE a [<!ENTITY b \"cccccc\">]><document>&b;</document>";
    assert!(read(entities.as_bytes(), None).expect_err("entities").detail.contains("XML"), "entities");
    let deep = format!("{{\"views\":{}", "[".repeat(200_000));
    assert_eq!(read(deep.as_bytes(), None).expect_err("deep").kind, ErrorKind::InvalidPoses);
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

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_damaged_file_is_read_or_refused(format in 0..6_usize, cut in 0.0..1.0_f64, at in 0.0..1.0_f64, byte: u8) {
        let mut bytes = written(FORMATS[format], &turntable(&[0.0, 6.0], 0.1, 0.5, 12));
        let at = (at * (bytes.len() - 1) as f64) as usize;
        bytes[at] = byte;
        bytes.truncate((cut * 1.2 * bytes.len() as f64) as usize);
        for format in [None, Some(FORMATS[format])] {
            if let Ok(found) = read(&bytes, format) {
                let report = report(&found, &PoseOptions::default()).expect("a report");
                prop_assert!(!report.text().is_empty() && !report.latex().is_empty());
                prop_assert!(report.surface.is_none_or(|surface| surface.radius.is_finite()));
            }
        }
    }
}
