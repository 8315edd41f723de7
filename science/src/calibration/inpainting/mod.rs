//! Inpainting of the grid: the contrast image as if the grid had no end, no gaps and no dust.
//!
//! A phase window extends one grid step from its centre. Beside a missing dot or at the end of the grid, half of the
//! expected pattern is absent, which biases the phase. Missing dots are therefore drawn in with the radial profile of
//! the other dots of the slice, and whatever no dot explains (dust, lettering, the table beyond the target) is
//! replaced.
//!
//! | stage | module | what it does |
//! |---|---|---|
//! | presence | `presence` | decides which dots are visible, and which positions lie outside the target |
//! | ground | `ground` | per sample the nearest dot, and what the rendered dots do not explain |
//! | composition | here | replaces what lies outside the target and dust, and draws missing dots in |

mod ground;
mod presence;

use ground::{NO_DOT, PRESENT_DOT, ResidualPlane, mean_residuals, nearest_dots};
use presence::Presence;

use super::lattice::{Label, Places};
use super::radial_profile::{PlacedDot, REACH, RadialProfile};
use super::statistics::mad_sigma;
use crate::imaging::Plane;

/// The inpainted grid of one slice.
#[derive(Debug)]
pub(super) struct InpaintedGrid {
    /// Contrast with missing dots drawn in, and with what is not the target replaced.
    pub contrast: Plane<f32>,
    /// 0 where dust was replaced, else 1.
    pub valid: Plane<u8>,
    /// 1 where the sample shows the target itself: neither dust nor beyond the target.
    pub ground: Plane<u8>,
    /// Radial profile of one dot.
    pub profile: RadialProfile,
    /// Dots beside the known ones that were found.
    pub added: Places,
    /// Known dots that are not visible in this slice.
    pub hidden: Vec<Label>,
    /// Positions beside the grid that lie outside the target.
    pub outside: Vec<Label>,
    /// Contrast of the missing dots that were drawn in.
    pub filled: Plane<f32>,
    /// Contrast of all dots that are present, rendered from the profile.
    pub rendered: Plane<f32>,
    /// 1 where the contrast is synthetic: drawn in or replaced.
    pub synthetic: Plane<f32>,
}

/// Inpaints `contrast`. `known` are dots of the target, `candidates` positions where it may have one; both in px of the
/// plane. `clean`: also replaces dust. `None` when no radial profile can be measured.
pub(super) fn inpaint(
    contrast: &Plane<f32>,
    known: &Places,
    candidates: &Places,
    pitch: f64,
    clean: bool,
) -> Option<InpaintedGrid> {
    let (width, height) = (contrast.width, contrast.height);
    let presence = Presence::decide(contrast, known, candidates, pitch)?;
    let dots: Vec<PlacedDot> = presence.present.values().copied().collect();
    let (outside, outside_dots): (Vec<Label>, Vec<PlacedDot>) = presence.outside.iter().copied().unzip();
    // beyond the target may be a table, a hand or lettering: everything there is replaced
    let nearest = nearest_dots(&outside_dots, &dots, pitch, width, height);
    let on_target = nearest.map(|nearest| u8::from(nearest == PRESENT_DOT));
    let profile = RadialProfile::measure(contrast, &on_target, &dots, REACH * pitch)?;
    let rendered = profile.render(&dots, width, height);
    let valid =
        if clean { without_dust(contrast, &rendered, &on_target, &profile) } else { Plane::filled(width, height, 1) };
    let filled = profile.render(&presence.missing(), width, height);
    let ground = valid.data.iter().zip(&on_target.data).map(|(a, b)| a & b).collect();
    let ground = Plane { width, height, data: ground };
    // where the flat field misses the ground (glare), it misses it beyond the target too; without this correction a
    // step half a pitch outside the outermost dots would pull them outward
    let means = mean_residuals(contrast, &rendered, &ground, &dots, 0.5 * pitch);
    let levels: Vec<ResidualPlane> =
        outside_dots.iter().map(|dot| ResidualPlane::near(dot.at, &means, 2.6 * pitch)).collect();
    let sample = |k: usize| match levels.get(nearest.data[k] as usize) {
        Some(level) => rendered.data[k] + level.at([(k % width) as f64, (k / width) as f64]) as f32,
        None if valid.data[k] == 0 => rendered.data[k],
        None => contrast.data[k],
    };
    let is_seen = |k: usize| nearest.data[k] >= NO_DOT && valid.data[k] != 0 && filled.data[k].abs() < 0.02;
    Some(InpaintedGrid {
        contrast: plane_of(width, height, |k| filled.data[k] + sample(k)),
        synthetic: plane_of(width, height, |k| f32::from(u8::from(!is_seen(k)))),
        valid,
        ground,
        profile,
        added: presence.added,
        hidden: presence.hidden,
        outside,
        filled,
        rendered,
    })
}

/// The plane whose sample `k`, row by row, is `value(k)`.
fn plane_of(width: usize, height: usize, value: impl Fn(usize) -> f32) -> Plane<f32> {
    Plane { width, height, data: (0..width * height).map(value).collect() }
}

/// 0 where the residual is too large for a dot (dust, scratches, lettering), else 1.
fn without_dust(
    contrast: &Plane<f32>,
    rendered: &Plane<f32>,
    on_target: &Plane<u8>,
    profile: &RadialProfile,
) -> Plane<u8> {
    let stride = (contrast.data.len() / 50_000).max(1) | 1;
    let residuals = |k: usize| (contrast.data[k] - rendered.data[k]).abs();
    let target = (0..contrast.data.len()).step_by(stride).filter(|&k| on_target.data[k] != 0);
    let most = (8.0 * mad_sigma(target.map(|k| f64::from(residuals(k))))).max(0.35 * profile.peak()) as f32;
    let mut valid = Plane::filled(contrast.width, contrast.height, 1_u8);
    for y in 0..contrast.height {
        for x in 0..contrast.width {
            let k = y * contrast.width + x;
            if residuals(k) <= most || on_target.data[k] == 0 {
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
        let beside = crate::calibration::lattice::beside(&known);
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
            inpaint(&contrast, &part, &crate::calibration::lattice::beside(&part), 16.0, false).expect("a profile");
        assert_eq!(inpainted.added.len(), 5, "{:?}", inpainted.added);
    }
}
