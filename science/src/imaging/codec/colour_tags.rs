//! The tags of EXIF and TIFF that declare a colour space.

use exif::{Rational, Tag, Value};

use super::{
    exif_block::{Entry, Structure},
    rgb_space::{ADOBE_RGB, D65, Declared, SRGB},
};

/// `InteroperabilityIndex` of DCF's optional colour space, which is Adobe RGB (CIPA DC-009, 2.4).
const OPTIONAL_SPACE: &[u8] = b"R03";

/// What tags of EXIF and TIFF say about colours.
#[derive(Default)]
pub(super) struct ColourTags {
    /// Exif: `ColorSpace`.
    pub space: Option<u32>,
    /// Interoperability: `InteroperabilityIndex`.
    pub index: Option<Vec<u8>>,
    /// `WhitePoint`, two numbers.
    pub white: Vec<f64>,
    /// `PrimaryChromaticities`, six numbers.
    pub primaries: Vec<f64>,
    /// Exif: `Gamma`.
    pub gamma: Option<f64>,
    /// There is a `TransferFunction`.
    pub has_transfer: bool,
}

impl ColourTags {
    /// The tags of a block.
    pub(super) fn of_block(block: &[u8]) -> Self {
        let Some(structure) = Structure::of(block) else { return Self::default() };
        let primary = structure.long_at(4).map(|at| structure.entries(at)).unwrap_or_default();
        let exif = structure.child(&primary, Tag::ExifIFDPointer);
        let interop = structure.child(&exif, Tag::InteropIFDPointer);
        let value = |entries: &[Entry<'_>], tag: Tag| {
            entries.iter().find(|entry| entry.number == tag.number()).map(|entry| structure.value(entry))
        };
        let numbers = |entries: &[Entry<'_>], tag: Tag| match value(entries, tag) {
            Some(Value::Rational(ratios)) => ratios.iter().map(Rational::to_f64).collect(),
            _ => Vec::new(),
        };
        Self {
            space: value(&exif, Tag::ColorSpace).and_then(|value| value.get_uint(0)),
            index: value(&interop, Tag::InteroperabilityIndex).and_then(|value| match value {
                Value::Ascii(mut lines) => lines.pop(),
                _ => None,
            }),
            white: numbers(&primary, Tag::WhitePoint),
            primaries: numbers(&primary, Tag::PrimaryChromaticities),
            gamma: numbers(&exif, Tag::Gamma).first().copied(),
            has_transfer: value(&primary, Tag::TransferFunction).is_some(),
        }
    }

    /// The colour space that they declare.
    pub(super) fn declared(&self) -> Declared {
        let is_optional = self.index.as_ref().is_some_and(|index| index.starts_with(OPTIONAL_SPACE));
        match (self.space, self.white.as_slice(), self.primaries.as_slice()) {
            (Some(1), ..) => Declared::Srgb,
            // 2 is no value of the standard, but what some programs write for Adobe RGB
            (Some(2), ..) => Declared::Space(ADOBE_RGB),
            _ if is_optional => Declared::Space(ADOBE_RGB),
            (None, [], []) => Declared::Srgb,
            (_, white, &[a, b, c, d, e, f]) if !self.has_transfer => {
                let white = white.first_chunk().copied().unwrap_or(D65);
                Declared::of(white, [[a, b], [c, d], [e, f]], self.gamma)
            }
            (None, &[x, y], []) if !self.has_transfer => Declared::of([x, y], SRGB.primaries, self.gamma),
            _ => Declared::Unknown,
        }
    }
}
