//! The result and the report of a calibration by stacks.

use super::capture_mode::Shown;
use super::matched::Pair;
use super::model::NetworkModel;
use super::network::{LEAST_SIGMA, NetworkFit, SHARED_ERRORS};
use super::refine::{Movement, Revision};
use crate::calibration::camera::{self, Known};
use crate::calibration::capture;
use crate::calibration::grade::{self, Finding};
use crate::calibration::result::Calibration;
use crate::calibration::size_law::ScaleSample;
use crate::calibration::transform_models::Frame;
use crate::imaging::Slices;
use crate::types::report::{
    CalibrationReport, CameraReport, CaptureReport, Grade, ModelCandidate, RailReport, SliceReport,
};
use crate::types::{
    Error, ErrorKind, Homography, Interrupted, Warning, WarningCode, calibration_options::CalibrationOptions,
    profile::ProfileSlice,
};

/// What is known after the fit.
pub(super) struct Facts<'a> {
    /// The slices of the first view, for their names.
    pub slices: &'a dyn Slices,
    /// Number of views.
    pub views: usize,
    pub pairs: &'a [Pair],
    /// The fits of all models, and the index of the chosen one.
    pub fits: &'a [(NetworkModel, NetworkFit)],
    pub chosen: usize,
    /// What was refined, if a profile was.
    pub refined: Option<Refined<'a>>,
    pub shown: Shown,
    pub gains: &'a [f64],
    /// Rail position per slice: mm where they were given, else slices.
    pub positions: &'a [f64],
    pub in_mm: bool,
    pub reference: usize,
    pub frame: &'a Frame,
    pub size: [u32; 2],
}

/// The profile that was refined, and how far the rig has moved since.
pub(super) struct Refined<'a> {
    pub revision: &'a Revision<'a>,
    pub moved: Movement,
}

impl Refined<'_> {
    /// What was changed, as a sentence.
    fn sentence(&self) -> String {
        let (name, Movement { px, sigma, slice, is_drift }) = (self.revision.name, self.moved);
        match is_drift {
            true => format!(
                "the rig has drifted since {name}: the pictures move the image corners by up to {px:.2} +- {sigma:.2} px \
                 (slice {slice}); gains, distortion, scale and camera are those of {name}"
            ),
            false => format!(
                "the pictures show no drift since {name}: they would move no image corner by more than {px:.2} px (slice \
                 {slice}), and are uncertain by {sigma:.2} px there, so all of {name} is kept"
            ),
        }
    }

    /// The camera of the revision.
    fn camera(&self) -> CameraReport {
        let input = self.revision.input;
        CameraReport {
            principal_distance_mm: input.principal_distance_mm,
            principal_distance_px: input.principal_distance_px(),
            source: input.principal_distance_source.unwrap_or_default(),
            pupils: input.pupils,
            principal_point_px: input.principal_point_px,
            pixel_pitch_mm: input.pixel_pitch_mm,
            detail: format!("that of {}", self.revision.name),
            ..CameraReport::default()
        }
    }
}

/// The result.
///
/// # Errors
/// An error that names a slice with an impossible homography.
pub(super) fn calibration(facts: &Facts<'_>, options: &CalibrationOptions) -> Result<Calibration, Interrupted> {
    let (model, fit) = &facts.fits[facts.chosen];
    let slices = profile_slices(facts, fit)?;
    let worst = slices.iter().filter_map(|s| s.corner_sigma_px).fold(0.0, f64::max);
    let sizes = sizes(facts, fit, &slices);
    let told = facts.refined.as_ref().map_or(options.capture_mode, |refined| refined.revision.input.capture_mode);
    let capture = capture::decide_by(&sizes, facts.in_mm, told, facts.shown.likelihoods());
    let capture_mode = match facts.refined {
        Some(_) => told,
        None => capture.found.or(told),
    };
    let known = Known {
        magnification: None,
        sizes: if facts.in_mm { &sizes } else { &[] },
        capture: capture_mode,
        pitch_px: [0.0, 1.0],
    };
    let (camera, contradictions) = match &facts.refined {
        Some(refined) => (refined.camera(), Vec::new()),
        None => camera::camera(options, known),
    };
    let kept = facts.refined.as_ref().map(|refined| refined.revision);
    let rail = rail(facts, fit);
    let finding = match &facts.refined {
        Some(refined) => refined.sentence(),
        None => finding(facts, rail.growth, &capture),
    };
    let mut findings = vec![Finding::limiting(Grade::Usable, WarningCode::CalibratedByStacks, finding)];
    if let (Some(given), Some(found)) = (capture.told, capture.found)
        && given != found
    {
        findings.push(Finding::remark(WarningCode::CaptureModeDisagrees, capture::disagreement(given, found)));
    }
    findings.extend(contradictions.into_iter().map(|c| Finding::limiting(Grade::Usable, c.code, c.detail)));
    let (grade, _) = grade::grade(worst, &findings);
    let verdict = verdict(facts, grade, worst);
    let warnings: Vec<Warning> = findings.into_iter().map(|finding| finding.warning).collect();
    let profile_model = kept.map_or(model.name(), |kept| kept.model);
    let [width, height] = facts.size;
    let report = CalibrationReport {
        width,
        height,
        reference_index: facts.reference as u32,
        verdict: verdict.clone(),
        grade,
        findings: warnings.clone(),
        target: None,
        model: profile_model,
        model_reason: model_reason(facts),
        candidates: candidates(facts),
        capture,
        rail: Some(rail),
        camera,
        slices: slices.iter().map(|slice| slice_report(facts, slice)).collect(),
    };
    Ok(Calibration {
        width,
        height,
        reference_index: facts.reference,
        dots: vec![Vec::new(); slices.len()],
        slices,
        dot_pitch_px: f64::NAN,
        magnification: kept.and_then(|kept| kept.input.magnification),
        capture_mode,
        model: profile_model,
        distortion: kept.and_then(|kept| kept.input.distortion),
        lateral_colour: kept.and_then(|kept| kept.input.lateral_colour),
        warnings,
        verdict,
        report,
    })
}

/// The slices of the profile.
fn profile_slices(facts: &Facts<'_>, fit: &NetworkFit) -> Result<Vec<ProfileSlice>, Error> {
    let [width, height] = facts.size;
    let slice = |index: usize| {
        let (agreeing, rms) = fit.agreeing[index];
        let homography = match index == facts.reference {
            true => Some(Homography::IDENTITY),
            false => facts.frame.homography(&fit.parameters[index]).filter(|h| h.violation(width, height).is_none()),
        };
        let Some(homography) = homography else {
            let name = facts.slices.name(index);
            let detail = format!(
                "the geometry that was found for {name} (slice {index}) is impossible: check that it shows the same view \
                 as the slices beside it"
            );
            return Err(Error::new(ErrorKind::TargetNotFound, detail).in_file(name, Some(index as u32)));
        };
        let sigma = match index == facts.reference {
            true => 0.0,
            false => fit.stated_sigma(index),
        };
        Ok(ProfileSlice {
            rms_px: (agreeing > 0).then_some(rms),
            corner_sigma_px: Some(sigma),
            ..ProfileSlice::given(index as u32, homography, facts.gains[index], width, height)
        })
    };
    (0..fit.parameters.len()).map(slice).collect()
}

/// The verdict in one sentence. `worst`: the largest standard deviation of an image corner, px.
fn verdict(facts: &Facts<'_>, grade: Grade, worst: f64) -> String {
    let what = match &facts.refined {
        Some(Refined { revision, moved }) if moved.is_drift => {
            format!("{} refined (the worst image corner moved by {:.2} px) from", revision.name, moved.px)
        }
        Some(Refined { revision, .. }) => format!("no drift since {} by", revision.name),
        None => "calibrated from".to_owned(),
    };
    format!(
        "{}: {what} {} of the object itself, without a target; the image corners are uncertain by {worst:.2} px; at least {} \
         windows per slice",
        grade::word(grade),
        if facts.views == 1 { "one stack".to_owned() } else { format!("{} stacks", facts.views) },
        facts.fits[facts.chosen].1.agreeing.iter().map(|a| a.0).min().unwrap_or(0)
    )
}

/// Why the model was chosen, in one sentence.
fn model_reason(facts: &Facts<'_>) -> String {
    let (model, _) = &facts.fits[facts.chosen];
    match &facts.refined {
        Some(Refined { revision, moved }) if moved.is_drift => format!(
            "{} is the simplest change of the homographies of {} that agrees with the windows of all slices",
            model.phrase(),
            revision.name
        ),
        Some(Refined { revision, .. }) => {
            format!("no change of the homographies of {} is larger than its own uncertainty", revision.name)
        }
        None => format!("{} is the simplest model that agrees with the windows of all slices", model.phrase()),
    }
}

/// How large the object is in each slice, relative to the reference slice.
fn sizes(facts: &Facts<'_>, fit: &NetworkFit, slices: &[ProfileSlice]) -> Vec<ScaleSample> {
    let sample = |(index, p): (usize, &[f64; 8])| ScaleSample {
        position: facts.positions[index] - facts.positions[facts.reference],
        size: 1.0 + p[0],
        sigma: slices[index].corner_sigma_px.unwrap_or(0.0).max(LEAST_SIGMA) / facts.frame.half,
    };
    fit.parameters.iter().enumerate().map(sample).collect()
}

/// Growth and fixed point.
fn rail(facts: &Facts<'_>, fit: &NetworkFit) -> RailReport {
    let offsets = || facts.positions.iter().map(|z| z - facts.positions[facts.reference]);
    let square: f64 = offsets().map(|z| z * z).sum();
    let slope = |k: usize| offsets().zip(&fit.parameters).map(|(z, p)| z * p[k]).sum::<f64>() / square.max(1e-30);
    let (growth, across, down) = (slope(0), slope(2), slope(5));
    let span = offsets().fold(0.0_f64, |m, z| m.max(z.abs()));
    RailReport {
        growth,
        fixed_point_px: (growth.abs() * span > 2e-3).then(|| facts.frame.pixel([-across / growth, -down / growth])),
        in_mm: facts.in_mm,
        positions: facts.positions.to_vec(),
        measured_positions: vec![None; facts.positions.len()],
        corner_rms_px: 0.0,
    }
}

/// What such a calibration means, and what it depends on.
fn finding(facts: &Facts<'_>, growth: f64, capture: &CaptureReport) -> String {
    let offsets = || facts.positions.iter().map(|z| z - facts.positions[facts.reference]);
    let most = offsets().map(|z| (growth * z).powi(2) / 2.0).fold(0.0, f64::max) * facts.frame.half;
    let measured = match facts.shown.parallax {
        Some([share, sigma]) if sigma < 1.0 => {
            format!(" (measured: {:.1} +- {:.1} px)", share.max(0.0) * most, sigma * most)
        }
        _ => String::new(),
    };
    let perspective = match capture.found.or(capture.told) {
        Some(crate::types::profile::CaptureMode::FixedLens) => String::new(),
        _ if most < 0.05 => String::new(),
        _ => format!(
            "; if the lens moved, the fused picture departs from that of one viewpoint by up to {most:.1} px{measured}"
        ),
    };
    format!(
        "the profile was made from {} pairs of slices of the object, not from a dot target: neither the scale nor the \
         principal distance is known from it{perspective}; {}",
        facts.pairs.len(),
        capture.detail
    )
}

/// All models that were compared.
fn candidates(facts: &Facts<'_>) -> Vec<ModelCandidate> {
    let candidate = |(index, (model, fit)): (usize, &(NetworkModel, NetworkFit))| {
        let (count, square) = fit
            .agreeing
            .iter()
            .fold((0.0, 0.0), |(n, sum), (a, rms)| (n + f64::from(*a), sum + f64::from(*a) * rms * rms));
        ModelCandidate {
            model: model.name(),
            parameters: fit.free as u32,
            rms_px: (count > 0.0).then(|| (square / count).sqrt()),
            held_out_px: None,
            bic: None,
            corner_sigma_px: Some(SHARED_ERRORS * fit.corner_sigma.iter().copied().fold(0.0, f64::max)),
            chosen: index == facts.chosen,
        }
    };
    facts.fits.iter().enumerate().map(candidate).collect()
}

fn slice_report(facts: &Facts<'_>, slice: &ProfileSlice) -> SliceReport {
    SliceReport {
        index: slice.index,
        name: facts.slices.name(slice.index as usize).to_owned(),
        scale: slice.scale,
        law_scale: None,
        shift_px: slice.shift_px,
        law_shift_px: None,
        off_law_px: None,
        blur_radius_px: None,
        contrast: None,
        gain: slice.gain,
        gain_sigma: None,
        law_gain: None,
        clipped: None,
        dots_found: 0,
        inliers: 0,
        rms_px: slice.rms_px,
        corner_sigma_px: slice.corner_sigma_px.unwrap_or(0.0),
        interpolated: false,
        dots: Vec::new(),
    }
}
