//! Reads PNG.

use std::io::{BufRead, Cursor, Seek};

use ::png::{BitDepth, ColorType, Decoder, DecodingError, Info, OutputInfo, Reader, ScaledFloat, Transformations};

use super::{
    ColourSpace, Format, Header, ImageFault, Limits, Metadata,
    alpha::without_alpha,
    colour_space::resolved,
    colour_tags::ColourTags,
    exif_block, orientation,
    rgb_space::{Curve, D65, Declared, Rgb, SRGB},
};
use crate::imaging::{Raster, simd};

/// Maximum memory of the decoder besides the pixels, bytes: compressed profiles can be bombs.
const MAX_CHUNK_BYTES: usize = 32 << 20;

/// Maximum expansion ratio of deflate. A file that declares more is truncated and refused before memory is allocated.
const LARGEST_RATIO: usize = 1_100;

fn open<R: BufRead + Seek>(reader: R, limits: &Limits) -> Result<Reader<R>, ImageFault> {
    let mut decoder = Decoder::new_with_limits(reader, ::png::Limits { bytes: MAX_CHUNK_BYTES });
    // palettes and 1, 2 and 4 bits become 8 bits; 16 bits stay
    decoder.set_transformations(Transformations::EXPAND);
    let first = decoder.read_header_info().map_err(|error| fault(&error))?;
    limits.check(first.width, first.height)?;
    decoder.read_info().map_err(|error| fault(&error))
}

fn fault(error: &DecodingError) -> ImageFault {
    match error {
        DecodingError::IoError(error) => ImageFault::from_io(Format::Png, error),
        // the only way to tell this kind from the others
        other if other.to_string().starts_with("CRC error") => ImageFault::damaged(Format::Png, "a checksum is wrong"),
        _ => ImageFault::damaged(Format::Png, "its data are not those of a PNG"),
    }
}

fn header(info: &Info<'_>, limits: &Limits) -> Result<Header, ImageFault> {
    let channels = channels_of(info);
    let bit_depth = if info.bit_depth == BitDepth::Sixteen { 16 } else { 8 };
    let orientation = info.exif_metadata.as_deref().and_then(exif_block::orientation).unwrap_or(1);
    let taken = info.exif_metadata.as_deref().and_then(exif_block::taken);
    let (mut width, mut height) = (info.width, info.height);
    if orientation::swaps(orientation) {
        (width, height) = (height, width);
    }
    limits.check(width, height)?;
    let colour = colours(info).1;
    Ok(Header { width, height, channels, bit_depth, format: Format::Png, orientation, colour, taken })
}

fn channels_of(info: &Info<'_>) -> u8 {
    match info.color_type {
        ColorType::Grayscale | ColorType::GrayscaleAlpha => 1,
        ColorType::Rgb | ColorType::Rgba | ColorType::Indexed => 3,
    }
}

/// The ICC profile for outputs, and the colour space. Of several marks the first of these holds: cICP, iCCP, sRGB, gAMA
/// and cHRM (PNG, third edition, 4.3), EXIF. A cICP that is not known here leaves it to iCCP.
fn colours(info: &Info<'_>) -> (Option<Vec<u8>>, ColourSpace) {
    let coded = info.coding_independent_code_points.map(|cicp| {
        let is_full_rgb = cicp.matrix_coefficients == 0 && cicp.is_video_full_range_image;
        declared_by_code(cicp.color_primaries, cicp.transfer_function).filter(|_| is_full_rgb)
    });
    let exif = || info.exif_metadata.as_deref().map(ColourTags::of_block).unwrap_or_default().declared();
    let number = |scaled: ScaledFloat| f64::from(scaled.into_scaled()) / 100_000.0;
    let gamma = info.gama_chunk.map(|of| 1.0 / number(of));
    let other = match (coded, info.srgb, info.chrm_chunk) {
        (Some(coded), ..) => coded.unwrap_or(Declared::Unknown),
        (None, Some(_), _) => Declared::Srgb,
        (None, None, Some(of)) => {
            let [white, red, green, blue] = [of.white, of.red, of.green, of.blue].map(|(x, y)| [number(x), number(y)]);
            Declared::of(white, [red, green, blue], gamma)
        }
        (None, None, None) if gamma.is_some() => Declared::of(D65, SRGB.primaries, gamma),
        (None, None, None) => exif(),
    };
    let icc = info.icc_profile.as_ref().filter(|_| !matches!(coded, Some(Some(_)))).map(|icc| icc.to_vec());
    resolved(icc, other, channels_of(info))
}

/// The space of a pair of codes of ITU-T H.273: primaries of sRGB, BT.2020 or P3, and the curve of sRGB or a power.
fn declared_by_code(primaries: u8, transfer: u8) -> Option<Declared> {
    let primaries = match primaries {
        1 => SRGB.primaries,
        9 => [[0.708, 0.292], [0.170, 0.797], [0.131, 0.046]],
        12 => [[0.680, 0.320], [0.265, 0.690], [0.150, 0.060]],
        _ => return None,
    };
    let curve = match transfer {
        4 => Curve::Gamma(2.2),
        5 => Curve::Gamma(2.8),
        8 => Curve::Gamma(1.0),
        13 => Curve::Srgb,
        _ => return None,
    };
    Some(Declared::Space(Rgb { primaries, curve, ..SRGB }))
}

pub(super) fn probe(reader: impl BufRead + Seek, limits: &Limits) -> Result<Header, ImageFault> {
    let reader = open(reader, limits)?;
    header(reader.info(), limits)
}

pub(super) fn metadata(bytes: &[u8]) -> Metadata {
    let Ok(reader) = open(Cursor::new(bytes), &Limits::default()) else { return Metadata::default() };
    let info = reader.info();
    Metadata { icc: colours(info).0, exif: info.exif_metadata.as_ref().map(|exif| exif.to_vec()) }
}

/// The picture as stored, and its orientation, of a file of `length` bytes.
pub(super) fn decode(reader: impl BufRead + Seek, length: u64, limits: &Limits) -> Result<(Raster, u8), ImageFault> {
    let mut reader = open(reader, limits)?;
    let orientation = header(reader.info(), limits)?.orientation;
    let size = reader.output_buffer_size().ok_or_else(|| ImageFault::damaged(Format::Png, "its size overflows"))?;
    if (size / LARGEST_RATIO) as u64 > length {
        return Err(ImageFault::Truncated(Format::Png));
    }
    let raster = if reader.output_color_type().1 == BitDepth::Sixteen {
        // decoded into its final memory: the memory budget of a job has no space for a second copy of 16 bits
        let mut samples = vec![0u16; size.div_ceil(2)];
        let frame = read(&mut reader, simd::bytes_of_mut(&mut samples))?;
        samples.truncate(frame.buffer_size() / 2);
        samples.iter_mut().for_each(|sample| *sample = u16::from_be(*sample));
        let (stored, kept) = channels(&frame)?;
        Raster::sixteen(
            frame.width as usize,
            frame.height as usize,
            kept,
            without_alpha(samples, stored, kept, u16::MAX)?,
        )
    } else {
        let mut samples = vec![0; size];
        let frame = read(&mut reader, &mut samples)?;
        samples.truncate(frame.buffer_size());
        let (stored, kept) = channels(&frame)?;
        Raster::eight(frame.width as usize, frame.height as usize, kept, without_alpha(samples, stored, kept, u8::MAX)?)
    };
    // EXIF may follow the pixels, where the header that sizes were compared by does not show it
    if header(reader.info(), limits)?.orientation != orientation {
        return Err(ImageFault::Unsupported {
            what: "the PNG has its orientation tag behind the pixels".into(),
            advice: "turn the picture upright and save it again, or remove the tag",
        });
    }
    Ok((raster, orientation))
}

/// Reads the pixels, and the rest of the file for its checksums.
fn read<R: BufRead + Seek>(reader: &mut Reader<R>, bytes: &mut [u8]) -> Result<OutputInfo, ImageFault> {
    let frame = reader.next_frame(bytes).map_err(|error| fault(&error))?;
    reader.finish().map_err(|error| fault(&error))?;
    Ok(frame)
}

/// The number of stored channels, and of those that are kept.
fn channels(frame: &OutputInfo) -> Result<(usize, usize), ImageFault> {
    match frame.color_type {
        ColorType::Grayscale => Ok((1, 1)),
        ColorType::GrayscaleAlpha => Ok((2, 1)),
        ColorType::Rgb => Ok((3, 3)),
        ColorType::Rgba => Ok((4, 3)),
        ColorType::Indexed => Err(ImageFault::damaged(Format::Png, "its palette cannot be expanded")),
    }
}
