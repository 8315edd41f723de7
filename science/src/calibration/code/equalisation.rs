//! Equalisation: the contrast as if all dots of a coded target had the same size.
//!
//! A neighbour that is larger than the others shifts the phase of a dot towards itself. The sizes follow from the code,
//! and the difference between a large and a small dot, blurred as in this slice, is a radial profile as that of a dot
//! is. With `M` the mean profile, `D` half the difference and `c_k` = 1 or -1 the code, the contrast is `sum_k M(|x -
//! x_k|) + c_k D(|x - x_k|)`. The signs of the code are random, so `M` and `D` are estimated one after the other: `M`
//! from the contrast, `D` from the rest.

use super::place::CodePlace;
use crate::calibration::radial_profile::{PlacedDot, REACH, RadialProfile};
use crate::calibration::{lattice::Places, working_image::pixels_within};
use crate::imaging::Plane;

/// Pixels within this distance of a dot, in grid steps, are used: others may show dots that are not known yet.
const NEAR: f64 = 0.6;

/// The contrast of the differences in size.
#[derive(Debug)]
pub(in crate::calibration) struct SizeDifferences(Plane<f32>);

impl SizeDifferences {
    /// Measures the differences in `contrast`, with dots at `places` (px of the plane). `None` when no profile can be
    /// measured.
    pub(in crate::calibration) fn measure(
        contrast: &Plane<f32>,
        places: &Places,
        pitch: f64,
        code: &CodePlace,
    ) -> Option<Self> {
        let (width, height) = (contrast.width, contrast.height);
        let dots: Vec<PlacedDot> = places.values().map(|at| PlacedDot { at: *at, strength: 1.0 }).collect();
        let signed: Vec<PlacedDot> =
            places.iter().map(|(label, at)| PlacedDot { at: *at, strength: code.size(*label).sign() }).collect();
        let near = near_dots(places, NEAR * pitch, width, height);
        let mean = RadialProfile::measure(contrast, &near, &dots, REACH * pitch)?;
        let mut rest = mean.render(&dots, width, height);
        rest.data.iter_mut().zip(&contrast.data).for_each(|(rest, value)| *rest = value - *rest);
        let difference = RadialProfile::measure(&rest, &near, &signed, REACH * pitch)?;
        Some(Self(difference.render(&signed, width, height)))
    }

    /// `contrast` with all dots of the mean size.
    pub(in crate::calibration) fn equalised(&self, mut contrast: Plane<f32>) -> Plane<f32> {
        contrast.data.iter_mut().zip(&self.0.data).for_each(|(value, difference)| *value -= difference);
        contrast
    }

    /// `contrast` of equal dots with the differences put back.
    pub(in crate::calibration) fn restored(&self, contrast: &Plane<f32>) -> Plane<f32> {
        let data = contrast.data.iter().zip(&self.0.data).map(|(value, difference)| value + difference).collect();
        Plane { width: contrast.width, height: contrast.height, data }
    }
}

/// 1 within `reach` px of a dot, else 0.
fn near_dots(places: &Places, reach: f64, width: usize, height: usize) -> Plane<u8> {
    let mut near = Plane::filled(width, height, 0_u8);
    for at in places.values() {
        for y in pixels_within(at[1], reach, 0..height) {
            let half = (reach * reach - (y as f64 - at[1]).powi(2)).max(0.0).sqrt();
            near.row_mut(y)[pixels_within(at[0], half, 0..width)].fill(1);
        }
    }
    near
}
