//! Which dots of the grid are visible in a slice, and which positions beside it lie outside the target.

use std::collections::BTreeMap;

use super::ground::{PRESENT_DOT, nearest_dots};
use crate::calibration::lattice::{Label, Places};
use crate::calibration::radial_profile::{PlacedDot, REACH, RadialProfile};
use crate::calibration::working_image::pixels_within;
use crate::imaging::Plane;

/// Strengths with which a candidate beside the grid counts as a dot.
const PRESENT: std::ops::Range<f64> = 0.5..1.6;
/// Strength below which a known dot counts as missing in this slice.
const ABSENT: f64 = 0.2;
/// Largest strength of a known dot.
const MAX_STRENGTH: f64 = 1.5;
/// Least correlation of the residual with the radial profile of a dot.
const MIN_CORRELATION: f64 = 0.7;
/// Mean absolute residual, in units of contrast, from which a position counts as outside the target.
const OUTSIDE: f64 = 0.08;
/// Least share of a dot's surroundings that must lie in the image to measure its strength.
const MIN_VISIBLE: f64 = 0.4;

/// What was decided about the known dots and the candidates beside them.
pub(super) struct Presence {
    /// Dots that are visible.
    pub(super) present: BTreeMap<Label, PlacedDot>,
    /// Candidates that are dots.
    pub(super) added: Places,
    /// Known dots that are not visible.
    pub(super) hidden: Vec<Label>,
    /// Candidates that lie outside the target.
    pub(super) outside: Vec<(Label, PlacedDot)>,
    /// Positions without a dot: hidden dots, and candidates that are none.
    absent: Vec<(Label, [f64; 2])>,
}

impl Presence {
    /// Decides about `known` dots and `candidates`, px of the plane. `None` when no radial profile can be measured.
    pub(super) fn decide(contrast: &Plane<f32>, known: &Places, candidates: &Places, pitch: f64) -> Option<Self> {
        let (width, height) = (contrast.width, contrast.height);
        let placed = |places: &Places| placed(places, REACH * pitch, width, height);
        let (mut present, candidates) = (placed(known), placed(candidates));
        let dots: Vec<PlacedDot> = present.values().copied().collect();
        let undecided: Vec<PlacedDot> = candidates.values().copied().collect();
        // before the candidates are decided, only samples nearer to a known dot count
        let nearest = nearest_dots(&undecided, &dots, pitch, width, height);
        let near_known = nearest.map(|nearest| u8::from(nearest == PRESENT_DOT));
        let profile = RadialProfile::measure(contrast, &near_known, &dots, REACH * pitch)?;
        let rendered = profile.render(&dots, width, height);
        let view = View { contrast, rendered: &rendered, profile: &profile, reach: 0.5 * pitch };
        let (mut added, mut hidden) = (Places::new(), Vec::new());
        let (mut outside, mut absent) = (Vec::new(), Vec::new());
        for (label, dot) in candidates {
            match view.strength(dot.at, 0.0) {
                // a candidate with too little inside the image counts as present: grids continue beyond the frame
                None => {}
                Some(strength) if PRESENT.contains(&strength) => {
                    added.insert(label, dot.at);
                }
                Some(_) => {
                    absent.push((label, dot.at));
                    if view.is_outside(dot.at) {
                        outside.push((label, dot));
                    }
                }
            }
        }
        if !profile.merges(pitch) {
            for (label, dot) in &mut present {
                match view.strength(dot.at, 1.0) {
                    Some(strength) if strength < ABSENT => {
                        hidden.push(*label);
                        absent.push((*label, dot.at));
                    }
                    // glare reduces the strength of dots
                    Some(strength) => dot.strength = strength.min(MAX_STRENGTH),
                    None => {}
                }
            }
        }
        for label in &hidden {
            present.remove(label);
        }
        present.extend(placed(&added));
        Some(Self { present, added, hidden, outside, absent })
    }

    /// The dots to draw in, each with the mean strength of its neighbours.
    pub(super) fn missing(&self) -> Vec<PlacedDot> {
        let dot =
            |(label, at): &(Label, [f64; 2])| PlacedDot { at: *at, strength: strength_beside(&self.present, *label) };
        self.absent.iter().map(dot).collect()
    }
}

/// Dots of strength 1 at the places that contribute contrast to a plane of `width` x `height`.
fn placed(places: &Places, reach: f64, width: usize, height: usize) -> BTreeMap<Label, PlacedDot> {
    let is_near =
        |p: &[f64; 2]| p[0] > -reach && p[1] > -reach && p[0] < width as f64 + reach && p[1] < height as f64 + reach;
    let near = places.iter().filter(|(_, p)| is_near(p));
    near.map(|(label, p)| (*label, PlacedDot { at: *p, strength: 1.0 })).collect()
}

/// Mean strength of the dots around a grid position; 1 when there are none.
fn strength_beside(dots: &BTreeMap<Label, PlacedDot>, [i, j]: Label) -> f64 {
    let around = (-1..=1).flat_map(|a| (-1..=1).map(move |b| [i + a, j + b]));
    let (sum, count) = around
        .filter(|label| *label != [i, j])
        .filter_map(|label| dots.get(&label))
        .fold((0.0, 0.0), |(sum, count), dot| (sum + dot.strength, count + 1.0));
    if count > 0.0 { sum / count } else { 1.0 }
}

/// The contrast of a slice beside that of the known dots.
struct View<'a> {
    contrast: &'a Plane<f32>,
    /// Contrast of the known dots.
    rendered: &'a Plane<f32>,
    profile: &'a RadialProfile,
    /// Radius around a position that is compared, px.
    reach: f64,
}

impl View<'_> {
    /// True when the surroundings of `at` differ much from the rendered target: a table, a frame, a hand.
    fn is_outside(&self, at: [f64; 2]) -> bool {
        let (mut sum, mut count) = (0.0_f64, 0.0_f64);
        for y in pixels_within(at[1], self.reach, 0..self.contrast.height) {
            for x in pixels_within(at[0], self.reach, 0..self.contrast.width) {
                sum += f64::from((self.contrast.at(x, y) - self.rendered.at(x, y)).abs());
                count += 1.0;
            }
        }
        count > 0.0 && sum / count > OUTSIDE
    }

    /// Strength of a dot at `at`: the regression coefficient of the residual `contrast - rendered + filled * profile`
    /// on the radial profile, with a free offset (a dark table is no dot). 1 for a whole dot, 0 when the correlation is
    /// too low, `None` when too little of it lies in the image. `filled` is the strength with which `rendered` includes
    /// this dot.
    fn strength(&self, at: [f64; 2], filled: f64) -> Option<f64> {
        let reach = self.reach;
        // the profile `p` and the residual `r`: sums, sums of squares and of products, samples in the image and in all
        let (mut n, mut p, mut pp, mut r, mut rr, mut pr, mut whole) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        let (left, right) = ((at[0] - reach).ceil() as i64, (at[0] + reach).floor() as i64);
        let (top, bottom) = ((at[1] - reach).ceil() as i64, (at[1] + reach).floor() as i64);
        for y in top..=bottom {
            for x in left..=right {
                let rho = (x as f64 - at[0]).hypot(y as f64 - at[1]);
                if rho > reach {
                    continue;
                }
                whole += 1.0;
                if x < 0 || y < 0 || x >= self.contrast.width as i64 || y >= self.contrast.height as i64 {
                    continue;
                }
                let (x, y) = (x as usize, y as usize);
                let value = self.profile.at(rho).0;
                let residual = f64::from(self.contrast.at(x, y) - self.rendered.at(x, y)) + filled * value;
                n += 1.0;
                p += value;
                pp += value * value;
                r += residual;
                rr += residual * residual;
                pr += value * residual;
            }
        }
        if n < MIN_VISIBLE * whole || n < 5.0 {
            return None;
        }
        let (profile, residual, both) = (pp - p * p / n, rr - r * r / n, pr - p * r / n);
        let correlation = both / (profile * residual).sqrt().max(1e-12);
        Some(if correlation > MIN_CORRELATION { both / profile.max(1e-12) } else { 0.0 })
    }
}
