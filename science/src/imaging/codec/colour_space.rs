//! The colour space of a picture.
//!
//! In: an ICC profile, or what EXIF, TIFF and PNG say without one. Out: the [`ColourSpace`], by which slices are
//! compared, and an ICC profile for every output. All outputs can hold a profile, and all programs read it; the other
//! marks are for one format each.

use std::hash::{DefaultHasher, Hasher};

use super::{
    icc,
    rgb_space::{ADOBE_RGB, Declared, Rgb, SRGB},
};

/// The colour space of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ColourSpace {
    /// sRGB: by its profile or another mark, or because the file says nothing.
    #[default]
    Srgb,
    /// Adobe RGB (1998): by its profile or by EXIF.
    AdobeRgb,
    /// That of another ICC profile, with a hash of it.
    Other(u64),
    /// Declared, but not in a way that an output can repeat.
    Unknown,
}

/// Largest difference of XYZ and of light between spaces that count as equal: profiles round, and adapt the white in
/// different ways.
const ALIKE: f64 = 0.004;

/// Samples at which curves are compared. In the dark, 2.2 is told from sRGB.
const COMPARED_AT: [f64; 2] = [0.2, 0.5];

/// The ICC profile for outputs, and the colour space, of a picture of `channels` channels with the embedded profile
/// `icc`, or with another mark. The profile is right where both disagree.
pub(super) fn resolved(icc: Option<Vec<u8>>, other: Declared, channels: u8) -> (Option<Vec<u8>>, ColourSpace) {
    let icc = match (icc, other) {
        (Some(icc), _) => icc,
        (None, Declared::Srgb) => return (None, ColourSpace::Srgb),
        (None, Declared::Space(space)) if space == SRGB => return (None, ColourSpace::Srgb),
        (None, Declared::Unknown) => return (None, ColourSpace::Unknown),
        (None, Declared::Space(space)) => match icc::of_rgb(&space) {
            Some(icc) => icc,
            None => return (None, ColourSpace::Unknown),
        },
    };
    // one for CMYK in an RGB file would give wrong colours
    let fits = match icc.get(16..20) {
        Some(b"GRAY") => channels == 1,
        other => other == Some(b"RGB "),
    };
    if !fits {
        return (None, ColourSpace::Unknown);
    }
    let space = ColourSpace::of_icc(&icc);
    (Some(icc), space)
}

impl ColourSpace {
    /// The space of an ICC profile. Profiles of programs differ in dates and texts, so the well-known spaces are
    /// recognised by their numbers.
    fn of_icc(icc: &[u8]) -> Self {
        let near = |a: f64, b: f64| (a - b).abs() < ALIKE;
        let is = |space: &Rgb, curves: &[[u8; 4]]| {
            curves.iter().all(|name| {
                COMPARED_AT.iter().all(|&v| icc::curve_at(icc, *name, v).is_some_and(|l| near(l, space.curve.at(v))))
            })
        };
        let has_colourants = |space: &Rgb| match (icc::colourants(icc), space.colourants()) {
            (Some(a), Some(b)) => a.as_flattened().iter().zip(b.as_flattened()).all(|(&a, &b)| near(a, b)),
            _ => false,
        };
        let is_rgb = |space: &Rgb| has_colourants(space) && is(space, &icc::RGB_CURVES);
        match icc.get(16..20) {
            Some(b"RGB ") if is_rgb(&SRGB) => Self::Srgb,
            Some(b"RGB ") if is_rgb(&ADOBE_RGB) => Self::AdobeRgb,
            Some(b"GRAY") if is(&SRGB, &[icc::GREY_CURVE]) => Self::Srgb,
            Some(b"RGB ") => Self::Other(hash(icc)),
            Some(b"GRAY") if icc::rgb_of_grey(icc).is_some() => Self::Other(hash(icc)),
            _ => Self::Unknown,
        }
    }

    /// What a slice of this space is, as the end of a clause.
    pub fn clause(self) -> &'static str {
        match self {
            Self::Srgb => "is in sRGB or says nothing",
            Self::AdobeRgb => "is in Adobe RGB",
            Self::Other(_) => "has another colour profile",
            Self::Unknown => "is in a colour space that is not known",
        }
    }
}

/// A hash of a profile without its header, which may hold the time of the writing.
fn hash(icc: &[u8]) -> u64 {
    let mut hasher = DefaultHasher::new();
    hasher.write(icc.get(icc::HEADER_BYTES..).unwrap_or_default());
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::codec::rgb_space::Curve;

    #[test]
    fn a_generated_profile_has_the_colourants_of_adobe() {
        // of AdobeRGB1998.icc
        let expected = [[0.60974, 0.20528, 0.14919], [0.31111, 0.62567, 0.06322], [0.01947, 0.06087, 0.74457]];
        let icc = icc::of_rgb(&ADOBE_RGB).unwrap();
        let found = icc::colourants(&icc).unwrap();
        for (colour, of) in found.iter().enumerate() {
            for (axis, value) in of.iter().enumerate() {
                assert!((value - expected[axis][colour]).abs() < 2e-4, "{colour} {axis}: {value}");
            }
        }
        let curve = icc::curve_at(&icc, *b"gTRC", 0.5).unwrap();
        assert!((curve - 0.5_f64.powf(563.0 / 256.0)).abs() < 1e-9, "{curve}");
        assert_eq!(ColourSpace::of_icc(&icc), ColourSpace::AdobeRgb);
        assert_eq!(icc.len(), u32::from_be_bytes(*icc.first_chunk().unwrap()) as usize);
    }

    #[test]
    fn spaces_are_recognised_by_their_numbers_and_not_by_date_or_name() {
        let of = |space: &Rgb| ColourSpace::of_icc(&icc::of_rgb(space).unwrap());
        assert_eq!(of(&SRGB), ColourSpace::Srgb);
        // sRGB with a plain power is darker in the shadows
        let plain = Rgb { curve: Curve::Gamma(2.2), ..SRGB };
        assert!(matches!(of(&plain), ColourSpace::Other(_)));
        assert_ne!(of(&plain), of(&Rgb { curve: Curve::Gamma(1.8), ..SRGB }));
        let mut dated = icc::of_rgb(&plain).unwrap();
        dated[24..36].copy_from_slice(&[7; 12]);
        assert_eq!(ColourSpace::of_icc(&dated), of(&plain));
        for (space, expected) in [(b"CMYK", ColourSpace::Unknown), (b"GRAY", ColourSpace::Unknown)] {
            let mut other = icc::of_rgb(&plain).unwrap();
            other[16..20].copy_from_slice(space);
            assert_eq!(ColourSpace::of_icc(&other), expected);
        }
        assert_eq!(ColourSpace::of_icc(b"rubbish"), ColourSpace::Unknown);
    }

    #[test]
    fn impossible_chromaticities_are_an_unknown_space() {
        let line = Rgb { primaries: [[0.2, 0.2], [0.3, 0.3], [0.4, 0.4]], ..ADOBE_RGB };
        let black = Rgb { white: [0.3, 0.0], ..ADOBE_RGB };
        for space in [line, black] {
            assert_eq!(resolved(None, Declared::Space(space), 3), (None, ColourSpace::Unknown));
        }
    }
}
