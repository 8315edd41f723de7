//! The comparison of a calibrated stack with its truth.

use pinstack_science::{
    calibration::{Calibration, calibrate},
    imaging::{Raster, Slices},
    synth::render_target,
    types::{Homography, NoControl, calibration_options::CalibrationOptions, report::Grade},
};

use super::family::Stack;

/// A corner farther off than this is wrong, px.
const WRONG: f64 = 0.3;
/// A corner farther off than three told sigmas and this is dishonest, px.
const DISHONEST: f64 = 0.05;
/// Where all corners are as near as this, and all gains right, a clean stack deserves Good, px.
const RIGHT: f64 = 0.15;
/// A gain farther off than this must be named, as a share.
const GAIN: f64 = 0.005;

/// What became of a stack.
pub struct Judgement {
    pub family: &'static str,
    pub what: String,
    /// `None`: refused.
    pub grade: Option<Grade>,
    /// Largest error of an image corner, px.
    pub corner: f64,
    /// A corner is off by more than [`WRONG`].
    pub wrong: bool,
    /// A corner is off by more than three told sigmas and [`DISHONEST`].
    pub dishonest: bool,
    /// Not Good, although it deserved to be.
    pub downgraded: bool,
    /// Largest error of a gain, as a share.
    pub gain: f64,
    /// A gain is off by more than [`GAIN`], and no finding tells.
    pub gain_untold: bool,
    /// A finding names the fault; `None` where there is nothing to name.
    pub named: Option<bool>,
    /// Codes of all findings, or the reason of the refusal.
    pub told: String,
}

/// Renders and calibrates a stack, and compares the result with the truth.
pub fn judge(stack: &Stack) -> Judgement {
    let images: Vec<Raster> = stack.order.iter().map(|&i| render_target(&stack.rig, &stack.target, i)).collect();
    let result = calibrate(&&images[..] as &dyn Slices, &CalibrationOptions::default(), &NoControl);
    let mut judgement = Judgement {
        family: stack.family,
        what: stack.what.clone(),
        grade: None,
        corner: f64::NAN,
        wrong: false,
        dishonest: false,
        downgraded: stack.clean,
        gain: f64::NAN,
        gain_untold: false,
        named: None,
        told: String::new(),
    };
    match result {
        Ok(found) => compare(stack, &found, &mut judgement),
        Err(why) => judgement.told = format!("{why:?}").chars().take(160).collect(),
    }
    judgement
}

fn compare(stack: &Stack, found: &Calibration, out: &mut Judgement) {
    let (rig, faults) = (&stack.rig, &stack.target.flaws.faults);
    let reference = stack.order[found.reference_index];
    let lost = faults.replaced.map(|replaced| replaced.0);
    let codes: Vec<&str> = found.warnings.iter().map(|warning| warning.code.as_str()).collect();
    out.corner = 0.0;
    out.gain = 0.0;
    let back = rig.homography(reference).inverse();
    // the middle of the reference slice and the places halfway to its corners: dots are there in every slice
    let [cx, cy] = rig.centre();
    let places = [[1.0, 1.0], [0.5, 0.5], [1.5, 0.5], [0.5, 1.5], [1.5, 1.5]].map(|[x, y]| [cx * x, cy * y]);
    // a gain is applied to the warped slice, so what counts is the white at the same place of the scene
    let white = |i: usize, from: Option<Homography>| {
        let at = |px: [f64; 2]| from.map_or(px, |from| from.apply(px));
        places.iter().map(|&px| stack.target.stored_white(rig, i, at(px))).sum::<f64>()
    };
    for (place, &slice) in stack.order.iter().enumerate() {
        let own = &found.slices[place];
        // another picture in place of the slice has no truth of its own: it should have been refused or predicted
        let map = back.and_then(|back| rig.homography(slice).then(&back));
        let error = map.map_or(f64::INFINITY, |map| {
            let corners = Homography::corners(rig.width as u32, rig.height as u32);
            let off = corners.iter().map(|&corner| {
                let truth = faults.to_reference(rig, &map, corner);
                let found = match &found.distortion {
                    None => own.homography.apply(corner),
                    Some(lens) => lens.distort(own.homography.apply(lens.undistort(corner))),
                };
                (truth[0] - found[0]).hypot(truth[1] - found[1])
            });
            off.fold(0.0, f64::max)
        });
        let error = if error.is_nan() { f64::INFINITY } else { error };
        out.corner = out.corner.max(error);
        out.dishonest |= own.corner_sigma_px.is_some_and(|sigma| error > DISHONEST && error > 3.0 * sigma);
        if Some(slice) != lost {
            let from = map.and_then(|map| map.inverse());
            out.gain = out.gain.max((own.gain * white(slice, from) / white(reference, None) - 1.0).abs());
        }
    }
    out.wrong = out.corner > WRONG;
    let grade = found.report.grade;
    // without an edge in view nothing excludes a shift by a whole pitch
    let is_ambiguous = codes.contains(&"shift_ambiguous") && stack.target.flaws.surround.is_none();
    out.downgraded = stack.clean && grade != Grade::Good && out.corner <= RIGHT && out.gain <= GAIN && !is_ambiguous;
    let told = |code: &&str| ["gain", "exposure", "tint"].iter().any(|part| code.contains(part));
    out.gain_untold = out.gain > GAIN && !codes.iter().any(told);
    out.named = (!stack.codes.is_empty()).then(|| codes.iter().any(|code| stack.codes.contains(code)));
    out.grade = Some(grade);
    let sigma = found.slices.iter().filter_map(|slice| slice.corner_sigma_px).fold(0.0, f64::max);
    out.told = format!("told {sigma:.2} px {}", codes.join(" "));
}
