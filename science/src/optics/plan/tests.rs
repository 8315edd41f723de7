//! Plans against the paper, the literature and the renderer.

use super::*;
use crate::synth::Rig;
use proptest::prelude::*;

fn macro_lens(mode: CaptureMode) -> PlanInput {
    PlanInput {
        focal_mm: 65.0,
        f_number: 8.0,
        magnification: Some(1.0),
        object_distance_mm: None,
        pixel_pitch_um: 4.14,
        object_depth_mm: 5.0,
        mode,
        image_width: Some(8688),
        image_height: Some(5792),
        pupil_ratio: 1.0,
        overlap: 0.5,
        wavelength_nm: 550.0,
        coc_um: None,
        rail_resolution_um: None,
        slice_count: None,
    }
}

/// Equations 1 to 6 of Li and Nguyen (2019), in every printed form that is right.
#[test]
fn depth_of_focus_and_field_are_those_of_the_paper() {
    for (magnification, coc_um) in [(0.5, 25.0), (1.0, 25.0), (1.7, 10.0)] {
        let input = PlanInput {
            magnification: Some(magnification),
            coc_um: Some(coc_um),
            ..macro_lens(CaptureMode::MovingLens)
        };
        let plan = plan(&input).expect("a plan");
        let (f, n, c) = (65.0, 8.0, coc_um * 1e-3);
        let (d2, aperture) = (f * (1.0 + magnification), f / n);
        let d1 = d2 / magnification;
        let focus = [2.0 * c / aperture * d2, 2.0 * n * c / f * d2];
        let field = [2.0 * c / (magnification * aperture) * d1, 2.0 * d1 * d1 * c / (d2 * aperture)];
        // equations 1 and 4, as they are printed
        let ratio = plan.depth_of_focus_mm.geometric / (2.0 * d2);
        assert!((ratio - c / aperture).abs() < 1e-12, "equation 1");
        let ratio = plan.depth_of_field_mm.geometric / (2.0 * d1);
        assert!((ratio - c / (magnification * aperture)).abs() < 1e-12, "equation 4");
        // equations 2 and 3, and 5 and 6
        for expected in focus {
            assert!((plan.depth_of_focus_mm.geometric - expected).abs() < 1e-12);
        }
        for expected in field {
            assert!((plan.depth_of_field_mm.geometric - expected).abs() < 1e-12);
        }
        // the last form of equation 6, with f and d1 - f exchanged back
        let corrected = 2.0 * c * d1 * (d1 - f) / (f * aperture);
        assert!((plan.depth_of_field_mm.geometric - corrected).abs() < 1e-12);
        let printed = 2.0 * d1 * f * c / ((d1 - f) * aperture);
        assert!((printed / corrected - magnification * magnification).abs() < 1e-12, "wrong by M^2");
    }
}

#[test]
fn diffraction_is_that_of_the_literature() {
    // M = 1, f/16: 4 lambda N_eff^2 = 2.253 mm, and the classic depth of field with c = 0.03 mm is 1.92 mm
    let input = PlanInput { f_number: 16.0, coc_um: Some(30.0), ..macro_lens(CaptureMode::MovingLens) };
    let plan = plan(&input).expect("a plan");
    assert!((plan.depth_of_field_mm.wave - 2.253).abs() < 1e-3, "{:?}", plan.depth_of_field_mm);
    assert!((plan.depth_of_field_mm.geometric - 1.92).abs() < 1e-12);
    assert_eq!(plan.effective_f_number, 32.0);
    assert!((plan.airy_um - 42.944).abs() < 1e-9);
}

#[test]
fn the_ends_of_the_object_are_in_focus_in_the_first_and_the_last_slice() {
    for mode in [CaptureMode::FixedLens, CaptureMode::MovingLens] {
        let plan = plan(&macro_lens(mode)).expect("a plan");
        let (first, last) = (plan.slices.first().expect("slices"), plan.slices.last().expect("slices"));
        assert!(first.depth_mm.abs() < 1e-9 && (last.depth_mm - 5.0).abs() < 1e-9, "{first:?} {last:?}");
        assert!(plan.step_mm <= plan.largest_step_mm);
        assert_eq!(plan.rail_positions_mm.len() as u32, plan.slice_count);
        let reference = plan.slices[plan.reference_index as usize];
        assert_eq!((reference.scale, reference.exposure_ratio, reference.target_blur_px), (1.0, 1.0, 0.0));
        let field = plan.field_of_view_mm.expect("the size of the image is known");
        assert!((field[0] - 35.968).abs() < 1e-3);
    }
}

#[test]
fn neighbouring_slices_share_what_was_asked_of_what_is_seen() {
    for (f_number, magnification, overlap) in [(5.6, 1.0, 0.5), (4.0, 2.5, 0.5), (8.0, 0.5, 0.75), (2.8, 4.0, 0.0)] {
        for mode in [CaptureMode::FixedLens, CaptureMode::MovingLens] {
            let input = PlanInput { f_number, magnification: Some(magnification), overlap, ..macro_lens(mode) };
            let plan = plan(&input).expect("a plan");
            let is_fixed = mode == CaptureMode::FixedLens;
            let depth = if is_fixed { plan.depth_of_focus_mm.total } else { plan.depth_of_field_mm.total };
            // with a fixed lens a slice with a smaller depth than that of the middle decides, so more is shared there
            let more = 1.0 - plan.largest_step_mm / depth - overlap;
            let most = if is_fixed { 0.2 } else { 1e-9 };
            assert!((-1e-9..most).contains(&more), "{mode:?}, f/{f_number}: {more} more than {overlap}");
        }
    }
}

/// Computed apart from this program, by Hopkins's integral over 4001 samples.
#[test]
fn the_contrast_between_slices_is_that_of_a_defocused_lens() {
    for (f_number, overlap, contrast) in [(5.6, 0.5, 0.798), (5.6, 0.75, 0.947), (8.0, 0.5, 0.830)] {
        let input = PlanInput { f_number, overlap, object_depth_mm: 20.0, ..macro_lens(CaptureMode::MovingLens) };
        let plan = plan(&input).expect("a plan");
        let found = plan.contrast_between_slices.expect("the lens resolves it");
        assert!((found - contrast).abs() < 0.001, "f/{f_number}, overlap {overlap}: {found}");
    }
    let blurred = PlanInput { f_number: 64.0, ..macro_lens(CaptureMode::MovingLens) };
    assert_eq!(plan(&blurred).expect("a plan").contrast_between_slices, None);
}

/// The renderer has optics of its own.
#[test]
fn scale_exposure_and_blur_are_those_of_a_rendered_rig() {
    for mode in [CaptureMode::FixedLens, CaptureMode::MovingLens] {
        let input = PlanInput { slice_count: Some(7), ..macro_lens(mode) };
        let plan = plan(&input).expect("a plan");
        let sign = if mode == CaptureMode::FixedLens { -1.0 } else { 1.0 };
        let reference = plan.reference_index as usize;
        let rig = Rig {
            mode,
            focal_mm: 65.0,
            f_number: 8.0,
            pixel_pitch_mm: 0.00414,
            magnification: plan.slices[reference].magnification,
            // the renderer counts the position of the sensor away from the lens
            rail_mm: plan.rail_positions_mm.iter().map(|z| sign * z).collect(),
            reference,
            ..Rig::sized(600, 400, 7).ideal()
        };
        for (i, slice) in plan.slices.iter().enumerate() {
            let in_focus = rig.focus_fraction(reference);
            assert!((1.0 / rig.scale(i, in_focus) - slice.scale).abs() < 1e-12, "{mode:?} {i}");
            assert!((rig.exposure(i) - slice.exposure_ratio).abs() < 1e-12, "{mode:?} {i}");
            assert!((rig.blur_radius_px(i, in_focus) - slice.target_blur_px).abs() < 1e-6, "{mode:?} {i}");
        }
    }
}

/// Chief rays and cones of a lens with pupils, traced: the pupils are `f (1 - 1/P)` before and `f (1 - P)` behind the
/// principal planes, the exit pupil is `P` times as wide, and a ray leaves at `1/P` of the angle.
#[test]
fn a_pupil_ratio_moves_the_centre_of_projection() {
    for (mode, pupil_ratio) in [CaptureMode::FixedLens, CaptureMode::MovingLens]
        .into_iter()
        .flat_map(|mode| [(mode, 0.5), (mode, 1.0), (mode, 2.0)])
    {
        let plan = plan(&PlanInput { pupil_ratio, slice_count: Some(5), ..macro_lens(mode) }).expect("a plan");
        let (f, n, p) = (65.0, 8.0, pupil_ratio);
        let reference = plan.slices[plan.reference_index as usize];
        let target = f * (1.0 + 1.0 / reference.magnification);
        let seen = |slice: &PlannedSlice| {
            let advance = if mode == CaptureMode::MovingLens { slice.rail_mm - reference.rail_mm } else { 0.0 };
            let (distance, sensor) = (target - advance, f * (1.0 + slice.magnification));
            let height = (sensor - f * (1.0 - p)) / p / (distance - f * (1.0 - 1.0 / p));
            let image = f * distance / (distance - f);
            let blur = p * f / n * (sensor - image).abs() / (image - f * (1.0 - p));
            (height, blur / 2.0 / 0.00414)
        };
        for slice in &plan.slices {
            let (height, blur) = seen(slice);
            assert!((seen(&reference).0 / height - slice.scale).abs() < 1e-12, "{mode:?} {p}");
            assert!((blur - slice.target_blur_px).abs() < 1e-8 * (1.0 + blur), "{mode:?} {p}: {blur} {slice:?}");
        }
        let principal = f * (1.0 + reference.magnification / p);
        assert!((plan.principal_distance_mm - principal).abs() < 1e-9);
        assert_eq!(plan.reference_magnification, reference.magnification);
    }
}

#[test]
fn a_lens_that_would_reach_the_object_is_refused() {
    let deep = |object_depth_mm, slice_count| {
        plan(&PlanInput { object_depth_mm, slice_count, ..macro_lens(CaptureMode::MovingLens) })
    };
    for count in [2, 3, 900] {
        for depth in [130.0, 200.0, 259.0] {
            let error = deep(depth, Some(count)).expect_err("130 mm are free");
            assert!(error.detail.contains("would reach the nearest"), "{}", error.detail);
        }
        // the entrance pupil is nearer than the lens
        let input = PlanInput { object_depth_mm: 100.0, pupil_ratio: 2.0, ..macro_lens(CaptureMode::MovingLens) };
        let error = plan(&input).expect_err("97.5 mm are free");
        assert!(error.detail.contains("only 97.4 mm are free"), "{}", error.detail);
        let plan = deep(129.0, Some(count)).expect("just not");
        assert!(plan.slices.iter().all(|slice| slice.scale > 0.0 && slice.target_blur_px.is_finite()));
    }
}

#[test]
fn warnings_name_what_limits_the_capture() {
    let codes = |change: fn(&mut PlanInput)| {
        let mut input = PlanInput { f_number: 5.6, ..macro_lens(CaptureMode::FixedLens) };
        change(&mut input);
        let plan = plan(&input).expect("a plan");
        plan.warnings.into_iter().map(|warning| warning.code.to_string()).collect::<Vec<_>>()
    };
    assert_eq!(codes(|_| {}), Vec::<String>::new());
    assert_eq!(codes(|input| input.f_number = 16.0), ["diffraction_limited", "oversampled"]);
    assert_eq!(codes(|input| input.slice_count = Some(3)), ["too_few_slices"]);
    assert_eq!(codes(|input| input.rail_resolution_um = Some(500.0)), ["step_below_rail_resolution"]);
    assert_eq!(
        codes(|input| (input.magnification, input.object_depth_mm, input.coc_um) = (Some(1e-3), 1000.0, Some(30.0))),
        ["first_order"]
    );
}

#[test]
fn warnings_say_what_helps() {
    let told = |code: &str, change: fn(&mut PlanInput)| {
        let mut input = PlanInput { f_number: 5.6, ..macro_lens(CaptureMode::FixedLens) };
        change(&mut input);
        let warnings = plan(&input).expect("a plan").warnings;
        warnings.into_iter().find(|warning| warning.code == code).expect(code).detail
    };
    let code = "step_below_rail_resolution";
    let planned = told(code, |input| input.rail_resolution_um = Some(500.0));
    assert!(planned.ends_with("stop down or accept a smaller overlap"), "{planned}");
    let given = told(code, |input| (input.rail_resolution_um, input.slice_count) = (Some(500.0), Some(200)));
    assert!(given.ends_with("take fewer slices"), "{given}");
    for count in [None, Some(2)] {
        let mut thin = PlanInput { object_depth_mm: 0.01, slice_count: count, ..macro_lens(CaptureMode::FixedLens) };
        thin.rail_resolution_um = Some(500.0);
        let warnings = plan(&thin).expect("a plan").warnings;
        let thin = &warnings.iter().find(|warning| warning.code == code).expect(code).detail;
        assert!(thin.ends_with("one slice may do"), "{thin}");
    }
    let first_order = told("first_order", |input| {
        (input.magnification, input.object_depth_mm, input.coc_um) = (Some(1e-3), 1000.0, Some(30.0));
    });
    // c N / (M f) = 0.03 * 5.6 / (0.001 * 65)
    assert!(first_order.contains("is 2.58 of the aperture"), "{first_order}");
}

#[test]
fn what_cannot_be_planned_is_refused_with_its_parameter() {
    let refused = |change: fn(&mut PlanInput)| {
        let mut input = macro_lens(CaptureMode::FixedLens);
        change(&mut input);
        plan(&input).expect_err("it breaks a rule").locations[0].pointer.clone().expect("a parameter")
    };
    assert_eq!(refused(|input| input.focal_mm = f64::NAN), "focal_mm");
    assert_eq!(refused(|input| input.object_depth_mm = 200.0), "object_depth_mm");
    assert_eq!(refused(|input| (input.object_depth_mm, input.f_number) = (60.0, 0.5)), "object_depth_mm");
    assert_eq!(refused(|input| input.magnification = None), "magnification");
    assert_eq!(refused(|input| input.object_distance_mm = Some(130.0)), "object_distance_mm");
    assert_eq!(
        refused(|input| (input.magnification, input.object_distance_mm) = (None, Some(60.0))),
        "object_distance_mm"
    );
}

proptest! {
    #[test]
    fn every_plan_is_finite_and_ordered(
        focal_mm in 1.0..300.0f64,
        f_number in 1.0..64.0f64,
        magnification in 0.05..20.0f64,
        object_depth_mm in 0.01..50.0f64,
        is_fixed: bool,
    ) {
        let mode = if is_fixed { CaptureMode::FixedLens } else { CaptureMode::MovingLens };
        let magnification = Some(magnification);
        let input = PlanInput { focal_mm, f_number, magnification, object_depth_mm, ..macro_lens(mode) };
        let Ok(plan) = plan(&input) else { return Ok(()) };
        prop_assert!((2..=MAX_SLICES as u32).contains(&plan.slice_count));
        prop_assert!(plan.rail_positions_mm.windows(2).all(|pair| pair[0] < pair[1]));
        prop_assert!(plan.slices.windows(2).all(|pair| pair[0].depth_mm < pair[1].depth_mm));
        let numbers = plan.slices.iter().flat_map(|s| [s.scale, s.exposure_ratio, s.target_blur_px]);
        prop_assert!(numbers.chain([plan.step_mm, plan.travel_mm]).all(f64::is_finite));
        // by distance instead of magnification
        let by_distance = PlanInput {
            magnification: None,
            object_distance_mm: Some(plan.object_distance_mm),
            slice_count: Some(plan.slice_count),
            ..input
        };
        let same = super::plan(&by_distance).expect("the same optics");
        prop_assert!((same.travel_mm / plan.travel_mm - 1.0).abs() < 1e-6);
    }
}
