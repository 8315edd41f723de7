//! Reads and writes small ICC profiles: matrix and curves for RGB, one curve for grey (ICC.1:2001-04, version 2.4,
//! which all programs read).

use super::rgb_space::{ADOBE_RGB, Curve, D50, Rgb, SRGB};

/// Size of the header of a profile.
pub(super) const HEADER_BYTES: usize = 128;

/// Tags of the curves.
pub(super) const RGB_CURVES: [[u8; 4]; 3] = [*b"rTRC", *b"gTRC", *b"bTRC"];
pub(super) const GREY_CURVE: [u8; 4] = *b"kTRC";

const COLOURANTS: [[u8; 4]; 3] = [*b"rXYZ", *b"gXYZ", *b"bXYZ"];

/// Number of values of a curve that is no power.
const CURVE_VALUES: u16 = 1_024;

fn number(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..)?.first_chunk().map(|four| u32::from_be_bytes(*four))
}

/// A number of type `s15Fixed16`.
fn fixed(bytes: &[u8], at: usize) -> Option<f64> {
    number(bytes, at).map(|number| f64::from(number.cast_signed()) / 65_536.0)
}

/// The data of a tag.
fn tag(icc: &[u8], name: [u8; 4]) -> Option<&[u8]> {
    let count = number(icc, HEADER_BYTES)? as usize;
    let table = icc.get(HEADER_BYTES + 4..)?.chunks_exact(12).take(count);
    let entry = table.into_iter().find(|entry| entry.starts_with(&name))?;
    let (at, length) = (number(entry, 4)? as usize, number(entry, 8)? as usize);
    icc.get(at..at.checked_add(length)?)
}

/// XYZ of red, green and blue; `None` for a profile of tables, whose colourants do not tell its colours.
pub(super) fn colourants(icc: &[u8]) -> Option<[[f64; 3]; 3]> {
    let mut out = [[0.0; 3]; 3];
    for (of, name) in out.iter_mut().zip(COLOURANTS) {
        let data = tag(icc, name)?;
        *of = [fixed(data, 8)?, fixed(data, 12)?, fixed(data, 16)?];
    }
    tag(icc, *b"A2B0").is_none().then_some(out)
}

/// The light of the sample `value` by the curve `name`.
pub(super) fn curve_at(icc: &[u8], name: [u8; 4], value: f64) -> Option<f64> {
    let data = tag(icc, name)?;
    let short = |at: usize| data.get(at..)?.first_chunk().map(|two| f64::from(u16::from_be_bytes(*two)));
    match data.get(..4)? {
        b"curv" => Some(match number(data, 8)? as usize {
            0 => value,
            1 => value.powf(short(12)? / 256.0),
            count => short(12 + 2 * (value * (count - 1) as f64).round() as usize)? / 65_535.0,
        }),
        b"para" => {
            let parameter = |i: usize| fixed(data, 12 + 4 * i);
            let power = parameter(0)?;
            match short(8)? as u16 {
                0 => Some(value.powf(power)),
                // both have a line below a threshold, and the second adds a constant to each part
                kind @ (3 | 4) => {
                    let (above, below) = if kind == 4 { (parameter(5)?, parameter(6)?) } else { (0.0, 0.0) };
                    let is_above = value >= parameter(4)?;
                    let light = (parameter(1)? * value + parameter(2)?).powf(power) + above;
                    Some(if is_above { light } else { parameter(3)? * value + below })
                }
                _ => None,
            }
        }
        _ => None,
    }
}

/// A profile of an RGB space; `None` for impossible chromaticities.
pub(super) fn of_rgb(space: &Rgb) -> Option<Vec<u8>> {
    let values: Vec<u16> = match space.curve {
        Curve::Gamma(gamma) => vec![(gamma * 256.0).round() as u16],
        Curve::Srgb => {
            let light = |i: u16| space.curve.at(f64::from(i) / f64::from(CURVE_VALUES - 1));
            (0..CURVE_VALUES).map(|i| (light(i) * 65_535.0).round() as u16).collect()
        }
    };
    let mut curve = [&b"curv\0\0\0\0"[..], &(values.len() as u32).to_be_bytes()].concat();
    curve.extend(values.iter().flat_map(|value| value.to_be_bytes()));
    written(space, &curve)
}

/// A profile for RGB whose equal samples have the light that the profile `grey` gives them; `None` for a profile that
/// is not for grey, or has no curve.
pub(super) fn rgb_of_grey(grey: &[u8]) -> Option<Vec<u8>> {
    let is_grey = grey.get(16..24) == Some(b"GRAYXYZ ");
    written(&SRGB, tag(grey, GREY_CURVE).filter(|_| is_grey)?)
}

/// A profile of these colourants and this curve.
fn written(space: &Rgb, curve: &[u8]) -> Option<Vec<u8>> {
    let fixed = |numbers: [f64; 3]| numbers.map(|v| ((v * 65_536.0).round() as i32).to_be_bytes()).concat();
    let xyz = |numbers: [f64; 3]| [b"XYZ \0\0\0\0".to_vec(), fixed(numbers)].concat();
    let name = if *space == ADOBE_RGB { "compatible with Adobe RGB (1998)" } else { "as declared" };
    let mut description = [&b"desc\0\0\0\0"[..], &(name.len() as u32 + 1).to_be_bytes(), name.as_bytes()].concat();
    // the end of the text; no Unicode and no Macintosh version
    description.extend([0; 1 + 8 + 3 + 67]);
    let [red, green, blue] = space.colourants()?.map(xyz);
    let tags: [(&[[u8; 4]], Vec<u8>); 7] = [
        (&[*b"desc"], description),
        (&[*b"cprt"], b"text\0\0\0\0no copyright\0".to_vec()),
        (&[*b"wtpt"], xyz(D50)),
        (&COLOURANTS[..1], red),
        (&COLOURANTS[1..2], green),
        (&COLOURANTS[2..], blue),
        (&RGB_CURVES, curve.to_vec()),
    ];
    let count = tags.iter().map(|(names, _)| names.len()).sum::<usize>();
    let mut table = (count as u32).to_be_bytes().to_vec();
    let (start, mut body) = (HEADER_BYTES + 4 + 12 * count, Vec::new());
    for (names, mut data) in tags {
        for name in names {
            let place = [(start + body.len()) as u32, data.len() as u32].map(u32::to_be_bytes).concat();
            table.extend([name.to_vec(), place].concat());
        }
        data.resize(data.len().next_multiple_of(4), 0);
        body.extend(data);
    }
    let mut out = ((start + body.len()) as u32).to_be_bytes().to_vec();
    // no preferred program, version 2.4, for a display; the date is that of no day: equal inputs give equal bytes
    out.extend(b"\0\0\0\0\x02\x40\0\0mntrRGB XYZ \x07\xD0\0\x01\0\x01\0\0\0\0\0\0acsp");
    out.resize(68, 0);
    out.extend(fixed(D50));
    out.resize(HEADER_BYTES, 0);
    out.extend(table);
    out.extend(body);
    Some(out)
}
