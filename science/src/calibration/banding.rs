//! Lamp banding: stripes of light across a slice, by a lamp that flickers while the shutter runs.
//!
//! Stripes move dots towards their bright side, by another amount in each slice. What they leave is the mean of each
//! row (or of each column) of the image after the dots are removed. Other errors of the rendered dots appear in rows
//! and columns alike.

use crate::imaging::Plane;

/// Rows or columns over which slow changes of light are removed, in grid steps.
const SLOW: f64 = 4.0;
/// Least samples of a row or column.
const MIN_SAMPLES: f64 = 50.0;
/// Ratio of the stripes in one direction to those in the other from which they are lamp banding.
const CLEAR: f64 = 3.0;
/// Least amplitude, as a share of the light.
const LEAST: f64 = 0.006;

/// Amplitude of the stripes, as a share of the light; `None` when there are none. `contrast`: the contrast image,
/// `rendered`: the same of the dots alone, `ground`: 1 where a sample shows the target. `pitch`: px.
pub(super) fn amplitude(contrast: &Plane<f32>, rendered: &Plane<f32>, ground: &Plane<u8>, pitch: f64) -> Option<f64> {
    let (width, height) = (contrast.width, contrast.height);
    let (mut rows, mut columns) = (vec![[0.0_f64; 2]; height], vec![[0.0_f64; 2]; width]);
    let samples = contrast.data.iter().zip(&rendered.data).zip(&ground.data).enumerate();
    for (k, ((seen, dots), ground)) in samples {
        if *ground != 0 {
            let left = f64::from(seen - dots);
            for line in [&mut rows[k / width], &mut columns[k % width]] {
                *line = [line[0] + left, line[1] + 1.0];
            }
        }
    }
    let [across, along] = [rows, columns].map(|lines| ripple(&lines, pitch));
    let (across, along) = (across?, along?);
    let amplitude = std::f64::consts::SQRT_2 * across.max(along);
    (across.max(along) > CLEAR * across.min(along) && amplitude > LEAST).then_some(amplitude)
}

/// RMS of the means of the lines, without slow changes. `lines`: sum and number of samples.
fn ripple(lines: &[[f64; 2]], pitch: f64) -> Option<f64> {
    let means: Vec<f64> = lines.iter().filter(|l| l[1] >= MIN_SAMPLES).map(|l| l[0] / l[1]).collect();
    let reach = (0.5 * SLOW * pitch).round() as usize;
    if means.len() < 2 * reach + 1 {
        return None;
    }
    let off = |window: &[f64]| window[reach] - window.iter().sum::<f64>() / window.len() as f64;
    let squares: Vec<f64> = means.windows(2 * reach + 1).map(|window| off(window).powi(2)).collect();
    Some((squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use crate::calibration::calibrate;
    use crate::synth::{Banding, DotTarget, Rig, render_target};
    use crate::types::NoControl;
    use crate::types::calibration_options::CalibrationOptions;
    use crate::types::report::Grade;

    #[test]
    fn stripes_of_a_flickering_lamp_are_reported_and_limit_the_grade() {
        for (strength, is_told) in [(0.0, false), (0.03, true)] {
            let rig = Rig { channels: 1, noise: 1.0, ..Rig::sized(400, 300, 3) };
            let mut target = DotTarget::for_rig(&rig, 14);
            let period_px = 0.7 * target.pitch_px(&rig, rig.reference);
            target.flaws.faults.banding = Some(Banding { period_px, strength });
            let images: Vec<_> = (0..3).map(|i| render_target(&rig, &target, i)).collect();
            let found = calibrate(&&images[..], &CalibrationOptions::default(), &NoControl).expect("a calibration");
            let told: Vec<_> = found.warnings.iter().filter(|w| w.code == "lamp_banding").collect();
            assert_eq!(!told.is_empty(), is_told, "{strength}: {:?}", found.warnings);
            assert!(!is_told || found.report.grade != Grade::Good);
        }
    }
}
