//! Reads JPEG.
//!
//! The decoder shows truncated pictures as well as it can, which is wrong for measurements. So this module checks
//! first: a file without an end marker is truncated; the scan is decoded with an undecodable tail, so that a short scan
//! is an error instead of a grey area; a progressive picture must have all scans, down to the last bit of every
//! coefficient.

pub(super) mod guarded;
mod scans;

use std::{
    borrow::Cow,
    hash::{DefaultHasher, Hasher},
    io::{self, BufRead, Read},
};

use zune_core::{bytestream::ZCursor, colorspace::ColorSpace, options::DecoderOptions};

use super::{
    ColourSpace, Metadata,
    colour_space::resolved,
    colour_tags::ColourTags,
    exif_block,
    fault::ImageFault,
    header::{Format, Header, Limits},
    icc_parts::IccParts,
    orientation,
    rgb_space::Declared,
};
use crate::imaging::Raster;
use guarded::{EOI, Guard, Guarded};
use scans::{MAX_SCANS, Pass, SOS, Walk, is_complete, walk};

/// Maximum number of bytes before the first scan. Cameras write previews of some megabytes there.
const MAX_HEAD_BYTES: u64 = 64 << 20;

/// Maximum number of pixels per byte: a block of 64 pixels takes at least one bit. A file that declares more is
/// truncated and refused before memory is allocated.
const PIXELS_PER_BYTE: u64 = 512;

/// Marker of the frame header of progressive pictures.
const PROGRESSIVE: u8 = 0xC2;

/// Marker of the frame header of JPEG-LS, which is another format.
const JPEG_LS: u8 = 0xF7;

const SOI: u8 = 0xD8;
const APP1: u8 = 0xE1;
const APP2: u8 = 0xE2;
const APP14: u8 = 0xEE;

/// The segments before the first scan.
#[derive(Default)]
struct Head {
    /// Marker of the frame header, which specifies the coding process; 0 before it was read.
    process: u8,
    precision: u8,
    width: u16,
    height: u16,
    /// Identifiers of the components.
    components: Vec<u8>,
    /// Sampling factors of the components along x and y.
    sampling: Vec<[u8; 2]>,
    /// Components in the first scan.
    scanned: u8,
    jfif: bool,
    /// Colour transform of the Adobe marker.
    adobe: Option<u8>,
    exif: Option<Vec<u8>>,
    icc: IccParts,
}

impl Head {
    /// Reads up to the header of the first scan, inclusive.
    fn read(reader: impl BufRead) -> Result<Self, ImageFault> {
        let torn = |error: io::Error| ImageFault::from_io(Format::Jpeg, &error);
        let mut reader = reader.take(MAX_HEAD_BYTES);
        let mut head = Self::default();
        if next_marker(&mut reader)? != SOI {
            return Err(damaged("no start marker"));
        }
        loop {
            let marker = next_marker(&mut reader)?;
            if matches!(marker, SOI | EOI | 0x01 | 0xD0..=0xD7) {
                return Err(damaged("a marker that does not belong before the picture"));
            }
            if marker == JPEG_LS {
                return Err(ImageFault::OtherFormat("JPEG-LS"));
            }
            let mut length = [0; 2];
            reader.read_exact(&mut length).map_err(torn)?;
            let length = usize::from(u16::from_be_bytes(length));
            let Some(length) = length.checked_sub(2) else {
                return Err(damaged("a segment shorter than its own length"));
            };
            let mut segment = vec![0; length];
            reader.read_exact(&mut segment).map_err(torn)?;
            head.take_segment(marker, segment)?;
            if marker == SOS {
                return Ok(head);
            }
        }
    }

    fn take_segment(&mut self, marker: u8, segment: Vec<u8>) -> Result<(), ImageFault> {
        match marker {
            // start of frame; C4, C8 and CC are tables and an extension
            0xC0..=0xCF if !matches!(marker, 0xC4 | 0xC8 | 0xCC) => {
                if self.process != 0 {
                    return Err(damaged("two frame headers"));
                }
                let [precision, h1, h0, w1, w0, count, rest @ ..] = segment.as_slice() else {
                    return Err(damaged("frame header too short"));
                };
                if rest.len() < usize::from(*count) * 3 {
                    return Err(damaged("frame header too short"));
                }
                self.process = marker;
                self.precision = *precision;
                self.height = u16::from_be_bytes([*h1, *h0]);
                self.width = u16::from_be_bytes([*w1, *w0]);
                let components = rest.chunks_exact(3).take(usize::from(*count));
                (self.components, self.sampling) = components.map(|c| (c[0], [c[1] >> 4, c[1] & 15])).unzip();
            }
            SOS => {
                if self.process == 0 {
                    return Err(damaged("no frame header before the scan"));
                }
                self.scanned = segment.first().copied().unwrap_or(0);
            }
            0xE0 if segment.starts_with(b"JFIF\0") => self.jfif = true,
            APP1 => {
                if let Some(block) = segment.strip_prefix(b"Exif\0\0")
                    && self.exif.is_none()
                {
                    self.exif = Some(block.to_vec());
                }
            }
            APP2 => self.icc.add(&segment),
            APP14 if segment.starts_with(b"Adobe") => self.adobe = segment.get(11).copied(),
            _ => {}
        }
        Ok(())
    }

    /// The header. Refuses codings that the decoder does not reproduce correctly.
    fn header(&self, limits: &Limits) -> Result<Header, ImageFault> {
        let coding = match self.process {
            0xC0..=0xC2 => None,
            0xC3 | 0xC7 | 0xCB | 0xCF => Some("lossless"),
            0xC9 | 0xCA | 0xCD | 0xCE => Some("arithmetic coded"),
            _ => Some("hierarchical"),
        };
        if let Some(coding) = coding {
            return Err(ImageFault::unsupported(format!("the JPEG is {coding}, which is not supported")));
        }
        if self.precision != 8 {
            return Err(ImageFault::unsupported(format!("the JPEG has {} bits per sample", self.precision)));
        }
        let channels = match self.components.as_slice() {
            [_] => 1,
            // the decoder would interpret these as YCbCr
            [b'R', b'G', b'B'] if self.adobe.is_none() && !self.jfif => {
                return Err(ImageFault::unsupported("the JPEG is stored as RGB without a marker that declares it"));
            }
            [_, _, _] => 3,
            [_, _, _, _] => return Err(ImageFault::unsupported("the JPEG is CMYK")),
            other => return Err(ImageFault::unsupported(format!("the JPEG has {} colour components", other.len()))),
        };
        // the decoder loses the last row of blocks of such files
        if self.process != PROGRESSIVE && usize::from(self.scanned) != self.components.len() {
            return Err(ImageFault::unsupported("the JPEG is stored colour by colour (not interleaved)"));
        }
        if !self.is_sampling_supported() {
            return Err(ImageFault::Unsupported {
                what: "the JPEG stores its colours finer than its brightness, or in unusual steps".into(),
                advice: "save all slices again with the colour sampling 4:4:4 or 4:2:0",
            });
        }
        let orientation = self.orientation();
        let (mut width, mut height) = (u32::from(self.width), u32::from(self.height));
        if orientation::swaps(orientation) {
            (width, height) = (height, width);
        }
        limits.check(width, height)?;
        let taken = self.exif.as_deref().and_then(exif_block::taken);
        let colour = self.colours().1;
        Ok(Header { width, height, channels, bit_depth: 8, format: Format::Jpeg, orientation, colour, taken })
    }

    /// True for sampling factors with which the decoder gives the pixels of libjpeg (compared for all factors up to 4):
    /// colour not finer than brightness along x, and one step along y.
    fn is_sampling_supported(&self) -> bool {
        let Some((&[luma_x, luma_y], chroma)) = self.sampling.split_first() else { return false };
        let finest_y = self.sampling.iter().map(|&[_, y]| y).max().unwrap_or(0);
        matches!(luma_x, 1 | 2 | 4)
            && chroma.iter().all(|&[x, y]| x > 0 && luma_x % x == 0 && (luma_x < 4 || y <= luma_y))
            && self.sampling.iter().all(|&[_, y]| y > 0 && (y == 1 || y == finest_y))
    }

    /// The ICC profile for outputs, and the colour space.
    fn colours(&self) -> (Option<Vec<u8>>, ColourSpace) {
        let tags = self.exif.as_deref().map(ColourTags::of_block).unwrap_or_default();
        let declared = if self.icc.is_empty() { tags.declared() } else { Declared::Unknown };
        resolved(self.icc.joined(), declared, self.components.len() as u8)
    }

    fn orientation(&self) -> u8 {
        self.exif.as_deref().and_then(exif_block::orientation).unwrap_or(1)
    }
}

fn damaged(why: &'static str) -> ImageFault {
    ImageFault::damaged(Format::Jpeg, why)
}

/// The next marker, past fill bytes.
fn next_marker(reader: &mut impl Read) -> Result<u8, ImageFault> {
    let mut byte = [0];
    let mut read = || reader.read_exact(&mut byte).map(|()| byte[0]);
    let torn = |error: io::Error| ImageFault::from_io(Format::Jpeg, &error);
    if read().map_err(torn)? != 0xFF {
        return Err(damaged("a marker is missing"));
    }
    loop {
        match read().map_err(torn)? {
            0xFF => {}
            0 => return Err(damaged("a marker is missing")),
            marker => return Ok(marker),
        }
    }
}

pub(super) fn probe(reader: impl BufRead, limits: &Limits) -> Result<Header, ImageFault> {
    Head::read(reader)?.header(limits)
}

pub(super) fn metadata(bytes: &[u8]) -> Metadata {
    Head::read(bytes).map(|head| Metadata { icc: head.colours().0, exif: head.exif }).unwrap_or_default()
}

/// The picture as stored, and its orientation.
pub(super) fn decode(bytes: Cow<'_, [u8]>, limits: &Limits, buffer: Vec<u8>) -> Result<(Raster, u8), ImageFault> {
    let head = Head::read(&*bytes)?;
    let header = head.header(limits)?;
    if u64::from(header.width) * u64::from(header.height) / PIXELS_PER_BYTE > bytes.len() as u64 {
        return Err(ImageFault::Truncated(Format::Jpeg));
    }
    let Walk { end, scans } = walk(&bytes).ok_or(ImageFault::Truncated(Format::Jpeg))?;
    if scans.len() > MAX_SCANS {
        return Err(damaged("it has more than 100 scans"));
    }
    let is_progressive = head.process == PROGRESSIVE;
    if is_progressive && !is_complete(&scans, &head.components) {
        return Err(ImageFault::Truncated(Format::Jpeg));
    }
    let ends_by_refining = is_progressive && scans.last().and_then(|scan| Pass::of(scan)).is_some_and(|p| p.refines);
    let mut guarded = Guarded::new(bytes, end);
    // Refinement bits may be ones or zeros, so one guard does not reveal missing ones. A decoder that reads beyond the
    // end returns different pictures for different tails.
    let other =
        if ends_by_refining { Some(digest(&samples(guarded.ending(Guard::Zeros), &head, Vec::new())?)) } else { None };
    let samples = samples(guarded.ending(Guard::Ones), &head, buffer)?;
    if other.is_some_and(|other| other != digest(&samples)) {
        return Err(ImageFault::Truncated(Format::Jpeg));
    }
    let (width, height, channels) = (usize::from(head.width), usize::from(head.height), head.components.len());
    Ok((Raster::eight(width, height, channels, samples), header.orientation))
}

/// The samples of a guarded file as stored. The memory of `buffer` is used again.
fn samples(guarded: &[u8], head: &Head, mut buffer: Vec<u8>) -> Result<Vec<u8>, ImageFault> {
    let channels = head.components.len();
    let out = if channels == 1 { ColorSpace::Luma } else { ColorSpace::RGB };
    let options = DecoderOptions::default()
        .jpeg_set_out_colorspace(out)
        .jpeg_set_max_scans(MAX_SCANS)
        .set_strict_mode(true)
        .set_max_width(usize::MAX)
        .set_max_height(usize::MAX);
    let mut decoder = zune_jpeg::JpegDecoder::new_with_options(ZCursor::new(guarded), options);
    // the messages of the decoder (a code that is not in the table, ...) do not help users
    let corrupt = |_| damaged("its picture data are corrupt or incomplete");
    decoder.decode_headers().map_err(corrupt)?;
    let length = decoder.output_buffer_size().ok_or_else(|| damaged("it has no size"))?;
    // zeros, as in fresh memory: what a decoder leaves out must not show another picture
    if buffer.capacity() < length {
        buffer = vec![0; length];
    } else {
        buffer.clear();
        buffer.resize(length, 0);
    }
    decoder.decode_into(&mut buffer).map_err(corrupt)?;
    if buffer.len() != usize::from(head.width) * usize::from(head.height) * channels {
        return Err(damaged("its size differs from the declared size"));
    }
    Ok(buffer)
}

/// A hash, to compare two pictures without keeping both.
fn digest(samples: &[u8]) -> u64 {
    let mut hasher = DefaultHasher::new();
    hasher.write(samples);
    hasher.finish()
}
