//! Iterative measurement: from approximate dot positions to measured dots.

use std::collections::BTreeMap;

use super::windows::{MAX_SHIFT, dot_position, grid_steps, in_picture, selected_labels, windows_at};
use crate::calibration::code::{CodePlace, SizeDifferences};
use crate::calibration::detected::{Detection, MeasuredDot};
use crate::calibration::flat_field::{FlatField, Polarity};
use crate::calibration::inpainting::{self, InpaintedGrid};
use crate::calibration::lattice::{self, Label, MIN_DOTS, Places};
use crate::calibration::phase::{self, PhaseMeasurement, Window};
use crate::calibration::statistics::{median, median_of};
use crate::calibration::{
    banding::Contrast, coarse_registration::SimilarityMotion, dlt, dot_photometry, identity::Fingerprint, robust,
    working_image::WorkingImage,
};
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
    field: FlatField,
    places: Places,
    sign: f64,
    code: Option<&CodePlace>,
    control: &dyn Control,
) -> Result<Option<Detection>, Cancelled> {
    let mut measurement = Measurement { image, field, places, sign, code };
    let mut last = None;
    for round in 0..ROUNDS {
        control.check()?;
        let Some(found) = measurement.round(round) else { return Ok(None) };
        last = Some(found);
    }
    Ok(last.and_then(|last| measurement.detection(last)))
}

/// The measurement of one slice, which each round refines.
struct Measurement<'a> {
    image: &'a WorkingImage,
    field: FlatField,
    /// The known dots of the target, px of the working image.
    places: Places,
    /// 1, or -1 where blur has inverted the dots.
    sign: f64,
    code: Option<&'a CodePlace>,
}

/// Position, px of the working image, and phase of each measured dot.
type MeasuredPhases = BTreeMap<Label, ([f64; 2], PhaseMeasurement)>;

/// What one round measures.
struct Round {
    measured: MeasuredPhases,
    inpainted: InpaintedGrid,
    /// The contrast, with all dots of a coded target at the mean size.
    contrast: Plane<f32>,
    /// Number of windows in which the phase was measured.
    windows: usize,
}

/// A dot as its window shows it, px of the working image.
struct FoundDot {
    label: Label,
    expected: [f64; 2],
    at: [f64; 2],
    phase: PhaseMeasurement,
}

impl Measurement<'_> {
    /// Flat field, inpainting and phase measurement. `None` when there is no radial profile, or too few dots agree.
    fn round(&mut self, round: usize) -> Option<Round> {
        let pitch = lattice::pitch_of(&self.places);
        let contrast = self.field.contrast(&self.image.plane);
        let differences = self.code.and_then(|code| SizeDifferences::measure(&contrast, &self.places, pitch, code));
        let contrast = match &differences {
            Some(differences) => differences.equalised(contrast),
            None => contrast,
        };
        let inpainted = self.inpaint(&contrast, pitch, round)?;
        let mut labels = selected_labels(self.image, &self.places);
        labels.retain(|label| !inpainted.hidden.contains(label));
        if inpainted.profile.merges(pitch) {
            drop_near_outside(&mut labels, &inpainted.outside);
        }
        let windows = windows_at(&labels, &self.places, 1.0, grid_steps(&self.places));
        let phases = phase::measure(&inpainted.contrast, Some(&inpainted.valid), &windows);
        let measured = self.relocate(self.plausible(&labels, &windows, &phases), pitch)?;
        if round + 1 < ROUNDS {
            let near: Vec<[f64; 2]> = self.places.values().filter(|p| in_picture(self.image, p)).copied().collect();
            let restored = differences.map(|differences| differences.restored(&inpainted.rendered));
            let dots = restored.as_ref().unwrap_or(&inpainted.rendered);
            let degree = 2 + round.min(2);
            self.field = self.field.refine(&self.image.plane, dots, &inpainted.ground, &near, 0.8 * pitch, degree);
        }
        Some(Round { measured, inpainted, contrast, windows: windows.len() })
    }

    /// Inpaints the grid. It may extend beyond the dots known so far: those that are found are added to them.
    fn inpaint(&mut self, contrast: &Plane<f32>, pitch: f64, round: usize) -> Option<InpaintedGrid> {
        let mut inpainted = None;
        for _ in 0..if round == 0 { 6 } else { 2 } {
            let beside = lattice::beside(&self.places);
            let done = inpainting::inpaint(contrast, &self.places, &beside, pitch, round > 0)?;
            self.places.extend(&done.added);
            let is_complete = done.added.is_empty();
            inpainted = Some(done);
            if is_complete {
                break;
            }
        }
        inpainted
    }

    /// The dots whose amplitude is close to the median and whose shift is small.
    fn plausible(&self, labels: &[Label], windows: &[Window], phases: &[Option<PhaseMeasurement>]) -> Vec<FoundDot> {
        let amplitude = |phase: &PhaseMeasurement, k: usize| phase.harmonics[k].amplitude(self.sign);
        let usual = [0, 1].map(|k| median_of(phases.iter().flatten().map(|p| amplitude(p, k))).max(1e-6));
        let is_plausible = |phase: &PhaseMeasurement| {
            (0..2).all(|k| {
                (0.3..1.8).contains(&(amplitude(phase, k) / usual[k]))
                    && phase.harmonics[k].shift(self.sign).abs() < MAX_SHIFT
            })
        };
        labels
            .iter()
            .zip(windows)
            .zip(phases)
            .filter_map(|((label, window), phase)| {
                let phase = phase.filter(&is_plausible)?;
                let at = dot_position(window, &phase, self.sign);
                Some(FoundDot { label: *label, expected: window.at, at, phase })
            })
            .collect()
    }

    /// Moves the known dots to where they were found; those that were not found follow the consensus homography. `None`
    /// when too few dots agree.
    fn relocate(&mut self, found: Vec<FoundDot>, pitch: f64) -> Option<MeasuredPhases> {
        if found.len() < MIN_DOTS {
            return None;
        }
        let pairs: Vec<dlt::Pair> = found.iter().map(|dot| (dot.expected, dot.at)).collect();
        let shared = robust::consensus(&pairs, 0.01 * pitch, 0.1 * pitch)?;
        self.places.values_mut().for_each(|p| *p = shared.homography.apply(*p));
        let mut measured = BTreeMap::new();
        for FoundDot { label, at, phase, .. } in found {
            // a dot far from the consensus is dust or a misprint: its measurement is kept, but not used as the next
            // position
            let there = self.places.get(&label).copied().unwrap_or(at);
            if (at[0] - there[0]).hypot(at[1] - there[1]) < 0.05 * pitch {
                self.places.insert(label, at);
            }
            measured.insert(label, (at, phase));
        }
        Some(measured)
    }

    /// The detection from the last round.
    fn detection(&self, last: Round) -> Option<Detection> {
        let Round { measured, inpainted, contrast, windows } = last;
        if measured.len() < MIN_DOTS {
            return None;
        }
        let (image, places) = (self.image, &self.places);
        let pitch = lattice::pitch_of(places);
        let counted = places.values().filter(|p| in_picture(image, p)).count().max(1);
        let (dots, modulation) = self.dots(&measured, &inpainted, pitch);
        let merged = self.sign < 0.0 || inpainted.profile.merges(pitch);
        let fill = 2.0 * inpainted.profile.half_width() / pitch;
        let InpaintedGrid { rendered, ground, profile, .. } = &inpainted;
        let ripple =
            Contrast { seen: &contrast, rendered, ground, places, pitch, steps: grid_steps(places), profile }.ripple();
        drop(inpainted);
        Some(Detection {
            dots,
            places: places.iter().map(|(label, p)| (*label, image.to_slice(*p))).collect(),
            pitch: pitch * image.bin as f64,
            motion: SimilarityMotion::NONE,
            clipped: image.clipped,
            modulation,
            fill,
            merged,
            density: (windows as f64 / counted as f64).min(1.0),
            identity: None,
            turned: None,
            tint: None,
            is_tentative: false,
            ripple,
            fingerprint: Fingerprint::measure(image, &contrast, places, pitch),
        })
    }

    /// The measured dots with their uncertainty and brightness, and the median modulation.
    fn dots(
        &self,
        measured: &MeasuredPhases,
        inpainted: &InpaintedGrid,
        pitch: f64,
    ) -> (BTreeMap<Label, MeasuredDot>, f64) {
        let (image, field) = (self.image, &self.field);
        let (plane, filled, bin) = (&image.plane, &inpainted.filled, image.bin as f64);
        let steps = grid_steps(&self.places);
        let noise = noise_of(&inpainted.contrast);
        let amplitude = |p: &PhaseMeasurement| 0.5 * (0..2).map(|k| p.harmonics[k].amplitude(self.sign)).sum::<f64>();
        let windows: Vec<Window> = measured.values().map(|(at, _)| Window { at: *at, steps }).collect();
        let synthetic = phase::measure(&inpainted.synthetic, None, &windows);
        let full = image.full.as_ref().map(|full| phase::measure(full, None, &windows));
        let mut modulations: Vec<f64> = Vec::new();
        let mut dots = BTreeMap::new();
        for (k, (label, (at, phase))) in measured.iter().enumerate() {
            let synthetic = synthetic[k].map_or(0.0, |p| p.mean);
            let full = full.as_ref().and_then(|f| f[k]);
            // full-scale samples on one side of a dot clip its pattern on that side
            let clipped = full.map_or(0.0, |f| f.harmonics[0].sine.hypot(f.harmonics[1].sine));
            let shared_sigma =
                pitch * (SYNTHETIC_SIGMA * synthetic * (1.0 + 10.0 * synthetic)).hypot(CLIPPED_SIGMA * clipped) * bin;
            let light = dot_photometry::measure_brightness(plane, field, filled, *at, steps, phase);
            let sigma = pitch * phase::shift_sigma(noise, amplitude(phase), steps) * bin;
            // modulation = amplitude / mean level; for dark dots the mean contrast is the missing light, whatever the
            // ground level
            let mean = match field.polarity {
                Polarity::DarkOnLight => 1.0 - phase.mean,
                Polarity::LightOnDark => light.mean / field.span,
            };
            let modulation = self.sign * amplitude(phase) / mean.max(0.02);
            modulations.push(modulation);
            let invalid = synthetic + full.map_or(0.0, |f| f.mean);
            let sigma = sigma.hypot(shared_sigma);
            let (at, doubt) = (image.to_slice(*at), [0.0; 2]);
            dots.insert(*label, MeasuredDot { at, sigma, shared_sigma, modulation, doubt, light, invalid });
        }
        let lit = lit_labels(&dots);
        let windows: Vec<Window> =
            lit.iter().filter_map(|l| measured.get(l)).map(|(at, _)| Window { at: *at, steps }).collect();
        let means = dot_photometry::linear_means(plane, field, filled, &windows);
        for (label, mean) in lit.iter().zip(means) {
            if let Some(dot) = dots.get_mut(label) {
                dot.light.linear_mean = mean;
            }
        }
        (dots, median(&mut modulations))
    }
}

/// Drops dots next to positions outside the target, if enough others remain. For merged dots: what lies beyond the
/// target blurs into the outermost ones.
fn drop_near_outside(labels: &mut Vec<Label>, outside: &[Label]) {
    let near = |l: &Label| outside.iter().any(|f| (f[0] - l[0]).abs() <= 1 && (f[1] - l[1]).abs() <= 1);
    let kept: Vec<Label> = labels.iter().filter(|l| !near(l)).copied().collect();
    if kept.len() >= 2 * MIN_DOTS {
        *labels = kept;
    }
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
