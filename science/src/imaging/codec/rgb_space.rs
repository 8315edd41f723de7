//! RGB colour spaces by their chromaticities.

use nalgebra::{Matrix3, Vector3};

/// How samples become light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Curve {
    /// That of sRGB (IEC 61966-2-1).
    Srgb,
    /// A power.
    Gamma(f64),
}

impl Curve {
    /// The light of the sample `value`, both 0 to 1.
    pub(super) fn at(self, value: f64) -> f64 {
        match self {
            Self::Gamma(gamma) => value.powf(gamma),
            Self::Srgb if value <= 0.04045 => value / 12.92,
            Self::Srgb => ((value + 0.055) / 1.055).powf(2.4),
        }
    }
}

/// Chromaticities (CIE x, y) and curve of an RGB colour space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rgb {
    pub white: [f64; 2],
    pub primaries: [[f64; 2]; 3],
    pub curve: Curve,
}

pub(super) const D65: [f64; 2] = [0.3127, 0.3290];

pub(super) const SRGB: Rgb =
    Rgb { white: D65, primaries: [[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]], curve: Curve::Srgb };

/// Adobe RGB (1998), section 4.3.
pub(super) const ADOBE_RGB: Rgb =
    Rgb { white: D65, primaries: [[0.64, 0.33], [0.21, 0.71], [0.15, 0.06]], curve: Curve::Gamma(2.0 + 51.0 / 256.0) };

/// The power that files state for the curve of sRGB.
const USUAL_GAMMA: f64 = 2.2;

/// CIE XYZ of D50, the white of ICC profiles.
pub(super) const D50: [f64; 3] = [0.9642, 1.0, 0.8249];

impl Rgb {
    /// XYZ of red, green and blue under D50 (adapted by Bradford, as ICC requires); `None` for impossible
    /// chromaticities.
    pub(super) fn colourants(&self) -> Option<[[f64; 3]; 3]> {
        let bradford = Matrix3::new(0.8951, 0.2664, -0.1614, -0.7502, 1.7135, 0.0367, 0.0389, -0.0685, 1.0296);
        let [x, y] = self.white;
        let white = Vector3::new(x / y, 1.0, (1.0 - x - y) / y);
        let columns = self.primaries.map(|[x, y]| Vector3::new(x, y, 1.0 - x - y));
        let primaries = Matrix3::from_columns(&columns);
        let scaled = primaries * Matrix3::from_diagonal(&(primaries.try_inverse()? * white));
        let gains = (bradford * Vector3::from(D50)).component_div(&(bradford * white));
        let adapted = bradford.try_inverse()? * Matrix3::from_diagonal(&gains) * bradford * scaled;
        let found: [[f64; 3]; 3] = adapted.into();
        found.as_flattened().iter().all(|v| v.abs() < 2.0).then_some(found)
    }
}

/// What a file says about its colours besides an ICC profile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Declared {
    /// sRGB, or nothing.
    Srgb,
    /// Another space.
    Space(Rgb),
    /// Not sRGB, or a space that is not known here.
    Unknown,
}

impl Declared {
    /// A space by chromaticities and, if known, the power of its curve. Files state 2.2 or its inverse for sRGB, and
    /// nothing for the usual curve.
    pub(super) fn of(white: [f64; 2], primaries: [[f64; 2]; 3], gamma: Option<f64>) -> Self {
        let near = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs() < 0.002 && (a[1] - b[1]).abs() < 0.002;
        let has_srgb_colours = near(white, D65) && primaries.iter().zip(SRGB.primaries).all(|(&a, b)| near(a, b));
        let gamma = gamma.unwrap_or(USUAL_GAMMA);
        if has_srgb_colours && (gamma - USUAL_GAMMA).abs() < 0.02 {
            return Self::Srgb;
        }
        let is_plausible = (0.1..=10.0).contains(&gamma);
        if is_plausible { Self::Space(Rgb { white, primaries, curve: Curve::Gamma(gamma) }) } else { Self::Unknown }
    }
}
