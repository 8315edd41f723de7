//! Lens distortion that stays with the sensor.
//!
//! Input: the dots of all slices. Output: the radial distortion, if the dots show one, the dots without it, and a
//! finding.
//!
//! Distortion by a fixed lens scales with the image and cancels between slices. Distortion that stays with the sensor
//! (a moving lens, or optics on the sensor side) does not: no homography maps one slice to another. Two independent
//! estimates tell:
//!
//! | estimate | from | mistaken by |
//! |---|---|---|
//! | between slices | what is common to the residuals of all slices | a bent target, with a moving lens |
//! | within one slice | the printed grid in the reference slice, a plumb-line method | a bent target, distortion by a fixed lens |
//!
//! The first alone shows what matters for the alignment. It is used where the second confirms it: a bent target changes
//! the two differently.

mod fit;
#[cfg(test)]
mod tests;

use fit::{Coefficients, JointFit, View, fit, predict};

use super::transform_models::{self, Frame, Match, TransformModel};
use super::{detected::Detection, dlt, grade::Finding, lattice, solve::find_inliers, tracked::Tracked};
use crate::types::{Cancelled, Control, Homography, WarningCode};
use crate::types::{distortion::Distortion, report::Grade};

/// What the dots say about distortion.
#[derive(Debug, Clone, Default)]
pub(super) struct LensAnalysis {
    /// The distortion, px; `None` when there is none, or none that can be measured.
    pub distortion: Option<Distortion>,
    /// Per slice the standard deviation of the worst image corner that its uncertainty causes, px.
    pub corner_sigma: Vec<f64>,
    /// What the user should know.
    pub finding: Option<Finding>,
}

/// Most dots of all slices together that enter a fit; more do not improve it.
const MAX_DOTS: usize = 6000;
/// Fewest dots of a slice.
const MIN_DOTS: usize = 24;
/// Significance from which a distortion between slices is accepted, standard deviations.
const CERTAIN: f64 = 6.0;
/// Smallest effect at the image corners that is modelled, px.
const MODELLED: f64 = 0.05;
/// Smallest effect that is reported where it cannot be modelled, px.
const REPORTED: f64 = 0.15;
/// Relative difference at which the estimate of the printed grid confirms the other.
const ACCORD: f64 = 0.35;
/// Relative accuracy of the estimate from the printed grid, which need not be flat and regular.
const GRID_ACCURACY: f64 = 0.05;

/// Analyses the dots of all slices.
pub(super) fn analyse(tracked: &Tracked, reference: usize, control: &dyn Control) -> Result<LensAnalysis, Cancelled> {
    control.check()?;
    let Some(base) = tracked.detections[reference].as_ref() else { return Ok(LensAnalysis::default()) };
    let frame = Frame::new(tracked.width, tracked.height);
    let views = views(tracked, reference, base, &frame, None);
    if views.len() < 2 {
        return Ok(LensAnalysis::default());
    }
    let Some(between) = fit(&views, 3, [0.0; 4]) else { return Ok(LensAnalysis::default()) };
    control.check()?;
    let stack = Stack { tracked, reference, base, frame };
    let grid = stack.printed_grid();
    let within = grid.as_ref().and_then(|grid| fit(std::slice::from_ref(grid), 3, [0.0; 4]));
    let (k, sigma) = (between.coefficients[0], between.sigma(0));
    let effect = stack.effect(&views, &between);
    if k.abs() <= CERTAIN * sigma || effect <= MODELLED {
        let finding = within.and_then(|within| stack.ambiguous(&views, &between, &within));
        return Ok(LensAnalysis { finding, ..LensAnalysis::default() });
    }
    let confirmed = within.as_ref().zip(grid).filter(|(within, _)| {
        let other = within.coefficients[0];
        let allowed = (ACCORD * other.abs()).max(3.0 * sigma.hypot(within.sigma(0)));
        k * other > 0.0 && (k - other).abs() < allowed
    });
    if let Some((within, grid)) = confirmed
        && let Some((distortion, joint, views)) = stack.joint(&between, within, grid)
    {
        control.check()?;
        return Ok(stack.modelled(distortion, &joint, &views));
    }
    let finding = (effect > REPORTED).then(|| {
        Finding::limiting(
            Grade::Usable,
            WarningCode::LensDistortion,
            format!(
                "the dots are displaced radially, by up to {effect:.1} px at the image corners and differently in each \
                 slice, but the printed grid does not show the same distortion: check that the target is flat; if it \
                 is, fill the image with the target, so that the distortion can be measured"
            ),
        )
    });
    Ok(LensAnalysis { finding, ..LensAnalysis::default() })
}

/// The stack without distortion: all dots at their ideal positions.
pub(super) fn straightened(mut tracked: Tracked, distortion: &Distortion) -> Tracked {
    for detection in tracked.detections.iter_mut().flatten() {
        straighten(detection, distortion);
    }
    tracked
}

fn straighten(detection: &mut Detection, distortion: &Distortion) {
    detection.dots.values_mut().for_each(|dot| dot.at = distortion.undistort(dot.at));
    detection.places.values_mut().for_each(|place| *place = distortion.undistort(*place));
    detection.pitch = lattice::pitch_of(&detection.places);
}

/// The views of all slices but the reference: their inliers, as far as the distortion is known, at the positions where
/// they are seen.
fn views(
    tracked: &Tracked,
    reference: usize,
    base: &Detection,
    frame: &Frame,
    known: Option<&Distortion>,
) -> Vec<View> {
    let straight = |detection: &Detection| {
        let mut detection = detection.clone();
        if let Some(known) = known {
            straighten(&mut detection, known);
        }
        detection
    };
    let straight_base = straight(base);
    let others = tracked.detections.iter().enumerate().filter(|(index, _)| *index != reference);
    let others: Vec<(usize, &Detection)> = others.filter_map(|(i, d)| d.as_ref().map(|d| (i, d))).collect();
    let most = (MAX_DOTS / others.len().max(1)).max(2 * MIN_DOTS);
    let view = |&(slice, detection): &(usize, &Detection)| {
        let inliers = find_inliers(&straight(detection), &straight_base, frame)?.evidence;
        let every = inliers.matches.len().div_ceil(most).max(1);
        let kept = inliers.labels.iter().zip(&inliers.matches).step_by(every);
        let matches: Vec<Match> = kept
            .filter_map(|(label, m)| {
                let (at, here) = (base.dots.get(label)?.at, detection.dots.get(label)?.at);
                Some(Match { base: frame.unit(at), here: frame.unit(here), sigma: m.sigma })
            })
            .collect();
        let weight = 1.0 / (inliers.overlap / every as f64).max(1.0);
        (matches.len() >= MIN_DOTS).then_some(View { slice, matches, is_grid: false, weight })
    };
    others.iter().filter_map(view).collect()
}

/// The stack whose distortion is analysed.
struct Stack<'a> {
    tracked: &'a Tracked,
    reference: usize,
    base: &'a Detection,
    frame: Frame,
}

impl Stack<'_> {
    fn corners(&self) -> [[f64; 2]; 4] {
        let corners = Homography::corners(self.tracked.width as u32, self.tracked.height as u32);
        corners.map(|corner| self.frame.unit(corner))
    }

    /// The printed grid in the reference slice.
    fn printed_grid(&self) -> Option<View> {
        let dots: Vec<_> = self.base.dots.iter().collect();
        let every = dots.len().div_ceil(MAX_DOTS / 4).max(1);
        let dots: Vec<_> = dots.into_iter().step_by(every).collect();
        let pairs: Vec<dlt::Pair> =
            dots.iter().map(|(label, dot)| (label.map(f64::from), self.frame.unit(dot.at))).collect();
        let plate = dlt::fit(&pairs)?;
        let matches: Vec<Match> = pairs
            .iter()
            .zip(&dots)
            .map(|((on_plate, here), (_, dot))| Match {
                base: plate.apply(*on_plate),
                here: *here,
                sigma: dot.sigma.hypot(0.01) / self.frame.half,
            })
            .collect();
        let view = View { slice: self.reference, matches, is_grid: true, weight: 0.5 };
        (view.matches.len() >= MIN_DOTS).then_some(view)
    }

    /// Largest distance, px, of an image corner between the transforms of `joint` and homographies without distortion.
    fn effect(&self, views: &[View], joint: &JointFit) -> f64 {
        let of_view = |(view, p): (&View, &transform_models::Parameters)| {
            let plain = transform_models::fit(TransformModel::Homography, &view.matches)?;
            let plain = TransformModel::Homography.parameters(&plain.free);
            let apart = self.corners().map(|corner| {
                let (a, b) =
                    (predict(&joint.coefficients, p, corner, false), transform_models::map_point(&plain, corner));
                (a[0] - b[0]).hypot(a[1] - b[1])
            });
            Some(apart.into_iter().fold(0.0, f64::max))
        };
        let slices = views.iter().zip(&joint.parameters).filter(|(view, _)| !view.is_grid);
        self.frame.half * slices.filter_map(of_view).fold(0.0, f64::max)
    }

    /// The distortion in px.
    fn in_px(&self, c: &Coefficients) -> Option<Distortion> {
        let Frame { centre, half } = self.frame;
        let centre_px = [centre[0] + half * c[1], centre[1] + half * c[2]];
        let found = Distortion { centre_px, k1: c[0], k2: c[3], radius_px: half };
        found.violation(self.tracked.width as u32, self.tracked.height as u32).is_none().then_some(found)
    }

    /// The joint estimate from the slices and the printed grid. Dots that were outliers only because of the distortion
    /// take part in the second round.
    fn joint(&self, between: &JointFit, within: &JointFit, grid: View) -> Option<(Distortion, JointFit, Vec<View>)> {
        let trust = (within.sigma(0) / (GRID_ACCURACY * within.coefficients[0])).powi(2).min(1.0);
        let grid = View { weight: grid.weight * trust, ..grid };
        let mut coefficients = between.coefficients;
        let mut last = None;
        for _ in 0..2 {
            let known = self.in_px(&coefficients)?;
            let mut views = views(self.tracked, self.reference, self.base, &self.frame, Some(&known));
            views.push(grid.clone());
            let joint = fit(&views, 3, coefficients)?;
            coefficients = joint.coefficients;
            last = Some((joint, views));
        }
        let (joint, views) = last?;
        let chosen = match fit(&views, 4, joint.coefficients) {
            Some(more)
                if more.coefficients[3].abs() > CERTAIN * more.sigma(3)
                    && self.in_px(&more.coefficients).is_some()
                    && self.apart(&more, &joint, &views) > MODELLED =>
            {
                more
            }
            _ => joint,
        };
        Some((self.in_px(&chosen.coefficients)?, chosen, views))
    }

    /// Largest distance, px, of an image corner between two fits.
    fn apart(&self, a: &JointFit, b: &JointFit, views: &[View]) -> f64 {
        let mut most = 0.0_f64;
        for (index, _) in views.iter().enumerate().filter(|(_, view)| !view.is_grid) {
            for corner in self.corners() {
                let [p, q] = [a, b].map(|f| predict(&f.coefficients, &f.parameters[index], corner, false));
                most = most.max((p[0] - q[0]).hypot(p[1] - q[1]));
            }
        }
        self.frame.half * most
    }

    /// The analysis when the distortion is modelled.
    fn modelled(&self, distortion: Distortion, joint: &JointFit, views: &[View]) -> LensAnalysis {
        let of_view = |index: usize| {
            let worst = self.corners().map(|corner| joint.corner_sigma(index, corner)).into_iter().fold(0.0, f64::max);
            self.frame.half * worst
        };
        let known: Vec<(usize, f64)> = views
            .iter()
            .enumerate()
            .filter(|(_, view)| !view.is_grid)
            .map(|(index, view)| (view.slice, of_view(index)))
            .collect();
        let most = known.iter().map(|k| k.1).fold(0.0, f64::max);
        let of_slice = |slice: usize| match known.iter().find(|k| k.0 == slice) {
            _ if slice == self.reference => 0.0,
            Some((_, sigma)) => *sigma,
            None => most,
        };
        let (width, height) = (self.tracked.width as u32, self.tracked.height as u32);
        let finding = Finding::remark(
            WarningCode::LensDistortion,
            format!(
                "the lens distorts the image by {:.1} px at the corners, and the distortion stays with the sensor: it was \
                 measured, is part of the profile and is taken into account when stacks are aligned",
                distortion.max_displacement_px(width, height)
            ),
        );
        LensAnalysis {
            distortion: Some(distortion),
            corner_sigma: (0..self.tracked.detections.len()).map(of_slice).collect(),
            finding: Some(finding),
        }
    }

    /// The finding when the printed grid shows a distortion and the slices cannot tell whether it stays with the
    /// sensor.
    fn ambiguous(&self, views: &[View], between: &JointFit, within: &JointFit) -> Option<Finding> {
        let (k, sigma) = (within.coefficients[0], within.sigma(0).hypot(GRID_ACCURACY * within.coefficients[0]));
        let is_visible = k.abs() > CERTAIN * sigma;
        let is_possible = (k - between.coefficients[0]).abs() < 2.5 * between.sigma(0).hypot(sigma);
        if !is_visible || !is_possible {
            return None;
        }
        let effect = self.effect(views, &fit(views, 0, within.coefficients)?);
        (effect > REPORTED).then(|| {
            Finding::limiting(
                Grade::Usable,
                WarningCode::LensDistortion,
                format!(
                    "the printed grid is distorted, and the slices do not show whether the distortion stays with the \
                     sensor: if it does, the image corners are off by up to {effect:.1} px; use a flat target that fills \
                     the image"
                ),
            )
        })
    }
}
