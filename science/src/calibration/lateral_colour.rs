//! Lateral colour: red and blue light is imaged at another scale than green light.
//!
//! The dots of one slice are measured again in red and in blue. Their scale relative to green follows by least squares.
//! The geometry of a calibration is that of green, so lateral colour does not bias it, but coloured fringes stay in
//! every picture.

use super::detection::{self, Detection, Expected, Target};
use super::statistics::median;
use crate::imaging::{Raster, Samples};
use crate::types::{Cancelled, Control};

/// Scale of red and of blue relative to green, minus 1, each with its standard deviation.
pub(super) type ColourScales = [(f64, f64); 2];

/// Fewest dots that are compared.
const MIN_DOTS: usize = 24;
/// Dots farther apart than this many times the median distance do not count.
const FAR: f64 = 4.0;

/// Compares the dots of `slice` in red and in blue with `green`, its detection. `None` for a grey slice, or where a
/// channel shows too few dots.
///
/// # Errors
/// When the work is cancelled.
pub(super) fn measure(
    slice: &Raster,
    target: Target,
    green: &Detection,
    control: &dyn Control,
) -> Result<Option<ColourScales>, Cancelled> {
    if slice.channels < 3 {
        return Ok(None);
    }
    let mut out = [(0.0, 0.0); 2];
    for (scale, index) in out.iter_mut().zip([0, 2]) {
        let plane = channel(slice, index);
        let found = detection::relocate_grid(&plane, target, &green.places, &Expected::NOTHING_MOVES, control)?;
        let Some(found) = found.and_then(|found| relative_scale(green, &found)) else { return Ok(None) };
        *scale = found;
    }
    Ok(Some(out))
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

/// Scale of the dots of `other` relative to `green`, minus 1, with its standard deviation.
fn relative_scale(green: &Detection, other: &Detection) -> Option<(f64, f64)> {
    let pairs: Vec<Pair> = green
        .dots
        .iter()
        .filter_map(|(label, dot)| {
            let there = other.dots.get(label)?.at;
            Some((dot.at, [there[0] - dot.at[0], there[1] - dot.at[1]]))
        })
        .collect();
    let middle = |of: &dyn Fn(&Pair) -> f64| median(&mut pairs.iter().map(of).collect::<Vec<_>>());
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
    Some((scale, (left / (2.0 * count - 3.0) / square.max(1e-9)).sqrt()))
}

#[cfg(test)]
mod tests {
    use crate::calibration::calibrate;
    use crate::synth::{DotTarget, Rig, render_target};
    use crate::types::NoControl;
    use crate::types::calibration_options::CalibrationOptions;

    /// The finding of a stack whose red and blue are larger and smaller than green by `share`.
    fn found(share: f64) -> Option<String> {
        let rig = Rig { channels: 3, noise: 1.0, ..Rig::sized(360, 260, 3) };
        let mut target = DotTarget::for_rig(&rig, 12);
        target.flaws.faults.lateral = [share, 0.0, -share];
        let images: Vec<_> = (0..3).map(|i| render_target(&rig, &target, i)).collect();
        let result = calibrate(&&images[..], &CalibrationOptions::default(), &NoControl).expect("a calibration");
        result.warnings.into_iter().find(|w| w.code == "lateral_colour").map(|w| w.detail)
    }

    #[test]
    fn lateral_colour_is_reported_with_its_size_at_the_corners() {
        // 0.3 % of 222 px
        let detail = found(0.003).expect("told");
        assert!(detail.contains("in red by 0.7 px") && detail.contains("in blue by -0.7 px"), "{detail}");
        assert_eq!(found(0.0), None);
    }
}
