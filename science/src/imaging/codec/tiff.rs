//! Reads TIFF and BigTIFF.

use std::io::{self, Cursor, Read, Seek};

use ::tiff::{
    ColorType, TiffError, TiffUnsupportedError,
    decoder::{ChunkType, Decoder, DecodingResult, IfdDecoder, Limits as DecoderLimits},
    tags::{PhotometricInterpretation, SampleFormat, Tag},
};

use super::{
    CaptureTime, Format, Header, ImageFault, Limits, Metadata,
    alpha::{refuse, without_alpha},
    exif_block, orientation,
    tiff_colours::colours,
    tiff_lists, tiff_tiles,
};
use crate::imaging::Raster;

/// Pages after the first that are examined, to recognise a file that holds a whole stack.
const PAGES_LOOKED_AT: usize = 8;

/// Upper bound of the expansion ratio: LZW gives at most 4,096 bytes per code of 12 bits, which is 2,731. A file that
/// declares more is truncated and refused before memory is allocated.
const LARGEST_RATIO: usize = 4_096;

/// Maximum memory of the value of a tag, bytes.
const MAX_TAG_BYTES: usize = 64 << 20;

/// Bits of `NewSubfileType`: a reduced version of another picture in the same file, and its transparency mask.
const REDUCED: u32 = 1;
const MASK: u32 = 4;

/// The older `SubfileType` of a reduced version.
const OLD_REDUCED: u32 = 2;

/// `FillOrder` of reversed bits.
const REVERSED: u32 = 2;

const DNG_VERSION: Tag = Tag::Unknown(0xC612);
const DATE_TIME_ORIGINAL: Tag = Tag::Unknown(0x9003);

fn fault(error: &TiffError) -> ImageFault {
    match error {
        TiffError::IoError(error) => ImageFault::from_io(Format::Tiff, error),
        TiffError::UnsupportedError(what) => ImageFault::unsupported(match unread_colours(what) {
            Some(colours) => format!("the TIFF is {colours}"),
            None => "the TIFF has a feature that is not supported".into(),
        }),
        _ => ImageFault::damaged(Format::Tiff, "its tags or its data are not those of a TIFF"),
    }
}

/// The name of a colour model that the decoder does not open.
fn unread_colours(what: &TiffUnsupportedError) -> Option<&'static str> {
    use TiffUnsupportedError::{InterpretationWithBits, UnsupportedInterpretation};
    let (UnsupportedInterpretation(colours) | InterpretationWithBits(colours, _)) = what else { return None };
    match *colours {
        PhotometricInterpretation::RGBPalette => Some("a palette picture"),
        PhotometricInterpretation::CIELab | PhotometricInterpretation::IccLab | PhotometricInterpretation::ItuLab => {
            Some("Lab")
        }
        PhotometricInterpretation::YCbCr => Some("YCbCr"),
        _ => None,
    }
}

/// The name of a compression (tag 259) that is not supported.
fn unread_compression(number: u16) -> Option<&'static str> {
    match number {
        // none, LZW, deflate, old deflate, PackBits
        1 | 5 | 8 | 32_946 | 32_773 => None,
        2..=4 => Some("a fax code"),
        34_712 => Some("JPEG 2000"),
        34_887 => Some("LERC"),
        34_925 => Some("LZMA"),
        34_926 | 50_000 => Some("ZSTD"),
        34_933 => Some("PNG"),
        34_934 | 50_002 | 52_546 => Some("JPEG XR or XL"),
        50_001 => Some("WebP"),
        _ => Some("an unknown method"),
    }
}

/// Number of stored channels and of those that are kept.
struct Channels {
    stored: usize,
    kept: usize,
    bits: u8,
}

fn channels(color: ColorType) -> Result<Channels, ImageFault> {
    let (stored, kept, bits) = match color {
        ColorType::Gray(bits) => (1, 1, bits),
        ColorType::GrayA(bits) => (2, 1, bits),
        ColorType::RGB(bits) => (3, 3, bits),
        ColorType::RGBA(bits) => (4, 3, bits),
        other => {
            let name = match other {
                ColorType::Palette(_) => "a palette picture",
                ColorType::CMYK(_) | ColorType::CMYKA(_) => "CMYK",
                ColorType::YCbCr(_) => "YCbCr",
                ColorType::Lab(_) => "Lab",
                _ => "of more channels than grey or RGB",
            };
            return Err(ImageFault::unsupported(format!("the TIFF is {name}")));
        }
    };
    if bits != 8 && bits != 16 {
        return Err(ImageFault::unsupported(format!("the TIFF has {bits} bits per sample")));
    }
    Ok(Channels { stored, kept, bits })
}

struct Opened<R: Read + Seek> {
    /// At the page that is the picture.
    decoder: Decoder<R>,
    /// The number of that page, from 0 on.
    page: usize,
    header: Header,
    stored: usize,
}

/// The decoder, at the first picture.
fn first<R: Read + Seek>(mut reader: R) -> Result<Decoder<R>, ImageFault> {
    // the decoder applies limits only after it has read the first directory
    tiff_lists::refuse_long(&mut reader)?;
    let decoder = Decoder::new(reader).map_err(|error| fault(&error))?;
    let mut limits = DecoderLimits::default();
    limits.decoding_buffer_size = MAX_TAG_BYTES;
    Ok(decoder.with_limits(limits))
}

/// A tag with one unsigned number.
fn number<R: Read + Seek>(decoder: &mut Decoder<R>, tag: Tag) -> Option<u32> {
    decoder.find_tag_unsigned(tag).ok().flatten()
}

/// `NewSubfileType` of the page, or what the older tag says in its bits.
fn kind_of_page<R: Read + Seek>(decoder: &mut Decoder<R>) -> u32 {
    let old = number(decoder, Tag::SubfileType).map_or(0, |kind| if kind == OLD_REDUCED { REDUCED } else { 0 });
    number(decoder, Tag::NewSubfileType).unwrap_or(old)
}

/// Goes to the page that is the picture, and returns its number. Thumbnails and masks are passed over. A file with
/// several pictures is refused, because all but one would be ignored. Unreadable pages do not count.
fn go_to_picture<R: Read + Seek>(decoder: &mut Decoder<R>) -> Result<usize, ImageFault> {
    let mut kinds = vec![kind_of_page(decoder)];
    while kinds.len() <= PAGES_LOOKED_AT && decoder.more_images() && decoder.next_image().is_ok() {
        kinds.push(kind_of_page(decoder));
    }
    let mut pictures = (0..kinds.len()).filter(|&page| kinds[page] & (REDUCED | MASK) == 0);
    let page = match (pictures.next(), pictures.next()) {
        (Some(page), None) => page,
        // reduced, but from a picture that is not here
        (None, _) if kinds == [REDUCED] => 0,
        (None, _) => {
            return Err(ImageFault::Unsupported {
                what: "the TIFF holds a mask or thumbnails and no picture".into(),
                advice: "save the picture itself, as the only page",
            });
        }
        (Some(_), Some(_)) => {
            return Err(ImageFault::Unsupported {
                what: "the TIFF holds several pages".into(),
                advice: "save each slice as a separate file",
            });
        }
    };
    decoder.seek_to_image(page).map_err(|error| fault(&error))?;
    Ok(page)
}

fn open<R: Read + Seek>(reader: R, limits: &Limits) -> Result<Opened<R>, ImageFault> {
    let mut decoder = first(reader)?;
    let reduced = kind_of_page(&mut decoder) & REDUCED != 0;
    let has = |decoder: &mut Decoder<R>, tag| decoder.image_ifd().directory().contains(tag);
    // the first picture of a raw file is a thumbnail; the picture is in a sub-directory
    if has(&mut decoder, DNG_VERSION) || (reduced && has(&mut decoder, Tag::SubIfd)) {
        return Err(ImageFault::Raw("DNG, NEF, ARW or alike"));
    }
    let page = go_to_picture(&mut decoder)?;
    let stored = refuse_coding(&mut decoder)?;
    let (mut width, mut height) = decoder.dimensions().map_err(|error| fault(&error))?;
    limits.check(width, height)?;
    let orientation = number(&mut decoder, Tag::Orientation).map_or(1, orientation::sane);
    if orientation::swaps(orientation) {
        (width, height) = (height, width);
    }
    let channels = stored.kept as u8;
    let header = Header {
        width,
        height,
        channels,
        bit_depth: stored.bits,
        format: Format::Tiff,
        orientation,
        colour: colours(&mut decoder, channels).1,
        taken: taken(&mut decoder),
    };
    Ok(Opened { decoder, page, header, stored: stored.stored })
}

/// Refuses codings that the decoder does not reproduce, and returns the channels.
fn refuse_coding<R: Read + Seek>(decoder: &mut Decoder<R>) -> Result<Channels, ImageFault> {
    // the decoder does not report truncated JPEG data
    let compression = decoder.find_tag_unsigned::<u16>(Tag::Compression).ok().flatten().unwrap_or(1);
    if matches!(compression, 6 | 7) {
        return Err(ImageFault::unsupported("the TIFF is compressed with JPEG"));
    }
    if let Some(name) = unread_compression(compression) {
        return Err(ImageFault::Unsupported {
            what: format!("the TIFF is compressed with {name}, which is not supported"),
            advice: "save all slices without compression, or with LZW or ZIP (deflate)",
        });
    }
    // an assertion of the decoder fails on these
    let planes = decoder.find_tag_unsigned::<u16>(Tag::PlanarConfiguration).ok().flatten().unwrap_or(1);
    if planes == 2 && decoder.get_chunk_type() == ChunkType::Tile {
        return Err(ImageFault::unsupported("the TIFF stores its colours in separate tiles"));
    }
    // libtiff reverses the bits of each byte of such files, whatever their depth
    if number(decoder, Tag::FillOrder) == Some(REVERSED) {
        return Err(ImageFault::Unsupported {
            what: "the TIFF stores the bits of each byte in reversed order (FillOrder 2)".into(),
            advice: "save all slices again in the usual order (FillOrder 1)",
        });
    }
    let channels = channels(decoder.colortype().map_err(|error| fault(&error))?)?;
    let format = decoder.find_tag_unsigned_vec::<u16>(Tag::SampleFormat).ok().flatten().unwrap_or_default();
    if format.iter().any(|&format| format != SampleFormat::Uint.to_u16()) {
        return Err(ImageFault::unsupported("the TIFF has floating point or signed samples"));
    }
    Ok(channels)
}

/// When the picture was taken: by the EXIF directory or, without one, by `DateTime`. A defect of these tags is no
/// defect of the picture.
fn taken<R: Read + Seek>(decoder: &mut Decoder<R>) -> Option<CaptureTime> {
    // a hostile list would take much memory as a value
    let value = |mut directory: IfdDecoder<'_>, tag| {
        directory.find_entry(tag).filter(|entry| entry.count() <= 32)?;
        directory.find_tag(tag).ok()?
    };
    let found = match value(decoder.image_ifd(), Tag::ExifDirectory) {
        Some(pointer) => {
            let exif = decoder.read_directory(pointer.into_ifd_pointer().ok()?).ok()?;
            value(decoder.read_directory_tags(&exif), DATE_TIME_ORIGINAL)
        }
        None => value(decoder.image_ifd(), Tag::DateTime),
    };
    exif_block::capture_time(&found?.into_string().ok()?)
}

pub(super) fn probe(reader: impl Read + Seek, limits: &Limits) -> Result<Header, ImageFault> {
    Ok(open(reader, limits)?.header)
}

pub(super) fn metadata(bytes: &[u8]) -> Metadata {
    // a file that is not decoded has no metadata either
    let Ok(mut opened) = open(Cursor::new(bytes), &Limits::default()) else { return Metadata::default() };
    let icc = colours(&mut opened.decoder, opened.header.channels).0;
    Metadata { icc, exif: exif_block::from_tiff(bytes, opened.page) }
}

/// The picture as stored, and its orientation, of a file of `length` bytes.
pub(super) fn decode(reader: impl Read + Seek, length: u64, limits: &Limits) -> Result<(Raster, u8), ImageFault> {
    let Opened { decoder, header, stored, .. } = open(reader, limits)?;

    let declared = header.width as usize * header.height as usize * stored * usize::from(header.bit_depth / 8);
    if (declared / LARGEST_RATIO) as u64 > length {
        return Err(ImageFault::Truncated(Format::Tiff));
    }
    // one row of tiles may extend beyond the picture; no valid file needs more than this
    let largest = (header.width as usize + 4096) * (header.height as usize + 4096) * stored * 2;
    let mut allowed = DecoderLimits::default();
    allowed.decoding_buffer_size = limits.max_bytes();
    allowed.intermediate_buffer_size = largest.min(limits.max_bytes());
    let mut decoder = decoder.with_limits(allowed.clone());

    let mut result = DecodingResult::U8(Vec::new());
    let planes = if tiff_tiles::extend_beyond(&mut decoder) {
        tiff_tiles::read(&mut decoder, &allowed).map(|read| {
            result = read;
            1
        })
    } else {
        decoder.read_image_to_buffer(&mut result).map(|layout| layout.planes)
    };
    let planes = planes.map_err(|error| match error {
        // of the decompression: an error of the disk is told by the container, whatever is told here
        TiffError::IoError(error) if error.kind() != io::ErrorKind::UnexpectedEof => {
            ImageFault::damaged(Format::Tiff, "its compressed data are not valid")
        }
        other => fault(&other),
    })?;

    let (width, height) = decoder.dimensions().map_err(|error| fault(&error))?;
    let (width, height) = (width as usize, height as usize);
    let kept = usize::from(header.channels);
    let samples = width * height * stored;
    let raster = match result {
        DecodingResult::U8(data) if data.len() == samples => {
            Raster::eight(width, height, kept, arranged(data, planes, stored, kept, u8::MAX)?)
        }
        DecodingResult::U16(data) if data.len() == samples => {
            Raster::sixteen(width, height, kept, arranged(data, planes, stored, kept, u16::MAX)?)
        }
        _ => return Err(ImageFault::damaged(Format::Tiff, "its size or depth differs from the declared one")),
    };
    Ok((raster, header.orientation))
}

/// Interleaved samples without alpha, from samples that are interleaved or in planes.
fn arranged<T: Copy + PartialEq>(
    samples: Vec<T>,
    planes: usize,
    stored: usize,
    kept: usize,
    opaque: T,
) -> Result<Vec<T>, ImageFault> {
    if planes <= 1 {
        return without_alpha(samples, stored, kept, opaque);
    }
    let pixels = samples.len() / stored;
    refuse(samples[kept * pixels..].iter().filter(|&&alpha| alpha != opaque).count(), pixels)?;
    let mut out = Vec::with_capacity(pixels * kept);
    for pixel in 0..pixels {
        out.extend((0..kept).map(|channel| samples[channel * pixels + pixel]));
    }
    Ok(out)
}
