//! JPEG in.
//!
//! The decoder is made to show torn pictures as well as it can, which is the wrong thing for measurements. So the
//! markers are walked here first: a file without its end marker is torn, and the scan is decoded with a tail that
//! cannot be decoded, so that a scan that is too short is an error and not a grey area.

use std::io::{self, BufRead, Read};

use zune_core::{bytestream::ZCursor, colorspace::ColorSpace, options::DecoderOptions};

use super::{Format, Header, ImageFault, Limits, Metadata, exif_block, orientation};
use crate::imaging::Raster;

/// Most bytes before the first scan. Cameras write previews of some megabytes there.
const MAX_HEAD_BYTES: u64 = 64 << 20;

const SOI: u8 = 0xD8;
const EOI: u8 = 0xD9;
const SOS: u8 = 0xDA;
const APP1: u8 = 0xE1;
const APP2: u8 = 0xE2;
const APP14: u8 = 0xEE;

/// What stands before the first scan.
#[derive(Default)]
struct Head {
    /// Marker of the frame header (how the picture is coded), 0 until one was seen.
    process: u8,
    precision: u8,
    width: u16,
    height: u16,
    /// Identifiers of the components.
    components: Vec<u8>,
    /// Components in the first scan.
    scanned: u8,
    jfif: bool,
    /// Colour transform of Adobe's marker.
    adobe: Option<u8>,
    exif: Option<Vec<u8>>,
    icc: Vec<(u8, Vec<u8>)>,
}

impl Head {
    /// Reads up to and with the header of the first scan.
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
                return Err(damaged(format!("marker FF{marker:02X} before the picture")));
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
                self.components = rest.chunks_exact(3).take(usize::from(*count)).map(|c| c[0]).collect();
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
            APP2 => {
                if let Some([number, _count, part @ ..]) = segment.strip_prefix(b"ICC_PROFILE\0") {
                    self.icc.push((*number, part.to_vec()));
                }
            }
            APP14 if segment.starts_with(b"Adobe") => self.adobe = segment.get(11).copied(),
            _ => {}
        }
        Ok(())
    }

    /// The header, once the way the picture is coded is known to be decoded right.
    fn header(&self, limits: &Limits) -> Result<Header, ImageFault> {
        let coding = match self.process {
            0xC0..=0xC2 => None,
            0xC3 | 0xC7 | 0xCB | 0xCF => Some("lossless"),
            0xC9 | 0xCA | 0xCD | 0xCE => Some("arithmetic coded"),
            _ => Some("hierarchical"),
        };
        if let Some(coding) = coding {
            return Err(ImageFault::unsupported(format!("the JPEG is {coding}, which is not read")));
        }
        if self.precision != 8 {
            return Err(ImageFault::unsupported(format!("the JPEG has {} bits per sample", self.precision)));
        }
        let channels = match self.components.as_slice() {
            [_] => 1,
            // the decoder would take these for YCbCr
            [b'R', b'G', b'B'] if self.adobe.is_none() && !self.jfif => {
                return Err(ImageFault::unsupported("the JPEG is stored as RGB without saying so"));
            }
            [_, _, _] => 3,
            [_, _, _, _] => return Err(ImageFault::unsupported("the JPEG is CMYK")),
            other => return Err(ImageFault::unsupported(format!("the JPEG has {} colour components", other.len()))),
        };
        // In such files the decoder loses the last row of blocks.
        if self.process != 0xC2 && usize::from(self.scanned) != self.components.len() {
            return Err(ImageFault::unsupported("the JPEG is stored colour by colour (not interleaved)"));
        }
        let orientation = self.orientation();
        let (mut width, mut height) = (u32::from(self.width), u32::from(self.height));
        if orientation::swaps(orientation) {
            (width, height) = (height, width);
        }
        limits.check(width, height)?;
        Ok(Header { width, height, channels, bit_depth: 8, format: Format::Jpeg, orientation })
    }

    fn orientation(&self) -> u8 {
        self.exif.as_deref().and_then(exif_block::orientation).unwrap_or(1)
    }

    /// The ICC profile, put together from its numbered parts; none when one is missing.
    fn icc_profile(&self) -> Option<Vec<u8>> {
        let mut parts: Vec<&(u8, Vec<u8>)> = self.icc.iter().collect();
        parts.sort_by_key(|(number, _)| *number);
        let whole = parts.iter().enumerate().all(|(i, (number, _))| usize::from(*number) == i + 1);
        (whole && !parts.is_empty()).then(|| parts.iter().flat_map(|(_, part)| part.iter().copied()).collect())
    }
}

fn damaged(why: impl ToString) -> ImageFault {
    ImageFault::damaged(Format::Jpeg, why)
}

/// The next marker, past fill bytes.
fn next_marker(reader: &mut impl Read) -> Result<u8, ImageFault> {
    let mut byte = [0];
    let mut read = || reader.read_exact(&mut byte).map(|()| byte[0]);
    let torn = |error: io::Error| ImageFault::from_io(Format::Jpeg, &error);
    if read().map_err(torn)? != 0xFF {
        return Err(damaged("a marker is missing where one must be"));
    }
    loop {
        match read().map_err(torn)? {
            0xFF => {}
            0 => return Err(damaged("a marker is missing where one must be")),
            marker => return Ok(marker),
        }
    }
}

/// Where the end marker stands, or none when the file ends before it. Segments are skipped, so that the end of a
/// thumbnail is not taken for the end of the picture.
fn end_of(bytes: &[u8]) -> Option<usize> {
    let mut at = 2;
    let mut scanning = false;
    loop {
        if scanning {
            at += bytes.get(at..)?.iter().position(|&b| b == 0xFF)?;
        }
        let marker = *bytes.get(at + 1)?;
        match marker {
            0xFF => at += 1,
            0 | 0x01 | 0xD0..=0xD7 => at += 2,
            EOI => return Some(at),
            _ => {
                let length = [*bytes.get(at + 2)?, *bytes.get(at + 3)?];
                at += 2 + usize::from(u16::from_be_bytes(length));
                scanning |= marker == SOS;
            }
        }
    }
}

pub(super) fn probe(reader: impl BufRead, limits: &Limits) -> Result<Header, ImageFault> {
    Head::read(reader)?.header(limits)
}

pub(super) fn metadata(bytes: &[u8]) -> Metadata {
    match Head::read(bytes) {
        Ok(head) => Metadata { icc: head.icc_profile(), exif: head.exif },
        Err(_) => Metadata::default(),
    }
}

/// The picture as stored, and its orientation.
pub(super) fn decode(bytes: &[u8], limits: &Limits) -> Result<(Raster, u8), ImageFault> {
    let head = Head::read(bytes)?;
    let header = head.header(limits)?;
    let end = end_of(bytes).ok_or(ImageFault::Torn(Format::Jpeg))?;

    // 256 bits of ones in place of the end: no Huffman table has a code of all ones (ITU T.81, annex C), so a
    // decoder that still wants something there fails instead of making up the rest of the picture. One that has
    // everything never looks that far.
    let mut guarded = Vec::with_capacity(end + 66);
    guarded.extend_from_slice(&bytes[..end]);
    guarded.extend([0xFF, 0x00].repeat(32));
    guarded.extend([0xFF, EOI]);

    let channels = usize::from(header.channels);
    let out = if channels == 1 { ColorSpace::Luma } else { ColorSpace::RGB };
    let options = DecoderOptions::default()
        .jpeg_set_out_colorspace(out)
        .set_strict_mode(true)
        .set_max_width(usize::MAX)
        .set_max_height(usize::MAX);
    let mut decoder = zune_jpeg::JpegDecoder::new_with_options(ZCursor::new(guarded.as_slice()), options);
    // what the decoder says (a code that is not in the table, ...) tells a technician nothing
    let samples = decoder.decode().map_err(|_| damaged("its picture data are garbled or break off"))?;
    let (width, height) = (usize::from(head.width), usize::from(head.height));
    if samples.len() != width * height * channels {
        return Err(damaged("another size than declared"));
    }
    Ok((Raster::eight(width, height, channels, samples), header.orientation))
}
