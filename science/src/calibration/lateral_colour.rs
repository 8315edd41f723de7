//! Lateral colour: red and blue light is imaged at another scale than green light.
//!
//! The dots of one slice are measured again in red and in blue. Scale and shift relative to green follow by least
//! squares. The geometry of a calibration is that of green, so lateral colour does not bias it. Fusion corrects it.

use super::detected::{Detection, Expected, Target};
use super::{detection, statistics::median_of};
use crate::imaging::{Raster, Samples};
use crate::types::lateral_colour::{ColourDisplacement, LateralColour};
use crate::types::{Cancelled, Control};

/// The lateral colour that the dots of one slice show.
#[derive(Debug, Clone, Copy)]
pub(super) struct MeasuredColours {
    /// Displacement of red and blue.
    pub colours: LateralColour,
    /// Standard deviation of the displacement at a corner of the image, px: the larger one of red and blue.
    pub corner_sigma: f64,
}

impl MeasuredColours {
    /// The lateral colour, where it displaces a corner of the image by more than [`LEAST_FRINGE_PX`] beyond doubt.
    pub(super) fn worth_correcting(&self, width: u32, height: u32) -> Option<LateralColour> {
        let size = self.colours.max_displacement_px(width, height);
        let is_certain = size > LEAST_FRINGE_PX && size > BEYOND_DOUBT * self.corner_sigma;
        (is_certain && self.colours.violation().is_none()).then_some(self.colours)
    }
}

/// Displacement at an image corner from which lateral colour is reported and corrected, px.
const LEAST_FRINGE_PX: f64 = 0.3;
/// Standard deviations from which a displacement is beyond doubt.
const BEYOND_DOUBT: f64 = 5.0;
/// Fewest dots that are compared.
const MIN_DOTS: usize = 24;
/// Dots farther apart than this many times the median distance do not count.
const FAR: f64 = 4.0;

/// Compares the dots of `slice` in red and in blue with `green`, its detection. `None` for a grey slice, or where a
/// channel shows too few dots.
pub(super) fn measure(
    slice: &Raster,
    target: Target,
    green: &Detection,
    control: &dyn Control,
) -> Result<Option<MeasuredColours>, Cancelled> {
    if slice.channels < 3 {
        return Ok(None);
    }
    let mut found = Vec::new();
    for index in [0, 2] {
        let plane = channel(slice, index);
        let there = detection::relocate_grid(&plane, target, &green.places, &Expected::NOTHING_MOVES, control)?;
        let Some(there) = there else { return Ok(None) };
        found.extend(displacement(green, &there, [slice.width, slice.height]));
    }
    let &[(red, red_sigma), (blue, blue_sigma)] = &found[..] else { return Ok(None) };
    Ok(Some(MeasuredColours { colours: LateralColour { red, blue }, corner_sigma: red_sigma.max(blue_sigma) }))
}

fn channel(slice: &Raster, index: usize) -> Raster {
    let (width, height, step) = (slice.width, slice.height, slice.channels);
    match &slice.samples {
        Samples::Eight(s) => Raster::eight(width, height, 1, s.iter().skip(index).step_by(step).copied().collect()),
        Samples::Sixteen(s) => Raster::sixteen(width, height, 1, s.iter().skip(index).step_by(step).copied().collect()),
    }
}

/// The position of a dot in green, and how far it is from there in another colour, px.
type Pair = ([f64; 2], [f64; 2]);

/// Displacement of the dots of `other` relative to `green`, with its standard deviation at a corner of an image of
/// `size` = width, height.
fn displacement(green: &Detection, other: &Detection, size: [usize; 2]) -> Option<(ColourDisplacement, f64)> {
    let pairs: Vec<Pair> = green
        .dots
        .iter()
        .filter_map(|(label, dot)| {
            let there = other.dots.get(label)?.at;
            Some((dot.at, [there[0] - dot.at[0], there[1] - dot.at[1]]))
        })
        .collect();
    let middle = |of: &dyn Fn(&Pair) -> f64| median_of(pairs.iter().map(of));
    let usual = [middle(&|p| p.1[0]), middle(&|p| p.1[1])];
    let away = |p: &Pair| (p.1[0] - usual[0]).hypot(p.1[1] - usual[1]);
    let limit = FAR * middle(&away);
    let kept: Vec<_> = pairs.iter().filter(|p| away(p) <= limit).collect();
    if kept.len() < MIN_DOTS {
        return None;
    }
    let count = kept.len() as f64;
    let mean = |of: &dyn Fn(&Pair) -> f64| kept.iter().map(|p| of(p)).sum::<f64>() / count;
    let (at, by) = ([mean(&|p| p.0[0]), mean(&|p| p.0[1])], [mean(&|p| p.1[0]), mean(&|p| p.1[1])]);
    let (mut both, mut square) = (0.0, 0.0);
    for p in &kept {
        for a in 0..2 {
            both += (p.0[a] - at[a]) * (p.1[a] - by[a]);
            square += (p.0[a] - at[a]).powi(2);
        }
    }
    let scale = both / square.max(1e-9);
    let left: f64 = kept.iter().flat_map(|p| [0, 1].map(|a| (p.1[a] - by[a] - scale * (p.0[a] - at[a])).powi(2))).sum();
    let variance = left / (2.0 * count - 3.0);
    let middle = size.map(|length| 0.5 * (length as f64 - 1.0));
    let shift_px = [0, 1].map(|a| by[a] + scale * (middle[a] - at[a]));
    // the farthest corner from the mean of the dots
    let [far_x, far_y] = [0, 1].map(|a| at[a].abs().max((2.0 * middle[a] - at[a]).abs()));
    let corner_variance = variance / count + variance / square.max(1e-9) * (far_x * far_x + far_y * far_y);
    Some((ColourDisplacement { scale, shift_px }, corner_variance.sqrt()))
}

#[cfg(test)]
mod tests {
    use crate::calibration::calibrate;
    use crate::synth::{DotTarget, Rig, render_target};
    use crate::types::NoControl;
    use crate::types::calibration_options::CalibrationOptions;
    use crate::types::lateral_colour::LateralColour;

    /// What a calibration finds of a stack whose red and blue are larger and smaller than green by `share`.
    fn found(share: f64) -> (Option<LateralColour>, Option<String>) {
        let rig = Rig { channels: 3, noise: 1.0, ..Rig::sized(360, 260, 3) };
        let mut target = DotTarget::for_rig(&rig, 12);
        target.flaws.faults.lateral = [share, 0.0, -share];
        let images: Vec<_> = (0..3).map(|i| render_target(&rig, &target, i)).collect();
        let result = calibrate(&&images[..], &CalibrationOptions::default(), &NoControl).expect("a calibration");
        let finding = result.warnings.into_iter().find(|w| w.code == "lateral_colour").map(|w| w.detail);
        (result.lateral_colour, finding)
    }

    #[test]
    fn lateral_colour_is_measured_and_reported_with_its_size_at_the_corners() {
        for share in [0.003, -0.006] {
            let (measured, finding) = found(share);
            let measured = measured.expect("measured");
            // 222 px from the middle to a corner
            for (colour, truth) in [(measured.red, share), (measured.blue, -share)] {
                let error = 222.0 * (colour.scale - truth).abs();
                assert!(error < 0.03, "{error} px at the corners: {measured:?}");
                assert!(colour.shift_px.iter().all(|shift| shift.abs() < 0.02), "{measured:?}");
            }
            let detail = finding.expect("told");
            let size = format!("{:.1} px", 222.0 * share.abs());
            assert!(detail.contains(&format!("in red by {size}")) && detail.contains(&format!("in blue by {size}")));
        }
        assert_eq!(found(0.0), (None, None));
    }
}
