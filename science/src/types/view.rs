//! The angles of a view: how they appear in file names, and where they place the camera.
//!
//! # The turntable convention
//! The world has its origin where the axes of pan and tilt meet, and its z axis along the axis of the turntable,
//! upwards. The object is at rest; the camera moves around it. At pan `p`, tilt `t` and radius `r` the centre of
//! projection is
//!
//! `C = r (cos t cos p, cos t sin p, sin t)`,
//!
//! and the camera looks at the origin with its image upright: camera axes x right, y down, z forward. Turning the table
//! clockwise, seen from above, increases the pan of the camera.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Pan and tilt of a view, degrees.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ViewAngles {
    /// Pan of the camera about the axis of the turntable, degrees.
    pub pan_deg: f64,
    /// Tilt of the camera above the plane of the turntable, degrees.
    pub tilt_deg: f64,
}

impl ViewAngles {
    /// The name of a file of this view, without extension: `pan020_tilt-06`, `pan020p5_tilt06p25`. Angles are rounded
    /// to 0.001 degrees; `p` is the decimal point, because several programs end the name of an image at its first dot.
    /// With angles of 0 or more (pan below 1000, tilt below 100), names sort by pan, then by tilt.
    pub fn file_stem(&self) -> String {
        format!("pan{}_tilt{}", number(self.pan_deg, 3), number(self.tilt_deg, 2))
    }

    /// The angles that a name or path contains as `pan` and `tilt`, each followed by a number: `pan020p5_tilt-06.png`,
    /// `tilt=6/pan=120`, `Tilt_06.5_Pan_120`, `pan022,5_tilt10`. Case is ignored. Between word and number there may be
    /// one of `=`, `_` and a blank. `None` unless both are given exactly once.
    pub fn of_name(name: &str) -> Option<Self> {
        let name = name.to_ascii_lowercase();
        Some(Self { pan_deg: angle_after(&name, "pan")?, tilt_deg: angle_after(&name, "tilt")? })
    }

    /// Unit vector from the origin of the world to the centre of projection.
    pub fn direction(&self) -> [f64; 3] {
        let (sin_pan, cos_pan) = self.pan_deg.to_radians().sin_cos();
        let (sin_tilt, cos_tilt) = self.tilt_deg.to_radians().sin_cos();
        [cos_tilt * cos_pan, cos_tilt * sin_pan, sin_tilt]
    }

    /// Rotation from world to camera, by rows: the camera's x, y and z axes in world coordinates.
    pub fn rotation(&self) -> [[f64; 3]; 3] {
        let (sin_pan, cos_pan) = self.pan_deg.to_radians().sin_cos();
        let (sin_tilt, cos_tilt) = self.tilt_deg.to_radians().sin_cos();
        [
            [-sin_pan, cos_pan, 0.0],
            [sin_tilt * cos_pan, sin_tilt * sin_pan, -cos_tilt],
            [-cos_tilt * cos_pan, -cos_tilt * sin_pan, -sin_tilt],
        ]
    }
}

/// An angle with at least `digits` digits before the decimal point, and at most three after it.
fn number(degrees: f64, digits: usize) -> String {
    let text = format!("{:.3}", degrees.abs());
    let (whole, fraction) = text.split_once('.').unwrap_or((&text, ""));
    let fraction = fraction.trim_end_matches('0');
    let is_zero = fraction.is_empty() && whole == "0";
    let sign = if degrees < 0.0 && !is_zero { "-" } else { "" };
    let point = if fraction.is_empty() { "" } else { "p" };
    format!("{sign}{whole:0>digits$}{point}{fraction}")
}

/// The number after `word`; `None` when the word occurs with a number not at all or more than once.
fn angle_after(name: &str, word: &str) -> Option<f64> {
    let mut found = name.match_indices(word).filter_map(|(at, _)| {
        let begins_a_word = !name[..at].ends_with(|c: char| c.is_ascii_alphabetic());
        let rest = &name[at + word.len()..];
        begins_a_word
            .then(|| leading_number(rest.strip_prefix(['=', '_', ' ']).unwrap_or(rest)))
            .flatten()
            .map(|(angle, _)| angle)
    });
    let angle = found.next()?;
    found.next().is_none().then_some(angle)
}

/// The decimal number at the start of a text, and its length in bytes. The decimal point is `.`, `,` or `p`, between
/// digits; at most 12 digits.
pub(crate) fn leading_number(text: &str) -> Option<(f64, usize)> {
    let signed = usize::from(text.starts_with(['-', '+']));
    let digits = |from: usize| text.get(from..).map_or(0, |rest| rest.bytes().take_while(u8::is_ascii_digit).count());
    let whole = digits(signed);
    let point = signed + whole;
    let fraction = if text[point..].starts_with(['.', ',', 'p']) { digits(point + 1) } else { 0 };
    if whole == 0 || whole + fraction > 12 {
        return None;
    }
    let (end, written) = match fraction {
        0 => (point, text[..point].to_owned()),
        _ => (point + 1 + fraction, format!("{}.{}", &text[..point], &text[point + 1..point + 1 + fraction])),
    };
    Some((written.parse().ok()?, end))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn view(pan_deg: f64, tilt_deg: f64) -> ViewAngles {
        ViewAngles { pan_deg, tilt_deg }
    }

    #[test]
    fn names_are_stable_and_without_dots() {
        assert_eq!(view(20.0, -6.0).file_stem(), "pan020_tilt-06");
        assert_eq!(view(20.5, 6.25).file_stem(), "pan020p5_tilt06p25");
        assert_eq!(view(-0.0001, 0.0).file_stem(), "pan000_tilt00");
    }

    #[test]
    fn angles_are_found_in_the_names_that_people_give() {
        assert_eq!(ViewAngles::of_name("tilt=-6/pan=120/img_3.jpg"), Some(view(120.0, -6.0)));
        assert_eq!(ViewAngles::of_name("Bee_Pan 7.5_Tilt_06"), Some(view(7.5, 6.0)));
        assert_eq!(ViewAngles::of_name("pan022,5_tilt-7,5.png"), Some(view(22.5, -7.5)));
        assert_eq!(ViewAngles::of_name("pan22,tilt7"), Some(view(22.0, 7.0)), "a comma that separates");
        assert_eq!(ViewAngles::of_name("span3_tilt4"), None, "pan must begin a word");
        assert_eq!(ViewAngles::of_name("panorama_tilt4"), None);
        assert_eq!(ViewAngles::of_name("pan1_pan2_tilt4"), None, "ambiguous");
        assert_eq!(ViewAngles::of_name("pan99999999999999_tilt4"), None);
    }

    #[test]
    fn the_camera_looks_at_the_origin_with_its_image_upright() {
        let level = view(0.0, 0.0);
        assert_eq!(level.direction(), [1.0, 0.0, 0.0]);
        let [right, down, forward] = level.rotation();
        assert_eq!((right, forward), ([0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]));
        assert_eq!(down, [0.0, 0.0, -1.0]);
    }

    proptest! {
        #[test]
        fn a_name_gives_back_its_angles(pan in -720_000i32..720_000, tilt in -90_000i32..90_000) {
            let angles = view(f64::from(pan) / 1000.0, f64::from(tilt) / 1000.0);
            let back = ViewAngles::of_name(&angles.file_stem()).expect("its own name");
            prop_assert!((back.pan_deg - angles.pan_deg).abs() < 1e-9);
            prop_assert!((back.tilt_deg - angles.tilt_deg).abs() < 1e-9);
        }

        #[test]
        fn the_rotation_is_orthonormal_and_right_handed(pan in -360.0..360.0f64, tilt in -90.0..90.0f64) {
            let angles = view(pan, tilt);
            let rows = angles.rotation().map(nalgebra::Vector3::from);
            prop_assert!((rows[0].cross(&rows[1]) - rows[2]).norm() < 1e-12);
            prop_assert!((rows[2] + nalgebra::Vector3::from(angles.direction())).norm() < 1e-12);
            prop_assert!(rows.iter().all(|row| (row.norm() - 1.0).abs() < 1e-12));
        }
    }
}
