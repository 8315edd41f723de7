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
//! - COLMAP 3.8 reads the distance to a tenth of a millimetre. In TIFF it reads fractions wrongly: it gets a float, and
//!   makes a fraction of it again by a continued fraction that is put together in the wrong way (121.5 becomes 123). It
//!   reads whole numbers correctly, so both are whole, and one makes up for the rounding of the other.
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

/// Largest relative change of the distance, which the focal plane resolution makes up for.
const SCALED_BY: f64 = 0.05;
/// Relative error of their product that is not worth a larger change.
const TOLERATED: f64 = 5e-5;

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
    let (distance, resolution) = written_optics(camera);
    if let Some(distance) = distance {
        new.push((Tag::FocalLength, ratio(distance)));
    }
    if let Some(resolution) = resolution {
        new.push((FOCAL_PLANE_X, ratio(resolution)));
        new.push((FOCAL_PLANE_Y, ratio(resolution)));
        new.push((Tag::FocalPlaneResolutionUnit, Value::Short(vec![INCH])));
    }
    if distance.is_some() && resolution.is_some() {
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

/// Principal distance, mm, and focal plane resolution, pixels per inch, as written. If both are known, both are whole
/// numbers, and their product is the exact one to within [`TOLERATED`] where the resolution is fine enough: of the
/// distances near the true one that give such a product, the nearest is written.
fn written_optics(camera: &OutputCamera<'_>) -> (Option<f64>, Option<f64>) {
    let resolution = camera.pixel_pitch_mm.map(|pitch| MM_PER_INCH / pitch);
    let (Some(distance), Some(resolution)) = (camera.principal_distance_mm, resolution) else {
        return (camera.principal_distance_mm, resolution);
    };
    let product = distance * resolution;
    let [least, most] = [1.0 - SCALED_BY, 1.0 + SCALED_BY].map(|factor| (distance * factor).round().max(1.0));
    let resolution_for = |whole: f64| (product / whole).round().max(1.0);
    let error = |whole: f64| (whole * resolution_for(whole) / product - 1.0).abs().max(TOLERATED);
    let whole = (least as u32..=most as u32)
        .map(f64::from)
        .min_by(|&a, &b| error(a).total_cmp(&error(b)).then((a - distance).abs().total_cmp(&(b - distance).abs())));
    (whole, whole.map(resolution_for))
}

/// A positive number as a rational whose parts fit signed 32 bits, because some readers interpret them as signed.
fn ratio(number: f64) -> Value {
    let largest = f64::from(i32::MAX);
    let finest = if number.fract() == 0.0 { 1.0 } else { 1e6 };
    let denominator = (largest / number).floor().clamp(1.0, finest);
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

    /// A number of a TIFF as COLMAP 3.8 reads it: FreeImage gets the rational as a float from libtiff and makes a
    /// fraction of it (`FIRational::FIRational(float)`).
    fn read_by_colmap(value: &Value) -> f64 {
        let float = number(value) as f32;
        if float == float.trunc() {
            return f64::from(float);
        }
        let (mut terms, mut rest) = (Vec::new(), float);
        while terms.len() < 4 {
            let whole = rest.floor();
            terms.push(f64::from(whole));
            rest -= whole;
            if rest == 0.0 {
                break;
            }
            rest = 1.0 / rest;
        }
        // the last term is the denominator, where it has to be the numerator
        let (mut numerator, mut denominator) = (1.0, terms.pop().unwrap());
        for term in terms.into_iter().rev().take_while(|&term| term != 0.0) {
            (numerator, denominator) = (term * numerator + denominator, numerator);
        }
        numerator / denominator
    }

    #[test]
    fn the_reader_of_this_test_has_the_faults_of_colmap() {
        // as measured with COLMAP 3.8
        for (written, read) in [(121.5, 123.0), (121.0, 121.0), (846.667, 847.0)] {
            assert!((read_by_colmap(&ratio(written)) - read).abs() < 0.01, "{written}");
        }
    }

    #[test]
    fn colmap_reads_the_focal_length_of_a_tiff_for_any_distance_and_pitch() {
        let tenths = (30..3_000).map(|tenth| f64::from(tenth) / 10.0);
        let odd = (1..400).map(|i| 3.0 + f64::from(i) * 2.347_3);
        let mut worst: f64 = 0.0;
        for distance in tenths.chain(odd).chain([0.13, 1_234.5]) {
            for pitch in [0.0005, 0.0015, 0.0024, 0.003_76, 0.004_14, 0.0061, 0.006_25, 0.0069, 0.01, 0.017_3, 0.03] {
                let camera =
                    OutputCamera { principal_distance_mm: Some(distance), pixel_pitch_mm: Some(pitch), software: "" };
                let (Some(written), Some(resolution)) = written_optics(&camera) else { panic!("both are known") };
                let near = SCALED_BY * distance + 0.5;
                assert!((written - distance).abs() <= near || written == 1.0, "{distance} is written as {written}");
                // FocalLength is printed with one decimal
                let focal = (read_by_colmap(&ratio(written)) * 10.0).round() / 10.0;
                let read = focal * read_by_colmap(&ratio(resolution)) / MM_PER_INCH;
                worst = worst.max((read / (distance / pitch) - 1.0).abs());
            }
        }
        assert!(worst < 1e-3, "off by {worst}");
    }
}
