//! Reads TIFF and BigTIFF.

use std::io::{Cursor, Read, Seek};

use ::tiff::{
    ColorType, TiffError,
    decoder::{ChunkType, Decoder, DecodingResult, IfdDecoder, Limits as DecoderLimits},
    tags::{SampleFormat, Tag, Type, ValueBuffer},
};

use super::{
    CaptureTime, Format, Header, ImageFault, Limits, Metadata, exif_block, orientation, png::first_channels, tiff_lists,
};
use crate::imaging::Raster;

/// Pages after the first that are examined, to recognise a file that holds a whole stack.
const PAGES_LOOKED_AT: usize = 8;

/// Upper bound of the expansion ratio: LZW gives at most 4,096 bytes per code of 12 bits, which is 2,731. A file that
/// declares more is truncated and refused before memory is allocated.
const LARGEST_RATIO: usize = 4_096;

/// Maximum memory of the value of a tag, bytes.
const MAX_TAG_BYTES: usize = 64 << 20;

/// Marks a reduced version of another picture in the same file (`NewSubfileType`, bit 0).
const REDUCED: u32 = 1;

const DNG_VERSION: Tag = Tag::Unknown(0xC612);
const DATE_TIME_ORIGINAL: Tag = Tag::Unknown(0x9003);

fn fault(error: &TiffError) -> ImageFault {
    match error {
        TiffError::IoError(error) => ImageFault::from_io(Format::Tiff, error),
        TiffError::UnsupportedError(what) => {
            ImageFault::unsupported(format!("the TIFF has a feature that is not supported ({what})"))
        }
        other => ImageFault::damaged(Format::Tiff, other),
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
    decoder: Decoder<R>,
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

fn open<R: Read + Seek>(reader: R, limits: &Limits) -> Result<Opened<R>, ImageFault> {
    let mut decoder = first(reader)?;
    let reduced = decoder.find_tag_unsigned::<u32>(Tag::NewSubfileType).ok().flatten().unwrap_or(0) & REDUCED != 0;
    let has = |decoder: &mut Decoder<R>, tag| decoder.image_ifd().directory().contains(tag);
    // the first picture of a raw file is a thumbnail; the picture is in a sub-directory
    if has(&mut decoder, DNG_VERSION) || (reduced && has(&mut decoder, Tag::SubIfd)) {
        return Err(ImageFault::Raw("DNG, NEF, ARW or alike"));
    }
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
    let (mut width, mut height) = decoder.dimensions().map_err(|error| fault(&error))?;
    limits.check(width, height)?;
    let channels = channels(decoder.colortype().map_err(|error| fault(&error))?)?;
    let format = decoder.find_tag_unsigned_vec::<u16>(Tag::SampleFormat).ok().flatten().unwrap_or_default();
    if format.iter().any(|&format| format != SampleFormat::Uint.to_u16()) {
        return Err(ImageFault::unsupported("the TIFF has floating point or signed samples"));
    }
    let orientation = decoder.find_tag_unsigned::<u32>(Tag::Orientation).ok().flatten().map_or(1, orientation::sane);
    if orientation::swaps(orientation) {
        (width, height) = (height, width);
    }
    let header = Header {
        width,
        height,
        channels: channels.kept as u8,
        bit_depth: channels.bits,
        format: Format::Tiff,
        orientation,
        taken: taken(&mut decoder),
    };
    Ok(Opened { decoder, header, stored: channels.stored })
}

/// When the picture was taken: by the EXIF directory or, without one, by `DateTime`. A defect of these tags is no defect
/// of the picture.
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

/// Refuses files with several pictures, because all but the first would be ignored. Unreadable pages do not count.
fn refuse_pages<R: Read + Seek>(mut decoder: Decoder<R>) -> Result<(), ImageFault> {
    for _ in 0..PAGES_LOOKED_AT {
        if !decoder.more_images() || decoder.next_image().is_err() {
            return Ok(());
        }
        let kind = decoder.find_tag_unsigned::<u32>(Tag::NewSubfileType).ok().flatten().unwrap_or(0);
        if kind & REDUCED == 0 {
            return Err(ImageFault::Unsupported {
                what: "the TIFF holds several pages".into(),
                advice: "save each slice as a separate file",
            });
        }
    }
    Ok(())
}

pub(super) fn probe(reader: impl Read + Seek, limits: &Limits) -> Result<Header, ImageFault> {
    let opened = open(reader, limits)?;
    refuse_pages(opened.decoder)?;
    Ok(opened.header)
}

pub(super) fn metadata(bytes: &[u8]) -> Metadata {
    Metadata { icc: icc_profile(bytes), exif: exif_block::from_tiff(bytes) }
}

fn icc_profile(bytes: &[u8]) -> Option<Vec<u8>> {
    let mut decoder = first(Cursor::new(bytes)).ok()?;
    let mut value = ValueBuffer::empty(Type::BYTE);
    decoder.image_ifd().find_tag_buf(Tag::IccProfile, &mut value).ok()??;
    let icc = value.as_bytes();
    (!icc.is_empty()).then(|| icc.to_vec())
}

/// The picture as stored, and its orientation, of a file of `length` bytes.
pub(super) fn decode(mut reader: impl Read + Seek, length: u64, limits: &Limits) -> Result<(Raster, u8), ImageFault> {
    refuse_pages(open(&mut reader, limits)?.decoder)?;
    reader.rewind().map_err(|error| ImageFault::from_io(Format::Tiff, &error))?;
    let Opened { decoder, header, stored } = open(reader, limits)?;

    let declared = header.width as usize * header.height as usize * stored * usize::from(header.bit_depth / 8);
    if (declared / LARGEST_RATIO) as u64 > length {
        return Err(ImageFault::Truncated(Format::Tiff));
    }
    // one row of tiles may extend beyond the picture; no valid file needs more than this
    let largest = (header.width as usize + 4096) * (header.height as usize + 4096) * stored * 2;
    let mut allowed = DecoderLimits::default();
    allowed.decoding_buffer_size = limits.max_bytes();
    allowed.intermediate_buffer_size = largest.min(limits.max_bytes());
    let mut decoder = decoder.with_limits(allowed);

    let mut result = DecodingResult::U8(Vec::new());
    let layout = decoder.read_image_to_buffer(&mut result).map_err(|error| fault(&error))?;

    let (width, height) = decoder.dimensions().map_err(|error| fault(&error))?;
    let (width, height) = (width as usize, height as usize);
    let kept = usize::from(header.channels);
    let samples = width * height * stored;
    let raster = match result {
        DecodingResult::U8(data) if data.len() == samples => {
            Raster::eight(width, height, kept, arranged(data, layout.planes, stored, kept))
        }
        DecodingResult::U16(data) if data.len() == samples => {
            Raster::sixteen(width, height, kept, arranged(data, layout.planes, stored, kept))
        }
        _ => return Err(ImageFault::damaged(Format::Tiff, "its size or depth differs from the declared one")),
    };
    Ok((raster, header.orientation))
}

/// Interleaved samples without alpha, from samples that are interleaved or in planes.
fn arranged<T: Copy>(samples: Vec<T>, planes: usize, stored: usize, kept: usize) -> Vec<T> {
    if planes <= 1 {
        return first_channels(samples, stored, kept);
    }
    let pixels = samples.len() / stored;
    let mut out = Vec::with_capacity(pixels * kept);
    for pixel in 0..pixels {
        out.extend((0..kept).map(|channel| samples[channel * pixels + pixel]));
    }
    out
}
