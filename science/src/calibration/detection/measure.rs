//! Iterative measurement: from approximate dot positions to measured dots.

use std::collections::BTreeMap;

use super::windows::{dot_position, grid_steps, in_picture, selected_labels, windows_at};
use super::{Detection, MAX_SHIFT, MeasuredDot};
use crate::calibration::banding;
use crate::calibration::coarse_registration::SimilarityMotion;
use crate::calibration::code::{CodePlace, SizeDifferences};
use crate::calibration::dlt;
use crate::calibration::dot_photometry;
use crate::calibration::flat_field::{FlatField, Polarity};
use crate::calibration::identity::Fingerprint;
use crate::calibration::inpainting::{self, InpaintedGrid};
use crate::calibration::lattice::{self, Label, MIN_DOTS, Places};
use crate::calibration::phase::{self, PhaseMeasurement, Window};
use crate::calibration::robust;
use crate::calibration::statistics::median;
use crate::calibration::working_image::WorkingImage;
use crate::imaging::Plane;
use crate::types::{Cancelled, Control};

/// Approximate number of dots whose brightness is measured in linear light.
const LIGHT_DOTS: usize = 200;
/// Position error, in grid steps, per synthetic share of a dot's window, while that share is small.
const SYNTHETIC_SIGMA: f64 = 3e-3;
/// Position error, in grid steps, per amplitude of the first harmonic of the full-scale samples in a dot's window.
const CLIPPED_SIGMA: f64 = 0.04;
/// Rounds of flat field, inpainting and phase measurement.
const ROUNDS: usize = 3;

/// Measures all dots, starting from `places` (px of the working image), which are accurate to a tenth of the pitch. On
/// a coded target, `code` is where the labels lie in the code.
pub(super) fn measure(
    image: &WorkingImage,
    mut field: FlatField,
    mut places: Places,
    sign: f64,
    code: Option<&CodePlace>,
    control: &dyn Control,
) -> Result<Option<Detection>, Cancelled> {
    let plane = &image.plane;
    let mut last = None;
    for round in 0..ROUNDS {
        control.check()?;
        let pitch = lattice::pitch_of(&places);
        let contrast = field.contrast(plane);
        let differences = code.and_then(|code| SizeDifferences::measure(&contrast, &places, pitch, code));
        let contrast = match &differences {
            Some(differences) => differences.equalised(contrast),
            None => contrast,
        };
        let mut inpainted = None;
        // the grid may extend beyond the dots known so far
        for _ in 0..if round == 0 { 6 } else { 2 } {
            let beside = lattice::beside(&places);
            let Some(done) = inpainting::inpaint(&contrast, &places, &beside, pitch, round > 0) else {
                return Ok(None);
            };
            let any_added = !done.added.is_empty();
            places.extend(done.added.iter().map(|(label, p)| (*label, *p)));
            inpainted = Some(done);
            if !any_added {
                break;
            }
        }
        let Some(inpainted) = inpainted else { return Ok(None) };
        let mut labels = selected_labels(image, &places);
        labels.retain(|label| !inpainted.hidden.contains(label));
        if inpainted.profile.merges(pitch) {
            drop_near_foreign(&mut labels, &inpainted.foreign);
        }
        let steps = grid_steps(&places);
        let windows = windows_at(&labels, &places, 1.0, steps);
        let phases = phase::measure(&inpainted.contrast, Some(&inpainted.valid), &windows);
        let is_plausible = plausible(&windows, &phases, sign);
        if is_plausible.iter().filter(|p| **p).count() < MIN_DOTS {
            return Ok(None);
        }
        // positions that were not measured follow the consensus homography
        let pairs: Vec<dlt::Pair> = windows
            .iter()
            .zip(&phases)
            .zip(&is_plausible)
            .filter_map(|((window, phase), ok)| {
                phase.filter(|_| *ok).map(|p| (window.at, dot_position(window, &p, sign)))
            })
            .collect();
        let Some(shared) = robust::consensus(&pairs, 0.01 * pitch, 0.1 * pitch) else { return Ok(None) };
        places.values_mut().for_each(|p| *p = shared.homography.apply(*p));
        let mut measured = BTreeMap::new();
        for (((label, window), phase), ok) in labels.iter().zip(&windows).zip(&phases).zip(&is_plausible) {
            let Some(phase) = phase.filter(|_| *ok) else { continue };
            let at = dot_position(window, &phase, sign);
            // a dot far from the consensus is dust or a misprint: its measurement is kept, but not used as the next
            // position
            let there = places.get(label).copied().unwrap_or(at);
            if (at[0] - there[0]).hypot(at[1] - there[1]) < 0.05 * pitch {
                places.insert(*label, at);
            }
            measured.insert(*label, (at, phase));
        }
        let near: Vec<[f64; 2]> = places.values().filter(|p| in_picture(image, p)).copied().collect();
        let restored = differences.map(|differences| differences.restored(&inpainted.rendered));
        let rendered = restored.as_ref().unwrap_or(&inpainted.rendered);
        let refined = field.refine(plane, rendered, &inpainted.ground, &near, 0.8 * pitch, 2 + round.min(2));
        last = Some((measured, inpainted, windows.len(), contrast));
        field = if round + 1 < ROUNDS { refined } else { field };
    }
    Ok(last.and_then(|(measured, inpainted, windows, contrast)| {
        let counted = places.values().filter(|p| in_picture(image, p)).count().max(1);
        let density = windows as f64 / counted as f64;
        let mut detection = detection(image, &field, &places, &measured, &inpainted, sign, density)?;
        let pitch = lattice::pitch_of(&places);
        detection.stripes = banding::amplitude(&contrast, &inpainted.rendered, &inpainted.ground, pitch);
        drop(inpainted);
        detection.fingerprint = Fingerprint::measure(image, &contrast, &places, pitch);
        Some(detection)
    }))
}

/// Drops dots next to positions outside the target, if enough others remain. For merged dots: what lies beyond the
/// target blurs into the outermost ones.
fn drop_near_foreign(labels: &mut Vec<Label>, foreign: &[Label]) {
    let near = |l: &Label| foreign.iter().any(|f| (f[0] - l[0]).abs() <= 1 && (f[1] - l[1]).abs() <= 1);
    let kept: Vec<Label> = labels.iter().filter(|l| !near(l)).copied().collect();
    if kept.len() >= 2 * MIN_DOTS {
        *labels = kept;
    }
}

fn detection(
    image: &WorkingImage,
    field: &FlatField,
    places: &Places,
    measured: &BTreeMap<Label, ([f64; 2], PhaseMeasurement)>,
    inpainted: &InpaintedGrid,
    sign: f64,
    density: f64,
) -> Option<Detection> {
    if measured.len() < MIN_DOTS {
        return None;
    }
    let bin = image.bin as f64;
    let pitch = lattice::pitch_of(places);
    let steps = grid_steps(places);
    let noise = noise_of(&inpainted.contrast);
    let amplitude = |p: &PhaseMeasurement| 0.5 * (p.harmonics[0].amplitude(sign) + p.harmonics[1].amplitude(sign));
    let mut modulations: Vec<f64> = Vec::new();
    let mut dots = BTreeMap::new();
    let windows: Vec<Window> = measured.values().map(|(at, _)| Window { at: *at, steps }).collect();
    let synthetic = phase::measure(&inpainted.synthetic, None, &windows);
    let full = image.full.as_ref().map(|full| phase::measure(full, None, &windows));
    for (k, (label, (at, phase))) in measured.iter().enumerate() {
        let synthetic = synthetic[k].map_or(0.0, |p| p.mean);
        let full = full.as_ref().and_then(|f| f[k]);
        // full-scale samples on one side of a dot clip its pattern on that side
        let clipped = full.map_or(0.0, |f| f.harmonics[0].sine.hypot(f.harmonics[1].sine));
        let shared_sigma =
            pitch * (SYNTHETIC_SIGMA * synthetic * (1.0 + 10.0 * synthetic)).hypot(CLIPPED_SIGMA * clipped) * bin;
        let light = dot_photometry::measure_brightness(&image.plane, field, &inpainted.filled, *at, steps, phase);
        let sigma = pitch * phase::shift_sigma(noise, amplitude(phase), steps) * bin;
        // modulation = amplitude / mean level; for dark dots the mean contrast is the missing light, whatever the
        // ground level
        let mean = match field.polarity {
            Polarity::DarkOnLight => 1.0 - phase.mean,
            Polarity::LightOnDark => light.mean / field.span,
        };
        modulations.push(sign * amplitude(phase) / mean.max(0.02));
        let invalid = synthetic + full.map_or(0.0, |f| f.mean);
        dots.insert(
            *label,
            MeasuredDot { at: image.to_slice(*at), sigma: sigma.hypot(shared_sigma), shared_sigma, light, invalid },
        );
    }
    let lit = lit_labels(&dots);
    let windows: Vec<Window> =
        lit.iter().filter_map(|l| measured.get(l)).map(|(at, _)| Window { at: *at, steps }).collect();
    let means = dot_photometry::linear_means(&image.plane, field, &inpainted.filled, &windows);
    for (label, mean) in lit.iter().zip(means) {
        if let Some(dot) = dots.get_mut(label) {
            dot.light.linear_mean = mean;
        }
    }
    let merged = sign < 0.0 || inpainted.profile.merges(pitch);
    Some(Detection {
        dots,
        places: places.iter().map(|(label, p)| (*label, image.to_slice(*p))).collect(),
        pitch: pitch * bin,
        motion: SimilarityMotion::NONE,
        clipped: image.clipped,
        modulation: median(&mut modulations),
        fill: 2.0 * inpainted.profile.half_width() / pitch,
        merged,
        density: density.min(1.0),
        identity: None,
        turned: None,
        tint: None,
        is_tentative: false,
        common_sigma: 0.0,
        stripes: None,
        fingerprint: None,
    })
}

/// The dots whose brightness is measured in linear light: brightness is smooth, so a selection is enough. Every n-th
/// row and column, with n a power of 2, so that slices with other dots select the same ones.
fn lit_labels(dots: &BTreeMap<Label, MeasuredDot>) -> Vec<Label> {
    let every = |n: i32| -> Vec<Label> {
        dots.keys().filter(|[i, j]| i.rem_euclid(n) == 0 && j.rem_euclid(n) == 0).copied().collect()
    };
    let mut step = 1;
    loop {
        let selected = every(step);
        if selected.len() <= 2 * LIGHT_DOTS {
            return selected;
        }
        step *= 2;
    }
}

/// Standard deviation of the noise, from second differences along rows, to which the pattern contributes little.
fn noise_of(plane: &Plane<f32>) -> f64 {
    let stride = (plane.height / 200).max(1);
    let mut bends = Vec::new();
    for y in (0..plane.height).step_by(stride) {
        let row = plane.row(y);
        bends.extend(row.windows(3).step_by(5).map(|w| f64::from((w[0] - 2.0 * w[1] + w[2]).abs())));
    }
    (1.4826 * median(&mut bends) / 6.0_f64.sqrt()).max(1e-5)
}

/// Per window: true when its amplitude is close to the median and its shift is small.
fn plausible(windows: &[Window], phase: &[Option<PhaseMeasurement>], sign: f64) -> Vec<bool> {
    let usual = [0, 1].map(|k| {
        median(&mut phase.iter().flatten().map(|p| p.harmonics[k].amplitude(sign)).collect::<Vec<_>>()).max(1e-6)
    });
    let good = |(_, phase): (&Window, &Option<PhaseMeasurement>)| {
        phase.is_some_and(|p| {
            (0..2).all(|k| {
                let strong = (0.3..1.8).contains(&(p.harmonics[k].amplitude(sign) / usual[k]));
                strong && p.harmonics[k].shift(sign).abs() < MAX_SHIFT
            })
        })
    };
    windows.iter().zip(phase).map(good).collect()
}
