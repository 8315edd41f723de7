//! A report for the tests: a fixed-lens rig, by default 13 slices, the last one interpolated, two outliers in the
//! third.

use pinstack_science::types::{
    Warning, WarningCode,
    profile::{CaptureMode, HomographyModel},
    pupils::{PrincipalDistanceSource, Pupils},
    report::{
        CalibrationReport, CameraReport, CaptureReport, DotReport, Drift, Grade, ModelCandidate, RailReport,
        SliceReport, TargetReport,
    },
};

const SIZE: [u32; 2] = [1600, 1200];
const REFERENCE: usize = 6;
const PITCH: f64 = 32.0;
const GROWTH: f64 = 0.0042;
const FIXED: [f64; 2] = [812.0, 574.0];

/// Reproducible noise, approximately normal with standard deviation 1.
pub(super) fn noise(seed: &mut u64) -> f64 {
    let mut sum = 0.0;
    for _ in 0..6 {
        *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        sum += (*seed >> 40) as f64 / (1_u64 << 24) as f64 - 0.5;
    }
    sum * std::f64::consts::SQRT_2
}

/// The report of `count` slices.
pub(super) fn report(count: usize) -> CalibrationReport {
    let reference = REFERENCE.min(count / 2);
    let positions: Vec<f64> = (0..count).map(|i| 0.25 * (i as f64 - reference as f64)).collect();
    CalibrationReport {
        width: SIZE[0],
        height: SIZE[1],
        reference_index: reference as u32,
        verdict:
            "Good: the image corners are good to 0.21 px; dots fit to 0.088 px RMS or better, at least 1,586 dots per \
                  slice, 12 of 13 slices measured"
                .into(),
        grade: Grade::Good,
        findings: vec![Warning::new(
            WarningCode::SliceInterpolated,
            "too blurred to be measured, and therefore predicted from the other slices: target_12.tif",
        )],
        target: Some(TargetReport {
            pitch_px: PITCH,
            pitch_mm: Some(0.5),
            fill: 0.5,
            bright_dots: false,
            asymmetric: false,
            dots: 1728,
            coverage: 0.93,
            magnification: Some(0.288),
            coded: false,
            code: None,
        }),
        model: HomographyModel::RailLinear,
        model_reason: "the rail law has the lowest expected error at the image corners".into(),
        candidates: candidates(),
        capture: CaptureReport {
            confidence: None,
            told: Some(CaptureMode::FixedLens),
            found: Some(CaptureMode::FixedLens),
            detail: "1/scale is linear in the position on the rail to 2e-6; the scale itself is not (4e-5)".into(),
        },
        rail: Some(RailReport {
            growth: GROWTH / 0.25,
            fixed_point_px: Some(FIXED),
            in_mm: true,
            measured_positions: positions
                .iter()
                .enumerate()
                .map(|(i, p)| (i + 1 != count).then_some(p + if i == 9 { 0.0041 } else { 0.0007 }))
                .collect(),
            positions,
            corner_rms_px: 0.074,
        }),
        camera: CameraReport {
            principal_distance_mm: Some(59.52),
            principal_distance_px: Some(13_227.0),
            source: PrincipalDistanceSource::MovedTarget,
            pupils: Pupils {
                principal_distance_sigma_mm: Some(0.083),
                exit_pupil_distance_mm: Some(71.424),
                pupil_ratio: Some(1.2),
                ..Pupils::default()
            },
            measured_focal_mm: None,
            principal_point_px: Some(FIXED),
            pixel_pitch_mm: Some(0.0045),
            focal_mm: Some(46.0),
            detail: "measured with the moved target".into(),
        },
        slices: slices(count, reference),
    }
}

fn slices(count: usize, reference: usize) -> Vec<SliceReport> {
    let mut seed = 7;
    let law = |i: usize| {
        let step = i as f64 - reference as f64;
        let scale = 1.0 / (1.0 + GROWTH * step);
        let centre = SIZE.map(|side| (f64::from(side) - 1.0) / 2.0);
        (scale, [0, 1].map(|a| (1.0 - scale) * (FIXED[a] - centre[a]) + [1.4, -0.7][a] * step))
    };
    (0..count)
        .map(|i| {
            let interpolated = i + 1 == count;
            let (scale, shift) = law(i);
            let step = i as f64 - reference as f64;
            let off = if i == reference { 0.0 } else { 0.05 + 0.04 * noise(&mut seed).abs() };
            let dots = dots(i == reference, interpolated, i == 2, &mut seed);
            SliceReport {
                index: i as u32,
                name: format!("target_{i:02}.tif"),
                scale: scale + 2e-6 * noise(&mut seed),
                law_scale: Some(scale),
                shift_px: shift.map(|s| s + 0.03 * noise(&mut seed)),
                law_shift_px: Some(shift),
                off_law_px: (!interpolated).then_some(off),
                blur_radius_px: (!interpolated).then_some(1.1 + 2.05 * step.abs()),
                contrast: (!interpolated).then_some(0.93 - 0.1 * step.abs()),
                gain: 1.0 + 0.006 * step + 0.001 * noise(&mut seed),
                gain_sigma: None,
                law_gain: None,
                clipped: Some(0.002),
                dots_found: dots.len() as u32,
                inliers: dots.iter().filter(|dot| dot.inlier).count() as u32,
                rms_px: (!interpolated).then_some(if i == reference { 0.0 } else { 0.04 + 0.008 * step.abs() }),
                corner_sigma_px: if i == reference {
                    0.0
                } else {
                    0.02 + 0.012 * step.abs() + if interpolated { 0.12 } else { 0.0 }
                },
                interpolated,
                dots,
            }
        })
        .collect()
}

fn dots(is_reference: bool, interpolated: bool, has_outliers: bool, seed: &mut u64) -> Vec<DotReport> {
    let mut out = Vec::new();
    for row in 0..36 {
        for column in 0..48 {
            let at = [60.0 + PITCH * f64::from(column), 45.0 + PITCH * f64::from(row)];
            if at[0] > 1560.0 || at[1] > 1160.0 {
                continue;
            }
            let bend = [(at[0] - 800.0) / 800.0, (at[1] - 600.0) / 600.0];
            let residual = [0, 1].map(|a| 0.05 * noise(seed) + 0.03 * bend[a] * (bend[0].hypot(bend[1]) - 0.7));
            let outlier = has_outliers && [(11, 30), (27, 9)].contains(&(row, column));
            let residual = if outlier { [1.9, -1.2] } else { residual };
            out.push(DotReport {
                at,
                residual: match () {
                    () if is_reference => Some([0.0; 2]),
                    () if interpolated || column < 1 => None,
                    () => Some(residual),
                },
                inlier: !interpolated && !outlier,
            });
        }
    }
    out
}

fn candidates() -> Vec<ModelCandidate> {
    let candidate = |model, parameters, rms: f64, held_out: f64, bic: f64, sigma: f64| ModelCandidate {
        model,
        parameters,
        rms_px: Some(rms),
        held_out_px: Some(held_out),
        bic: Some(bic),
        corner_sigma_px: Some(sigma),
        chosen: model == HomographyModel::RailLinear,
    };
    vec![
        candidate(HomographyModel::RailLinear, 3, 0.0592, 0.0593, -97_412.0, 0.021),
        candidate(HomographyModel::Similarity, 48, 0.0588, 0.0594, -97_190.0, 0.038),
        candidate(HomographyModel::Affine, 72, 0.0587, 0.0596, -97_003.0, 0.052),
        candidate(HomographyModel::Homography, 96, 0.0585, 0.0599, -96_841.0, 0.066),
    ]
}

/// The drift of the same rig since revision 3.
pub(super) fn drift(count: usize, worst: f64) -> Drift {
    let way = |i: usize| worst * if i == 7 { 1.0 } else { 0.06 * (i as f64 - 6.0).abs() };
    Drift {
        from_revision: 3,
        to_revision: 4,
        corner_px: (0..count).map(|i| Some(way(i))).collect(),
        worst_px: Some(worst),
        worst_slice: Some(7),
        gain_ratio: (0..count).map(|i| Some(1.0 + 0.001 * (i as f64 - 6.0))).collect(),
        detail: format!(
            "slice 7 moved most: {worst:.1} px at a corner since revision 3; stacks taken since then may be affected"
        ),
    }
}
