//! The EXIF block of an output picture.
//!
//! In: the block of the reference slice (or none), the size of the output, and the camera data of the profile. Out: a
//! block from which photogrammetry programs compute the correct focal length in px.
//!
//! Programs differ in the tags that they prefer, so the rules are:
//!
//! | the profile knows | `FocalLength` | `FocalLengthIn35mmFilm` | focal plane resolution | `Model` |
//! |---|---|---|---|---|
//! | principal distance and pixel pitch | principal distance | none | of the output's pixels | moved to `UniqueCameraModel` |
//! | principal distance | principal distance | none | as the camera wrote it | kept |
//! | pixel pitch | none | none | of the output's pixels | kept |
//! | neither | none | none | as the camera wrote it | kept |
//!
//! - The focal length engraved on a macro lens is not its principal distance (see [`crate::types::lens`]). Programs
//!   trust the tag, so a wrong one is worse than none.
//! - `FocalLengthIn35mmFilm` is an integer, which alone is an error of up to 0.5 %, and its definition differs: COLMAP
//!   3.8 takes `tag / 35 * longer side`, COLMAP 4 and AliceVision `tag / 43.27 * diagonal`. No value is right in both.
//! - COLMAP 3.8 looks up the sensor's width by `Make` and `Model` before it reads the focal plane resolution. The width
//!   of a catalogue is wrong for a crop and for slices of reduced size.

use exif::{Field, In, Rational, Tag, Value};

use super::{
    exif_block::{kept, orientation, text, written},
    orientation,
};

/// Camera data of an output, and the program that wrote it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct OutputCamera<'a> {
    /// Principal distance, mm.
    pub principal_distance_mm: Option<f64>,
    /// Size of one pixel of the picture on the sensor, mm.
    pub pixel_pitch_mm: Option<f64>,
    /// Program and version for the tag `Software`. If empty, the tag is kept.
    pub software: &'a str,
}

const FOCAL_PLANE_X: Tag = Tag::FocalPlaneXResolution;
const FOCAL_PLANE_Y: Tag = Tag::FocalPlaneYResolution;

/// The tag for the camera model that no program looks up in a sensor database.
const UNIQUE_CAMERA_MODEL: Tag = Tag(exif::Context::Tiff, 0xC614);

/// `FocalPlaneResolutionUnit` and its length in mm. COLMAP 3.8 supports only inch and centimetre.
const INCH: u16 = 2;
const MM_PER_INCH: f64 = 25.4;

/// Step to which COLMAP 3.8 rounds `FocalLength`, mm.
const READ_TO_MM: f64 = 0.1;
/// Above this relative rounding error the rounded length is written, and the focal plane resolution is scaled alike.
const TOLERATED: f64 = 2e-4;

/// The block of an upright output of `width` x `height` px, made from the picture that `block` describes, if any.
pub(super) fn for_output(block: Option<&[u8]>, width: u32, height: u32, camera: &OutputCamera<'_>) -> Option<Vec<u8>> {
    let (mut fields, little_endian) = block.and_then(kept).unwrap_or((Vec::new(), true));
    if block.and_then(orientation).is_some_and(orientation::swaps) {
        turn(&mut fields);
    }
    let model = block.and_then(|block| text(block, Tag::Model));
    let mut new = vec![
        (Tag::Orientation, Value::Short(vec![1])),
        (Tag::PixelXDimension, Value::Long(vec![width])),
        (Tag::PixelYDimension, Value::Long(vec![height])),
    ];
    if !camera.software.is_empty() {
        new.push((Tag::Software, ascii(camera.software)));
    }
    if !fields.iter().any(|field| field.tag == Tag::ExifVersion) {
        new.push((Tag::ExifVersion, Value::Undefined(b"0232".to_vec(), 0)));
    }
    let mut dropped = vec![Tag::FocalLength, Tag::FocalLengthIn35mmFilm];
    let (distance, pitch) = written_optics(camera);
    if let Some(distance) = distance {
        new.push((Tag::FocalLength, ratio(distance)));
    }
    if let Some(pitch) = pitch {
        new.push((FOCAL_PLANE_X, ratio(MM_PER_INCH / pitch)));
        new.push((FOCAL_PLANE_Y, ratio(MM_PER_INCH / pitch)));
        new.push((Tag::FocalPlaneResolutionUnit, Value::Short(vec![INCH])));
    }
    if distance.is_some() && pitch.is_some() {
        dropped.push(Tag::Model);
        let named = fields.iter().any(|field| field.tag == UNIQUE_CAMERA_MODEL);
        if let Some(model) = model.filter(|model| !named && !model.is_empty()) {
            new.push((UNIQUE_CAMERA_MODEL, ascii(&model)));
        }
    }
    fields.retain(|field| !dropped.contains(&field.tag) && new.iter().all(|(tag, _)| *tag != field.tag));
    fields.extend(new.into_iter().map(|(tag, value)| Field { tag, ifd_num: In::PRIMARY, value }));
    written(&fields, little_endian)
}

/// Exchanges the resolutions along x and y of a picture that was rotated by 90 degrees.
fn turn(fields: &mut [Field]) {
    for field in fields {
        field.tag = match field.tag {
            FOCAL_PLANE_X => FOCAL_PLANE_Y,
            FOCAL_PLANE_Y => FOCAL_PLANE_X,
            Tag::XResolution => Tag::YResolution,
            Tag::YResolution => Tag::XResolution,
            other => other,
        };
    }
}

/// Principal distance and pixel pitch as written, mm. Their quotient is exact. A distance so short that a tenth of a
/// millimetre matters is rounded to a tenth, and the pitch is scaled by the same factor.
fn written_optics(camera: &OutputCamera<'_>) -> (Option<f64>, Option<f64>) {
    let (Some(distance), Some(pitch)) = (camera.principal_distance_mm, camera.pixel_pitch_mm) else {
        return (camera.principal_distance_mm, camera.pixel_pitch_mm);
    };
    let rounded = (distance / READ_TO_MM).round().max(1.0) * READ_TO_MM;
    if (rounded / distance - 1.0).abs() <= TOLERATED {
        return (Some(distance), Some(pitch));
    }
    (Some(rounded), Some(pitch * rounded / distance))
}

/// A positive number as a rational whose parts fit signed 32 bits, because some readers interpret them as signed.
fn ratio(number: f64) -> Value {
    let largest = f64::from(i32::MAX);
    let denominator = (largest / number).floor().clamp(1.0, 1e6);
    let numerator = (number * denominator).round().clamp(1.0, largest);
    Value::Rational(vec![Rational { num: numerator as u32, denom: denominator as u32 }])
}

fn ascii(text: &str) -> Value {
    Value::Ascii(vec![text.as_bytes().to_vec()])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn number(value: &Value) -> f64 {
        match value {
            Value::Rational(ratios) => ratios[0].to_f64(),
            _ => panic!("a rational"),
        }
    }

    #[test]
    fn rationals_keep_the_digits_of_any_size() {
        for wanted in [0.1, 3.04, 121.37, 6_134.215, 99_999.9, 2.54e6] {
            let error = number(&ratio(wanted)) / wanted - 1.0;
            assert!(error.abs() < 1e-5, "{wanted}: {error}");
        }
    }

    #[test]
    fn a_short_distance_is_written_to_a_tenth_and_the_quotient_stays() {
        for distance in [0.13, 3.04, 12.345, 45.06, 121.37, 180.8] {
            let camera =
                OutputCamera { principal_distance_mm: Some(distance), pixel_pitch_mm: Some(0.00414), software: "" };
            let (Some(written), Some(pitch)) = written_optics(&camera) else { panic!("both are known") };
            assert!((written / pitch * 0.00414 / distance - 1.0).abs() < 1e-12, "{distance}");
            let read = (written * 10.0).round() / 10.0;
            assert!((read / written - 1.0).abs() < 5e-4, "{distance} is read as {read}");
        }
    }
}
