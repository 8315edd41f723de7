//! Calibration of unusable and degraded targets, and of degenerate stacks.

use std::sync::Mutex;

use super::super::testkit::{Noise, Shot, render};
use super::super::*;
use super::{Stack, print, stack, worst_corner};
use crate::imaging::{Raster, Samples};
use crate::types::{Cancelled, Homography, NoControl};

fn fault(rasters: &[Raster]) -> Error {
    match calibrate(&Stack(rasters), &CalibrationOptions::default(), &NoControl) {
        Err(Interrupted::Failed(fault)) => fault,
        Err(Interrupted::Cancelled(_)) => panic!("not cancelled"),
        Ok(calibration) => panic!("measured: {}", calibration.verdict),
    }
}

/// A stack whose last slice is blank.
fn with_a_blank_end(count: usize) -> (Vec<Raster>, Vec<Homography>) {
    let (mut rasters, truths) = stack(&Shot::default(), count, 1.0, 0, 0.0);
    rasters[count - 1] = Raster::eight(480, 360, 1, vec![140; 480 * 360]);
    (rasters, truths)
}

#[test]
fn slices_without_a_grid_are_refused_by_name() {
    let mut noise = Noise(5);
    let even = |width: usize, height: usize, value: u8| Raster::eight(width, height, 1, vec![value; width * height]);
    let speckle = Raster::eight(300, 200, 1, (0..60_000).map(|_| (128.0 + 60.0 * noise.even()) as u8).collect());
    let one = render(&Shot { grid: [1, 1], ..Shot::default() });
    let row = render(&Shot { grid: [14, 1], ..Shot::default() });
    for picture in [even(200, 150, 0), even(200, 150, 255), even(16, 16, 90), even(5, 5, 90), speckle, one, row] {
        let fault = fault(&[picture.clone(), picture.clone(), picture]);
        assert_eq!(fault.kind, ErrorKind::TargetNotFound);
        assert!(fault.locations.iter().all(|p| p.file.is_some() && p.slice.is_some()));
        assert!(!fault.locations.is_empty() && fault.detail.contains(".png"), "{}", fault.detail);
    }
}

#[test]
fn slices_of_two_sizes_are_refused() {
    let (mut rasters, _) = stack(&Shot::default(), 3, 0.0, 1, 0.0);
    rasters[2] = render(&Shot { width: 470, ..Shot::default() });
    let fault = fault(&rasters);
    assert_eq!(fault.kind, ErrorKind::SizeMismatch);
    assert!(fault.detail.contains("c.png") && fault.detail.contains("470 x 360"), "{}", fault.detail);
}

#[test]
fn one_slice_and_a_reference_beyond_the_stack_are_refused() {
    let (rasters, _) = stack(&Shot::default(), 2, 0.0, 1, 0.0);
    assert_eq!(fault(&rasters[..1]).kind, ErrorKind::InvalidParameter);
    let options = CalibrationOptions { reference_index: Some(2), ..CalibrationOptions::default() };
    let refused = calibrate(&Stack(&rasters), &options, &NoControl);
    assert!(
        matches!(refused, Err(Interrupted::Failed(f)) if f.kind == ErrorKind::InvalidParameter && f.detail.contains("0 to 1"))
    );
}

#[test]
fn a_mirrored_slice_is_refused() {
    let mut rasters: Vec<Raster> = Vec::new();
    // the keystone makes mirrored images differ even for a grid that is its own mirror image
    let bent = Homography([1.0, 0.02, 5.0, 0.01, 1.0, -3.0, 2.5e-4, 1.2e-4, 1.0]);
    for k in 0..3 {
        rasters.push(render(&Shot { homography: bent, seed: k, vignetting: 0.0, ..Shot::default() }));
    }
    if let Samples::Eight(samples) = &mut rasters[2].samples {
        samples.chunks_exact_mut(480).for_each(<[u8]>::reverse);
    }
    // either refused, or measured as the unmirrored transform that the grid allows: never a mirrored homography
    match calibrate(&Stack(&rasters), &CalibrationOptions::default(), &NoControl) {
        Err(Interrupted::Failed(fault)) => assert_eq!(fault.kind, ErrorKind::TargetNotFound),
        Err(Interrupted::Cancelled(_)) => panic!("not cancelled"),
        Ok(calibration) => assert!(calibration.slices.iter().all(|s| s.homography.matrix().determinant() > 0.0)),
    }
}

#[test]
fn a_blank_slice_is_predicted_from_the_rail_law() {
    let (rasters, truths) = with_a_blank_end(5);
    let calibration = calibrate(&Stack(&rasters), &CalibrationOptions::default(), &NoControl).expect("a calibration");
    let last = &calibration.slices[4];
    assert!(last.interpolated && last.rms_px.is_none() && last.inliers == Some(0));
    assert!(calibration.slices[..4].iter().all(|s| !s.interpolated));
    assert!(calibration.warnings.iter().any(|w| w.code == "slice_interpolated" && w.detail.contains("e.png")));
    assert!(worst_corner(&calibration, &truths) < 0.3);
    let drawn = overlay(&rasters[4], &calibration, 4);
    assert_ne!(drawn.samples, overlay(&rasters[4], &calibration, 99).samples, "the prediction is drawn");
}

#[test]
fn a_blank_slice_is_refused_by_name_when_there_are_too_few_others() {
    let (rasters, _) = with_a_blank_end(3);
    let fault = fault(&rasters);
    assert_eq!(fault.kind, ErrorKind::TargetNotFound);
    assert!(fault.detail.contains("c.png"), "{}", fault.detail);
    assert_eq!(fault.locations.iter().filter_map(|p| p.slice).collect::<Vec<_>>(), [2]);
}

#[test]
fn the_reference_need_not_be_the_sharpest_slice() {
    let (rasters, truths) = stack(&Shot::default(), 4, 2.0, 3, 0.05);
    let options = CalibrationOptions {
        reference_index: Some(0),
        target_pitch_mm: Some(0.5),
        pixel_pitch_mm: Some(0.01),
        ..CalibrationOptions::default()
    };
    let calibration = calibrate(&Stack(&rasters), &options, &NoControl).expect("a calibration");
    assert_eq!(calibration.slices[0].homography, Homography::IDENTITY);
    let way = truths[0].inverse().expect("regular");
    let to_first: Vec<Homography> = truths.iter().map(|t| t.then(&way).expect("regular")).collect();
    assert!(worst_corner(&calibration, &to_first) < 0.1);
    let magnification = calibration.magnification.expect("both pitches were specified");
    assert!((magnification - calibration.dot_pitch_px * 0.01 / 0.5).abs() < 1e-12);
    assert!((calibration.dot_pitch_px * truths[0].scale_at([240.0, 180.0]) / 30.0 - 1.0).abs() < 0.01);
}

#[test]
fn a_drift_of_a_third_of_the_pitch_with_six_percent_of_scale_is_followed() {
    let truths = [
        Homography::similarity(1.06, [-14.4 + 9.0, -10.8 - 7.0]),
        Homography::IDENTITY,
        Homography::similarity(0.94, [14.4 - 6.0, 10.8 + 8.0]),
    ];
    let rasters: Vec<Raster> = truths
        .iter()
        .map(|t| {
            render(&Shot {
                homography: *t,
                grid: [21, 15],
                blur: if t.is_identity() { 1.0 } else { 5.0 },
                ..Shot::default()
            })
        })
        .collect();
    let calibration = calibrate(&Stack(&rasters), &CalibrationOptions::default(), &NoControl).expect("a calibration");
    print(&calibration, &truths);
    assert!(worst_corner(&calibration, &truths) < 0.1);
}

#[test]
fn dust_and_a_scratch_cost_no_accuracy() {
    let (mut rasters, truths) = stack(&Shot::default(), 3, 1.0, 6, 0.05);
    let mut noise = Noise(11);
    for raster in &mut rasters {
        let Samples::Eight(samples) = &mut raster.samples else { panic!("rendered with 8 bits") };
        for _ in 0..25 {
            let (cx, cy) = (240.0 + 230.0 * noise.even(), 180.0 + 170.0 * noise.even());
            for (k, sample) in samples.iter_mut().enumerate() {
                let (x, y) = ((k % 480) as f64, (k / 480) as f64);
                if (x - cx).hypot(y - cy) < 3.5 {
                    *sample = 30;
                }
            }
        }
        for x in 60..400 {
            samples[(90 + x / 3) * 480 + x] = 40;
        }
    }
    let calibration = calibrate(&Stack(&rasters), &CalibrationOptions::default(), &NoControl).expect("a calibration");
    print(&calibration, &truths);
    assert!(worst_corner(&calibration, &truths) < 0.15, "{}", worst_corner(&calibration, &truths));
    assert!(calibration.slices.iter().all(|s| s.inliers.is_some_and(|n| n >= 90)));
}

#[test]
fn clipped_white_is_reported() {
    let (rasters, _) = stack(&Shot { white: 330.0, ..Shot::default() }, 3, 1.0, 2, 0.0);
    let calibration = calibrate(&Stack(&rasters), &CalibrationOptions::default(), &NoControl).expect("a calibration");
    assert!(calibration.warnings.iter().any(|w| w.code == "clipped_white"), "{:?}", calibration.warnings);
}

#[test]
fn the_same_pictures_give_the_same_numbers_on_one_thread_and_on_many() {
    let (rasters, _) = stack(&Shot::default(), 3, 2.0, 8, 0.05);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| calibrate(&Stack(&rasters), &CalibrationOptions::default(), &NoControl)).expect("a calibration")
    };
    let (one, three) = (on(1), on(3));
    assert_eq!(one.slices, three.slices);
    assert_eq!(one.dots, three.dots);
}

#[test]
fn cancellation_stops_the_calibration_and_progress_reaches_the_end() {
    struct Watch(Mutex<Vec<(&'static str, usize, usize)>>, usize);
    impl Control for Watch {
        fn progress(&self, stage: &'static str, completed: usize, total: usize) {
            self.0.lock().expect("unpoisoned").push((stage, completed, total));
        }
        fn check(&self) -> Result<(), Cancelled> {
            let detecting = self.0.lock().expect("unpoisoned").iter().filter(|p| p.0 == "detecting").count();
            if detecting > self.1 { Err(Cancelled) } else { Ok(()) }
        }
    }
    let (rasters, _) = stack(&Shot::default(), 3, 1.0, 9, 0.0);
    let early = Watch(Mutex::default(), 1);
    let stopped = calibrate(&Stack(&rasters), &CalibrationOptions::default(), &early);
    assert!(matches!(stopped, Err(Interrupted::Cancelled(_))));
    let late = Watch(Mutex::default(), usize::MAX);
    calibrate(&Stack(&rasters), &CalibrationOptions::default(), &late).expect("a calibration");
    let steps = late.0.into_inner().expect("unpoisoned");
    let mut detecting: Vec<usize> = steps.iter().filter(|s| s.0 == "detecting").map(|s| s.1).collect();
    assert!(detecting.contains(&3));
    detecting.dedup();
    assert_eq!(detecting.first(), Some(&0));
}

#[test]
fn the_overlay_marks_the_dots_and_nothing_else() {
    let (rasters, _) = stack(&Shot::default(), 2, 1.0, 10, 0.0);
    let calibration = calibrate(&Stack(&rasters), &CalibrationOptions::default(), &NoControl).expect("a calibration");
    let picture = overlay(&rasters[0], &calibration, 0);
    assert_eq!((picture.width, picture.height, picture.channels), (480, 360, 3));
    let (Samples::Eight(drawn), Samples::Eight(grey)) = (&picture.samples, &rasters[0].samples) else {
        panic!("8 bits")
    };
    let dot = calibration.dots[0][20];
    let at = dot.at[1].round() as usize * 480 + dot.at[0].round() as usize;
    assert!(drawn[3 * at + 1] > drawn[3 * at] + 60, "green on the dot");
    assert_eq!(drawn[..3], [grey[0]; 3], "the corner stays as it is");
}

#[test]
fn sharp_dots_far_larger_than_needed_are_measured_at_a_lower_resolution() {
    let truths = [Homography::similarity(1.03, [-13.0, -9.0]), Homography::IDENTITY];
    let shots = truths.map(|homography| Shot {
        homography,
        width: 900,
        height: 680,
        grid: [6, 5],
        pitch: 125.0,
        ..Shot::default()
    });
    let rasters = shots.map(|shot| render(&shot));
    let calibration = calibrate(&Stack(&rasters), &CalibrationOptions::default(), &NoControl).expect("a calibration");
    print(&calibration, &truths);
    assert!(worst_corner(&calibration, &truths) < 0.2);
}
