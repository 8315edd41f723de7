//! Lateral colour: red and blue light is imaged at another scale than green light.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Where red and blue light falls relative to green light; the same in every slice.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LateralColour {
    /// Displacement of red.
    pub red: ColourDisplacement,
    /// Displacement of blue.
    pub blue: ColourDisplacement,
}

/// Displacement of a colour relative to green. With `m` the middle of the image, `((width - 1) / 2, (height - 1) / 2)`,
/// a point that is seen at `p` in green is seen at
///
/// `p + shift_px + scale (p - m)`
///
/// in this colour, in px of the slice.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ColourDisplacement {
    /// Scale of the image relative to green, minus 1. Negative: points are nearer to the middle than in green.
    pub scale: f64,
    /// Displacement in the middle of the image, `[x, y]` px.
    #[serde(default)]
    pub shift_px: [f64; 2],
}

/// Largest absolute value of [`ColourDisplacement::scale`]. Real lenses stay below 0.01.
const MAX_SCALE: f64 = 0.05;
/// Largest absolute value of a coordinate of [`ColourDisplacement::shift_px`].
const MAX_SHIFT_PX: f64 = 50.0;

impl LateralColour {
    /// Largest displacement at a corner of a `width` x `height` image, px.
    pub fn max_displacement_px(&self, width: u32, height: u32) -> f64 {
        self.red.max_displacement_px(width, height).max(self.blue.max_displacement_px(width, height))
    }

    /// Why a lens cannot have this lateral colour, as the predicate of a sentence; `None` when it can: every number is
    /// finite, a scale is -0.05 to 0.05, and a shift at most 50 px in x and in y.
    pub fn violation(&self) -> Option<String> {
        [("red", self.red), ("blue", self.blue)].into_iter().find_map(|(colour, of)| {
            if !(-MAX_SCALE..=MAX_SCALE).contains(&of.scale) {
                return Some(format!(
                    "has the scale {} for {colour}; it must be -{MAX_SCALE} to {MAX_SCALE}",
                    of.scale
                ));
            }
            let fits = of.shift_px.iter().all(|shift| (-MAX_SHIFT_PX..=MAX_SHIFT_PX).contains(shift));
            let detail = || format!("has the shift {:?} px for {colour}; the limit is {MAX_SHIFT_PX} px", of.shift_px);
            (!fits).then(detail)
        })
    }
}

impl ColourDisplacement {
    /// The displacement at `p` of a `width` x `height` image, px.
    pub fn at(&self, p: [f64; 2], width: u32, height: u32) -> [f64; 2] {
        let middle = [width, height].map(|length| 0.5 * (f64::from(length) - 1.0));
        [0, 1].map(|a| self.shift_px[a] + self.scale * (p[a] - middle[a]))
    }

    /// Largest displacement at a corner of a `width` x `height` image, px.
    pub fn max_displacement_px(&self, width: u32, height: u32) -> f64 {
        let corners = super::Homography::corners(width, height);
        corners.into_iter().map(|p| self.at(p, width, height)).map(|d| d[0].hypot(d[1])).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(scale: f64, shift_px: [f64; 2]) -> LateralColour {
        LateralColour { red: ColourDisplacement { scale, shift_px }, blue: ColourDisplacement::default() }
    }

    #[test]
    fn the_size_is_the_largest_displacement_at_a_corner() {
        // corners are 300 px and 200 px from the middle
        let lens = of(0.01, [1.0, 0.0]);
        assert_eq!(lens.red.at([300.0, 200.0], 601, 401), [1.0, 0.0]);
        assert_eq!(lens.red.at([600.0, 400.0], 601, 401), [4.0, 2.0]);
        assert!((lens.max_displacement_px(601, 401) - 20.0_f64.sqrt()).abs() < 1e-12);
        assert_eq!(of(0.0, [0.0; 2]).max_displacement_px(601, 401), 0.0);
    }

    #[test]
    fn a_displacement_that_no_lens_has_is_refused() {
        assert_eq!(of(-0.05, [50.0, -50.0]).violation(), None);
        for wrong in [of(0.051, [0.0; 2]), of(f64::NAN, [0.0; 2]), of(0.0, [0.0, -51.0]), of(0.0, [f64::INFINITY, 0.0])]
        {
            assert!(wrong.violation().expect("refused").contains("for red"), "{wrong:?}");
        }
    }

    #[test]
    fn the_shift_may_be_absent_in_json() {
        let read: LateralColour =
            serde_json::from_str(r#"{"red":{"scale":0.001},"blue":{"scale":-0.001,"shift_px":[0.5,0]}}"#)
                .expect("valid");
        assert_eq!((read.red.shift_px, read.blue.shift_px), ([0.0; 2], [0.5, 0.0]));
    }
}
