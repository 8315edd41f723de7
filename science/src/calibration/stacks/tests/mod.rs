//! Calibration by stacks against the truth of the renderer.

mod refine;

use std::sync::Arc;

use super::*;
use crate::imaging::{Plane, Raster};
use crate::synth::{Light, Rendered, Rig, Scene, Stage};
use crate::types::{NoControl, WarningCode, report::Grade};

fn rendered(rig: &Rig, scene: &Scene) -> Rendered {
    Rendered::scene(Arc::new(Stage::new(rig, scene)), Light::Front)
}

fn worst(found: &Calibration, rig: &Rig) -> f64 {
    let [width, height] = [rig.width as u32, rig.height as u32];
    let off = |s: &crate::types::profile::ProfileSlice| {
        s.homography.corner_distance(&rig.homography(s.index as usize), width, height)
    };
    found.slices.iter().map(off).fold(0.0, f64::max)
}

#[test]
fn one_stack_gives_the_geometry_and_the_gains_of_its_rig() {
    let rig = Rig { softness_px: 0.5, ..Rig::sized(540, 360, 9) };
    for scene in [Scene::weave(1), Scene::plates(2)] {
        let slices = rendered(&rig, &scene);
        let found = calibrate_by_stacks(&[&slices], &CalibrationOptions::default(), &NoControl).expect("a profile");
        let error = worst(&found, &rig);
        assert!(error < 0.5, "{error} px");
        assert!(found.slices.iter().all(|s| s.index == 4 || s.corner_sigma_px.is_some_and(|sigma| sigma >= 0.1)));
        assert_eq!(
            (found.report.grade, found.warnings[0].code.clone()),
            (Grade::Usable, WarningCode::CalibratedByStacks)
        );
        for slice in &found.slices {
            let truth = rig.gain(slice.index as usize) / rig.gain(rig.reference);
            assert!((slice.gain / truth - 1.0).abs() < 0.01, "{} for {truth}", slice.gain);
        }
    }
}

#[test]
fn several_views_share_one_profile_and_the_step_of_the_rail_gives_the_exit_pupil() {
    let rig = Rig { softness_px: 0.5, ..Rig::sized(420, 280, 7) };
    let views = [1, 2, 3].map(|seed| rendered(&rig, &Scene::insect(seed)));
    let views = views.each_ref().map(|view| view as &dyn Slices);
    let step = rig.rail_mm[0] - rig.rail_mm[1];
    let options = CalibrationOptions { rail_step_mm: Some(step), ..CalibrationOptions::default() };
    let found = calibrate_by_stacks(&views, &options, &NoControl).expect("a profile");
    assert!(worst(&found, &rig) < 0.5, "{} px", worst(&found, &rig));
    let exit = found.report.camera.pupils.exit_pupil_distance_mm.expect("the rail moves the sensor");
    assert!((exit / rig.lens().exit_pupil_distance() - 1.0).abs() < 0.05, "{exit} mm");
}

#[test]
fn pictures_without_common_detail_end_with_a_sentence_that_says_what_to_photograph() {
    let plain: Vec<Raster> = (0..4)
        .map(|k| {
            let noise = |x: usize, y: usize| 100 + ((x * 7919 + y * 104_729 + k * 31) % 3) as u8;
            let plane = Plane::from_fn(300, 200, noise);
            Raster::eight(300, 200, 1, plane.data)
        })
        .collect();
    let error = calibrate_by_stacks(&[&&plain[..]], &CalibrationOptions::default(), &NoControl).expect_err("nothing");
    let Interrupted::Failed(error) = error else { panic!("{error:?}") };
    assert_eq!(error.kind, ErrorKind::TargetNotFound);
    assert!(error.detail.contains("fine detail") && error.detail.contains("dot target"), "{}", error.detail);
}

#[test]
fn stacks_that_do_not_belong_together_are_refused() {
    let rig = Rig::sized(120, 80, 3);
    let (three, four) = (rendered(&rig, &Scene::weave(1)), rendered(&Rig::sized(120, 80, 4), &Scene::weave(1)));
    let larger = rendered(&Rig::sized(160, 120, 3), &Scene::weave(1));
    let refused =
        |views: &[&dyn Slices], options: CalibrationOptions| match calibrate_by_stacks(views, &options, &NoControl) {
            Err(Interrupted::Failed(error)) => error,
            other => panic!("{:?}", other.map(|found| found.verdict)),
        };
    let error = refused(&[&three, &four], CalibrationOptions::default());
    assert_eq!(error.kind, ErrorKind::SliceCountMismatch);
    assert!(error.detail.contains("3 slices") && error.detail.contains('4'), "{}", error.detail);
    assert_eq!(refused(&[&three, &larger], CalibrationOptions::default()).kind, ErrorKind::SizeMismatch);
    let model = CalibrationOptions { model: ModelChoice::Homography, ..CalibrationOptions::default() };
    assert!(refused(&[&three], model).detail.contains("model=auto"));
    let reference = CalibrationOptions { reference_index: Some(3), ..CalibrationOptions::default() };
    assert!(refused(&[&three], reference).detail.contains("0 to 2"));
}
