//! A picture of a height map as a shaded relief.

use super::INVALID;
use crate::imaging::{Plane, Raster};

/// Direction to the light: from the upper left, 45 degrees above the plane.
const LIGHT: [f32; 3] = [-0.5, -0.5, std::f32::consts::FRAC_1_SQRT_2];
/// Light that comes from everywhere.
const AMBIENT: f32 = 0.25;
/// Slope that the steep parts of the surface are drawn with, and the share of pixels that are less steep.
const STEEP: f32 = 0.8;
const LESS_STEEP: f64 = 0.8;
/// Half of the distance over which slopes are measured, px.
const ARM: usize = 2;
/// Side of the squares of the checkerboard that is drawn where no height is known, px; and its two tones.
const SQUARE: usize = 8;
const TONES: [u8; 2] = [104, 152];

/// The surface of the values of a height map ([`HeightMap::values`](super::HeightMap::values)) as 8-bit grey, lit from
/// the upper left (Lambert). Slopes are exaggerated alike everywhere, so that the steep parts are well visible. A
/// checkerboard shows where no height is known.
pub fn relief(values: &Plane<u16>) -> Raster {
    let (width, height) = (values.width, values.height);
    // rise per px along an axis, from the farthest known values within the arms
    let rise = |at: &dyn Fn(isize) -> Option<u16>| {
        let reach = |sign: isize| (0..=ARM as isize).rev().find_map(|d| at(sign * d).map(|value| (sign * d, value)));
        match (reach(-1), reach(1)) {
            (Some((from, low)), Some((to, high))) if to > from => {
                (f32::from(high) - f32::from(low)) / (to - from) as f32
            }
            _ => 0.0,
        }
    };
    let known = |x: Option<usize>, y: Option<usize>| {
        let (x, y) = (x.filter(|&x| x < width)?, y.filter(|&y| y < height)?);
        Some(values.at(x, y)).filter(|&value| value != INVALID)
    };
    let slope = |x: usize, y: usize| {
        known(Some(x), Some(y)).map(|_| {
            let across = rise(&|d| known(x.checked_add_signed(d), Some(y)));
            [across, rise(&|d| known(Some(x), y.checked_add_signed(d)))]
        })
    };
    let stride = (width * height / 100_000).max(1);
    let sampled = (0..width * height).step_by(stride).filter_map(|i| slope(i % width, i / width));
    let mut steepness: Vec<f32> = sampled.map(|[x, y]| x.hypot(y)).collect();
    steepness.sort_by(f32::total_cmp);
    let steep = steepness.get((steepness.len() as f64 * LESS_STEEP) as usize).copied().unwrap_or(0.0);
    let exaggeration = STEEP / steep.max(1.0);
    let tone = |x: usize, y: usize| match slope(x, y) {
        None => TONES[(x / SQUARE + y / SQUARE) % 2],
        Some(slope) => {
            let [across, down] = slope.map(|rise| rise * exaggeration);
            let towards = -across * LIGHT[0] - down * LIGHT[1] + LIGHT[2];
            let lambert = (towards / (1.0 + across * across + down * down).sqrt()).max(0.0);
            (255.0 * (AMBIENT + (1.0 - AMBIENT) * lambert)).round() as u8
        }
    };
    Raster::eight(width, height, 1, Plane::from_fn(width, height, tone).data)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::Samples;

    #[test]
    fn slopes_that_face_the_upper_left_are_bright_and_unknown_heights_are_a_checkerboard() {
        // a pyramid on a plain, and an unknown corner
        let values = Plane::from_fn(80, 80, |x, y| {
            let distance = x.abs_diff(40).max(y.abs_diff(40));
            if x >= 64 && y >= 64 { INVALID } else { 1000 + 100 * 20usize.saturating_sub(distance) as u16 }
        });
        let Samples::Eight(tones) = relief(&values).samples else { panic!("8 bits expected") };
        let at = |x: usize, y: usize| tones[y * 80 + x];
        let (left, right, above, below, plain) = (at(26, 40), at(54, 40), at(40, 26), at(40, 54), at(6, 6));
        assert!(left > plain + 20 && above > plain + 20, "{left} {above} {plain}");
        assert!(right + 20 < plain && below + 20 < plain, "{right} {below} {plain}");
        assert_eq!([at(64, 64), at(72, 64), at(72, 72)], [TONES[0], TONES[1], TONES[0]]);
    }
}
