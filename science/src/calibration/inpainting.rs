//! Inpainting of the grid: the contrast image as if the grid had no end, no gaps and no dust.
//!
//! A phase window extends one grid step from its centre. Beside a missing dot or at the end of the grid, half of the
//! expected pattern is absent, which biases the phase. Missing dots are therefore drawn in with the radial profile of
//! the other dots of the slice, and whatever no dot explains (dust, lettering, the table beyond the target) is
//! replaced.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};

use super::lattice::{Label, Places};
use super::radial_profile::{PlacedDot, RadialProfile};
use super::statistics::median;
use crate::imaging::Plane;

/// Radius within which a dot contributes contrast, in grid steps.
pub(super) const REACH: f64 = 0.85;
/// Strength from which a candidate beside the grid counts as a dot.
const PRESENT: f64 = 0.5;
/// Strength below which a known dot counts as missing in this slice.
const ABSENT: f64 = 0.2;
/// Least correlation of the residual with the radial profile of a dot.
const MIN_CORRELATION: f64 = 0.7;
/// Mean absolute residual, in units of contrast, from which a position counts as outside the target.
const FOREIGN: f64 = 0.08;
/// Least share of a dot's surroundings that must lie in the image to measure its strength.
const MIN_VISIBLE: f64 = 0.4;

/// The inpainted grid of one slice.
#[derive(Debug)]
pub(super) struct InpaintedGrid {
    /// Contrast with missing dots drawn in and foreign samples replaced.
    pub contrast: Plane<f32>,
    /// 0 where a foreign sample was replaced, else 1.
    pub valid: Plane<u8>,
    /// 1 where the sample shows the target itself: neither foreign nor beyond the target.
    pub ground: Plane<u8>,
    /// Radial profile of one dot.
    pub profile: RadialProfile,
    /// Dots beside the known ones that were found.
    pub added: Places,
    /// Known dots that are not visible in this slice.
    pub hidden: Vec<Label>,
    /// Positions beside the grid that lie outside the target.
    pub foreign: Vec<Label>,
    /// Contrast of the missing dots that were drawn in.
    pub filled: Plane<f32>,
    /// Contrast of all dots that are present, rendered from the profile.
    pub rendered: Plane<f32>,
    /// 1 where the contrast is synthetic: drawn in or replaced.
    pub synthetic: Plane<f32>,
}

/// Inpaints `contrast`. `known` are dots of the target, `beside` positions where it may have one; both in px of the
/// plane. `clean`: also replaces dust. `None` when no radial profile can be measured.
pub(super) fn inpaint(
    contrast: &Plane<f32>,
    known: &Places,
    beside: &Places,
    pitch: f64,
    clean: bool,
) -> Option<InpaintedGrid> {
    let (width, height) = (contrast.width, contrast.height);
    let near = |p: &[f64; 2]| {
        let reach = REACH * pitch;
        p[0] > -reach && p[1] > -reach && p[0] < width as f64 + reach && p[1] < height as f64 + reach
    };
    let placed = |places: &Places| -> BTreeMap<Label, PlacedDot> {
        places.iter().filter(|(_, p)| near(p)).map(|(l, p)| (*l, PlacedDot { at: *p, strength: 1.0 })).collect()
    };
    let mut dots = placed(known);
    let list = |dots: &BTreeMap<Label, PlacedDot>| dots.values().copied().collect::<Vec<_>>();
    let free = placed(beside);
    // before the candidates are decided, only samples nearer to a known dot count
    let shut = nearest_dots(&list(&free), &list(&dots), pitch, width, height).map(|beyond| u8::from(beyond == OWN_DOT));
    let profile = RadialProfile::measure(contrast, &shut, &list(&dots), REACH * pitch)?;
    let rendered = profile.render(&list(&dots), width, height);
    let merged = profile.merges(pitch);

    // decide which candidates are present and which known dots are missing
    let strength_of = |at: [f64; 2], filled: f64| strength(contrast, &rendered, &profile, at, 0.5 * pitch, filled);
    let mut added = Places::new();
    let (mut missing, mut foreign, mut foreign_dots) = (Vec::new(), Vec::new(), Vec::new());
    for (label, dot) in free {
        match strength_of(dot.at, 0.0) {
            // a candidate with too little inside the image counts as present: grids continue beyond the frame
            None => {}
            Some(strength) if (PRESENT..1.6).contains(&strength) => {
                added.insert(label, dot.at);
            }
            Some(_) => {
                missing.push((label, dot.at));
                if is_foreign(contrast, &rendered, dot.at, 0.5 * pitch) {
                    foreign.push(label);
                    foreign_dots.push(dot);
                }
            }
        }
    }
    let mut hidden = Vec::new();
    if !merged {
        for (label, dot) in &mut dots {
            match strength_of(dot.at, 1.0) {
                Some(strength) if strength < ABSENT => {
                    hidden.push(*label);
                    missing.push((*label, dot.at));
                }
                // glare reduces the strength of dots
                Some(strength) => dot.strength = strength.min(1.5),
                None => {}
            }
        }
    }
    for label in &hidden {
        dots.remove(label);
    }
    dots.extend(placed(&added));
    // a missing dot gets the mean strength of its neighbours
    let missing: Vec<PlacedDot> =
        missing.into_iter().map(|(label, at)| PlacedDot { at, strength: strength_beside(&dots, label) }).collect();
    let all = list(&dots);
    // beyond the target may be a table, a hand or lettering: everything there is replaced
    let beyond = nearest_dots(&foreign_dots, &all, pitch, width, height);
    let own = beyond.map(|beyond| u8::from(beyond == OWN_DOT));
    let profile = RadialProfile::measure(contrast, &own, &all, REACH * pitch)?;
    let rendered = profile.render(&all, width, height);
    let valid = if clean { without_dust(contrast, &rendered, &own, &profile) } else { Plane::filled(width, height, 1) };
    let filled = profile.render(&missing, width, height);
    // where the flat field misses the ground (glare), it misses it beyond the target too; without this correction a
    // step half a pitch outside the outermost dots would pull them outward
    let means = mean_residuals(contrast, &rendered, &valid, &own, &all, 0.5 * pitch);
    let levels: Vec<ResidualPlane> =
        foreign_dots.iter().map(|dot| ResidualPlane::near(dot.at, &means, 2.6 * pitch)).collect();
    let sample = |k: usize| match levels.get(beyond.data[k] as usize) {
        Some(level) => rendered.data[k] + level.at([(k % width) as f64, (k / width) as f64]) as f32,
        None if valid.data[k] == 0 => rendered.data[k],
        None => contrast.data[k],
    };
    let data = (0..contrast.data.len()).map(|k| filled.data[k] + sample(k)).collect();
    let synthetic = (0..contrast.data.len()).map(|k| {
        let own = beyond.data[k] >= NO_DOT && valid.data[k] != 0 && filled.data[k].abs() < 0.02;
        f32::from(u8::from(!own))
    });
    let synthetic = Plane { width, height, data: synthetic.collect() };
    let ground = valid.data.iter().zip(&own.data).map(|(a, b)| a & b).collect();
    let ground = Plane { width, height, data: ground };
    Some(InpaintedGrid {
        contrast: Plane { width, height, data },
        valid,
        ground,
        profile,
        added,
        hidden,
        foreign,
        filled,
        rendered,
        synthetic,
    })
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

/// True when the surroundings of `at` differ much from the rendered target: a table, a frame, a hand.
fn is_foreign(contrast: &Plane<f32>, rendered: &Plane<f32>, at: [f64; 2], reach: f64) -> bool {
    let (mut sum, mut count) = (0.0_f64, 0.0_f64);
    let range = |v: f64, size: usize| {
        let low = (v - reach).ceil().clamp(0.0, size as f64) as usize;
        low..((v + reach).floor() + 1.0).clamp(low as f64, size as f64) as usize
    };
    for y in range(at[1], contrast.height) {
        for x in range(at[0], contrast.width) {
            sum += f64::from((contrast.at(x, y) - rendered.at(x, y)).abs());
            count += 1.0;
        }
    }
    count > 0.0 && sum / count > FOREIGN
}

/// Strength of a dot at `at`: the regression coefficient of the residual `contrast - rendered + filled * profile` on
/// the radial profile, with a free offset (a dark table is no dot). 1 for a whole dot, 0 when the correlation is too
/// low, `None` when too little of it lies in the image. `filled` is the strength with which `rendered` includes this
/// dot.
fn strength(
    contrast: &Plane<f32>,
    rendered: &Plane<f32>,
    profile: &RadialProfile,
    at: [f64; 2],
    reach: f64,
    filled: f64,
) -> Option<f64> {
    let (mut n, mut s, mut ss, mut r, mut rr, mut sr, mut whole) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    let (left, right) = ((at[0] - reach).ceil() as i64, (at[0] + reach).floor() as i64);
    let (top, bottom) = ((at[1] - reach).ceil() as i64, (at[1] + reach).floor() as i64);
    for y in top..=bottom {
        for x in left..=right {
            let rho = (x as f64 - at[0]).hypot(y as f64 - at[1]);
            if rho > reach {
                continue;
            }
            whole += 1.0;
            if x < 0 || y < 0 || x >= contrast.width as i64 || y >= contrast.height as i64 {
                continue;
            }
            let (x, y) = (x as usize, y as usize);
            let value = profile.at(rho).0;
            let residual = f64::from(contrast.at(x, y) - rendered.at(x, y)) + filled * value;
            n += 1.0;
            s += value;
            ss += value * value;
            r += residual;
            rr += residual * residual;
            sr += value * residual;
        }
    }
    if n < MIN_VISIBLE * whole || n < 5.0 {
        return None;
    }
    let (vs, vr, c) = (ss - s * s / n, rr - r * r / n, sr - s * r / n);
    let alike = c / (vs * vr).sqrt().max(1e-12);
    Some(if alike > MIN_CORRELATION { c / vs.max(1e-12) } else { 0.0 })
}

/// Marks samples whose nearest dot is present.
const OWN_DOT: u32 = u32::MAX;
/// Marks samples far from every dot.
const NO_DOT: u32 = u32::MAX - 1;

/// Per sample: [`OWN_DOT`], [`NO_DOT`], or the index of the missing dot that is nearest.
fn nearest_dots(missing: &[PlacedDot], there: &[PlacedDot], pitch: f64, width: usize, height: usize) -> Plane<u32> {
    let reach = 0.75 * pitch;
    let mut nearest = Plane::filled(width, height, (f32::MAX, NO_DOT));
    let there = there.iter().map(|dot| (dot, OWN_DOT));
    for (dot, which) in there.chain(missing.iter().zip(0..)) {
        let range = |v: f64, size: usize| {
            let low = (v - reach).ceil().clamp(0.0, size as f64) as usize;
            low..((v + reach).floor() + 1.0).clamp(low as f64, size as f64) as usize
        };
        for y in range(dot.at[1], height) {
            for x in range(dot.at[0], width) {
                let far = ((x as f64 - dot.at[0]).powi(2) + (y as f64 - dot.at[1]).powi(2)) as f32;
                let here = &mut nearest.data[y * width + x];
                if far < here.0 {
                    *here = (far, which);
                }
            }
        }
    }
    nearest.map(|(_, which)| which)
}

/// Mean residual around each dot: what the rendered dots do not explain.
fn mean_residuals(
    contrast: &Plane<f32>,
    rendered: &Plane<f32>,
    valid: &Plane<u8>,
    own: &Plane<u8>,
    dots: &[PlacedDot],
    reach: f64,
) -> Vec<([f64; 2], f64)> {
    let mean = |dot: &PlacedDot| {
        let range = |v: f64, size: usize| {
            let low = (v - reach).ceil().clamp(0.0, size as f64) as usize;
            low..((v + reach).floor() + 1.0).clamp(low as f64, size as f64) as usize
        };
        let (mut sum, mut count) = (0.0_f64, 0.0_f64);
        for y in range(dot.at[1], contrast.height) {
            for x in range(dot.at[0], contrast.width) {
                let k = y * contrast.width + x;
                if valid.data[k] & own.data[k] != 0 {
                    sum += f64::from(contrast.data[k] - rendered.data[k]);
                    count += 1.0;
                }
            }
        }
        (count > 0.25 * reach * reach).then(|| (dot.at, sum / count))
    };
    dots.iter().filter_map(mean).collect()
}

/// The residual near a position as a plane `c0 + c1 x + c2 y`.
struct ResidualPlane {
    at: [f64; 2],
    numbers: Vector3<f64>,
}

impl ResidualPlane {
    /// Weighted least squares through the mean residuals of the dots within `reach` px.
    fn near(at: [f64; 2], means: &[([f64; 2], f64)], reach: f64) -> Self {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for (p, mean) in means {
            let [x, y] = [0, 1].map(|a| (p[a] - at[a]) / reach);
            let weight = 1.0 - x * x - y * y;
            if weight > 0.0 {
                let row = Vector3::new(1.0, x, y);
                normal += weight * row * row.transpose();
                right += weight * *mean * row;
            }
        }
        // ridge: a slope that the dots do not determine is 0
        let slope = 0.05 * normal[(0, 0)];
        normal += Matrix3::from_diagonal(&Vector3::new(1e-9, slope, slope));
        let numbers = normal.try_inverse().map_or_else(Vector3::zeros, |inverse| inverse * right);
        Self { at, numbers: Vector3::new(numbers[0], numbers[1] / reach, numbers[2] / reach) }
    }

    fn at(&self, p: [f64; 2]) -> f64 {
        self.numbers.dot(&Vector3::new(1.0, p[0] - self.at[0], p[1] - self.at[1]))
    }
}

/// 0 where the residual is too large for a dot (dust, scratches, lettering), else 1.
fn without_dust(contrast: &Plane<f32>, rendered: &Plane<f32>, own: &Plane<u8>, profile: &RadialProfile) -> Plane<u8> {
    let stride = (contrast.data.len() / 50_000).max(1) | 1;
    let residuals = |k: usize| (contrast.data[k] - rendered.data[k]).abs();
    let target = (0..contrast.data.len()).step_by(stride).filter(|&k| own.data[k] != 0);
    let mut sizes: Vec<f64> = target.map(|k| f64::from(residuals(k))).collect();
    let most = (8.0 * 1.4826 * median(&mut sizes)).max(0.35 * profile.peak()) as f32;
    let mut valid = Plane::filled(contrast.width, contrast.height, 1_u8);
    for y in 0..contrast.height {
        for x in 0..contrast.width {
            let k = y * contrast.width + x;
            if residuals(k) <= most || own.data[k] == 0 {
                continue;
            }
            // the rim of a speck covers its samples partly
            for row in y.saturating_sub(1)..(y + 2).min(contrast.height) {
                let line = &mut valid.data[row * contrast.width..(row + 1) * contrast.width];
                line[x.saturating_sub(1)..(x + 2).min(contrast.width)].fill(0);
            }
        }
    }
    valid
}

#[cfg(test)]
mod tests {
    use super::*;

    fn soft(rho: f64) -> f64 {
        0.7 * (-rho * rho / 18.0).exp()
    }

    /// A 7 x 5 grid whose dot (3, 2) is missing, with a speck of dust.
    fn scene() -> (Plane<f32>, Places) {
        let known: Places = (0..35)
            .map(|k| ([k % 7, k / 7], [30.3 + 16.0 * f64::from(k % 7), 28.6 + 16.0 * f64::from(k / 7)]))
            .collect();
        let contrast = Plane::from_fn(160, 130, |x, y| {
            let dots = known.iter().filter(|(label, _)| **label != [3, 2]);
            let sum: f64 = dots.map(|(_, p)| soft((x as f64 - p[0]).hypot(y as f64 - p[1]))).sum();
            let dust = if (60..63).contains(&x) && (52..55).contains(&y) { 0.9 } else { 0.0 };
            (sum + dust) as f32
        });
        (contrast, known)
    }

    #[test]
    fn gaps_and_ends_are_inpainted_and_dust_is_replaced() {
        let (contrast, known) = scene();
        let beside = super::super::lattice::beside(&known);
        let inpainted = inpaint(&contrast, &known, &beside, 16.0, true).expect("a profile");
        assert_eq!(inpainted.hidden, [[3, 2]]);
        assert!(inpainted.added.is_empty(), "{:?}", inpainted.added);
        let gap = known[&[3, 2]];
        let filled = inpainted.contrast.at(gap[0].round() as usize, gap[1].round() as usize);
        assert!((f64::from(filled) - soft(0.6)).abs() < 0.12, "{filled}");
        let end = beside[&[7, 1]];
        let filled = inpainted.contrast.at(end[0].round() as usize, end[1].round() as usize);
        assert!((f64::from(filled) - soft(0.6)).abs() < 0.12, "{filled}");
        assert!(inpainted.contrast.at(61, 53) < 0.3 && inpainted.valid.at(61, 53) == 0);
    }

    #[test]
    fn unknown_dots_beside_the_known_ones_are_found() {
        let (contrast, known) = scene();
        let part: Places = known.into_iter().filter(|(l, _)| l[0] < 6).collect();
        let inpainted =
            inpaint(&contrast, &part, &super::super::lattice::beside(&part), 16.0, false).expect("a profile");
        assert_eq!(inpainted.added.len(), 5, "{:?}", inpainted.added);
    }
}
