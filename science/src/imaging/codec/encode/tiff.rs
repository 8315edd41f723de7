//! Writes TIFF and BigTIFF.

use std::io::{self, Seek, Write};

use ::tiff::{
    Directory, TiffError, TiffResult,
    encoder::{DirectoryEncoder, Rational, TiffEncoder, TiffKind, TiffKindBig, TiffKindStandard, TiffValue},
    tags::{
        CompressionMethod, ExtraSamples, PhotometricInterpretation, PlanarConfiguration, Predictor, ResolutionUnit,
        SampleFormat, Tag, Type,
    },
};
use exif::{Field, Value};

use crate::imaging::{
    Raster, Samples,
    codec::{Metadata, exif_block},
};

/// Offsets of a TIFF have 32 bits. Pictures with more bytes than this become a BigTIFF; the remainder is for tags.
const LARGEST_PLAIN: u64 = 4_000_000_000;

/// Size of a strip, bytes: the memory that readers need.
const STRIP_BYTES: usize = 1 << 20;

/// Values of up to this many bytes are stored in the directory itself. A BigTIFF allows 8; storing them apart is valid.
const INLINE_BYTES: usize = 4;

/// Writes a TIFF of 1, 3 or 4 channels and 8 or 16 bits, strip by strip. Alpha is declared as unassociated (straight).
/// The ICC profile is written if it is for the same number of channels. EXIF fields are written tag by tag: Make,
/// Model, DateTime and similar ones in the main directory, the others in an Exif and a GPS directory. A picture of more
/// than 4 GB of samples becomes a BigTIFF.
///
/// The compression is deflate with a horizontal predictor, by the compressor of our PNG writer, which is made for such
/// differences. libtiff reads it, and with it COLMAP, OpenCV and Pillow. Measured on photographs with alpha:
///
/// | compressor | size, 8 bits | size, 16 bits | MB/s |
/// |---|---|---|---|
/// | this one | 0.3 to 0.4 | 0.75 | over 110 |
/// | LZW | 0.22 to 0.38 | 0.82 to 0.9 | 17 to 24 |
/// | zlib, fastest level | 0.42 to 0.58 | 0.84 to 0.89 | 31 to 91 |
///
/// # Errors
/// Any I/O error of `out`, and [`io::ErrorKind::InvalidInput`] for other numbers of channels.
pub fn encode_tiff(mut out: impl Write + Seek, raster: &Raster, metadata: &Metadata) -> io::Result<()> {
    encode(&mut out, raster, metadata)
}

trait Seekable: Write + Seek {}

impl<W: Write + Seek> Seekable for W {}

/// [`encode_tiff`], compiled once for all writers.
fn encode(out: &mut dyn Seekable, raster: &Raster, metadata: &Metadata) -> io::Result<()> {
    if !matches!(raster.channels, 1 | 3 | 4) || raster.width == 0 || raster.height == 0 {
        let shape = format!("{} x {} px of {} channels", raster.width, raster.height, raster.channels);
        return Err(io::Error::new(io::ErrorKind::InvalidInput, shape));
    }
    let bytes = raster.width as u64 * raster.height as u64 * (raster.channels * raster.depth().bytes()) as u64;
    let written = if bytes > LARGEST_PLAIN {
        TiffEncoder::<_, TiffKindBig>::new_generic(out).and_then(|encoder| write(encoder, raster, metadata))
    } else {
        TiffEncoder::<_, TiffKindStandard>::new_generic(out).and_then(|encoder| write(encoder, raster, metadata))
    };
    written.map_err(|error| match error {
        TiffError::IoError(error) => error,
        other => io::Error::new(io::ErrorKind::InvalidInput, other),
    })
}

fn write<W: Write + Seek, K: TiffKind>(
    mut encoder: TiffEncoder<W, K>,
    raster: &Raster,
    metadata: &Metadata,
) -> TiffResult<()> {
    let fields = metadata.exif.as_deref().map(exif_block::directories).unwrap_or_default();
    let exif_at = write_directory(&mut encoder, &fields.exif)?;
    let gps_at = write_directory(&mut encoder, &fields.gps)?;

    // strips and tags are written here: the image writer of the crate uses a general deflate
    let mut directory = encoder.image_directory()?;
    let strips = match &raster.samples {
        Samples::Eight(samples) => write_strips(&mut directory, raster, samples, |v, left| [v.wrapping_sub(left)])?,
        Samples::Sixteen(samples) => {
            write_strips(&mut directory, raster, samples, |v, left| v.wrapping_sub(left).to_ne_bytes())?
        }
    };
    write_layout(&mut directory, raster, &strips)?;
    for field in &fields.primary {
        write_field(&mut directory, field)?;
    }
    if let Some(icc) = metadata.icc_for(raster.channels) {
        directory.write_tag(Tag::IccProfile, Undefined(&icc))?;
        pad(&mut directory, icc.len())?;
    }
    for (tag, at) in [(Tag::ExifDirectory, exif_at), (Tag::GpsDirectory, gps_at)] {
        if let Some(at) = at {
            directory.write_tag(tag, u32::try_from(at)?)?;
        }
    }
    directory.finish()
}

/// Offsets and sizes of the strips.
struct Strips<K: TiffKind> {
    rows: usize,
    offsets: Vec<K::OffsetType>,
    bytes: Vec<K::OffsetType>,
}

/// `difference` returns the bytes of a sample minus its left neighbour.
fn write_strips<W: Write + Seek, K: TiffKind, T: Copy + Default, const N: usize>(
    directory: &mut DirectoryEncoder<'_, W, K>,
    raster: &Raster,
    samples: &[T],
    difference: impl Fn(T, T) -> [u8; N],
) -> TiffResult<Strips<K>> {
    let (step, row_samples) = (raster.channels, raster.width * raster.channels);
    let rows = (STRIP_BYTES / (row_samples * N)).clamp(1, raster.height);
    let (mut offsets, mut bytes) = (Vec::new(), Vec::new());
    let mut differences = Vec::with_capacity(rows * row_samples * N);
    for strip in samples.chunks(rows * row_samples) {
        differences.clear();
        for row in strip.chunks_exact(row_samples) {
            let (first, rest) = row.split_at(step);
            differences.extend(first.iter().flat_map(|&sample| difference(sample, T::default())));
            differences.extend(rest.iter().zip(row).flat_map(|(&sample, &left)| difference(sample, left)));
        }
        let packed = compressed(&differences)?;
        offsets.push(K::convert_offset(directory.write_data(&packed[..])?)?);
        bytes.push(K::convert_offset(packed.len() as u64)?);
        pad(directory, packed.len())?;
    }
    Ok(Strips { rows, offsets, bytes })
}

/// A zlib stream. Noise, which would grow, is stored uncompressed.
fn compressed(bytes: &[u8]) -> io::Result<Vec<u8>> {
    let packed = fdeflate::compress_to_vec(bytes);
    if packed.len() <= bytes.len() {
        return Ok(packed);
    }
    let mut stored = fdeflate::StoredOnlyCompressor::new(io::Cursor::new(Vec::new()))?;
    stored.write_data(bytes)?;
    Ok(stored.finish()?.into_inner())
}

/// The tags that describe the sample layout.
fn write_layout<W: Write + Seek, K: TiffKind>(
    directory: &mut DirectoryEncoder<'_, W, K>,
    raster: &Raster,
    strips: &Strips<K>,
) -> TiffResult<()> {
    let channels = raster.channels;
    let photometric =
        if channels == 1 { PhotometricInterpretation::BlackIsZero } else { PhotometricInterpretation::RGB };
    directory.write_tag(Tag::ImageWidth, u32::try_from(raster.width)?)?;
    directory.write_tag(Tag::ImageLength, u32::try_from(raster.height)?)?;
    directory.write_tag(Tag::BitsPerSample, &vec![raster.depth().bytes() as u16 * 8; channels][..])?;
    directory.write_tag(Tag::SampleFormat, &vec![SampleFormat::Uint.to_u16(); channels][..])?;
    directory.write_tag(Tag::SamplesPerPixel, channels as u16)?;
    directory.write_tag(Tag::Compression, CompressionMethod::Deflate.to_u16())?;
    directory.write_tag(Tag::Predictor, Predictor::Horizontal.to_u16())?;
    directory.write_tag(Tag::PhotometricInterpretation, photometric.to_u16())?;
    directory.write_tag(Tag::PlanarConfiguration, PlanarConfiguration::Chunky.to_u16())?;
    if channels == 4 {
        directory.write_tag(Tag::ExtraSamples, &[ExtraSamples::UnassociatedAlpha][..])?;
    }
    directory.write_tag(Tag::RowsPerStrip, u32::try_from(strips.rows)?)?;
    directory.write_tag(Tag::StripOffsets, K::convert_slice(&strips.offsets))?;
    directory.write_tag(Tag::StripByteCounts, K::convert_slice(&strips.bytes))?;
    // baseline TIFF requires a resolution; that of the camera replaces it if present
    directory.write_tag(Tag::XResolution, Rational { n: 72, d: 1 })?;
    directory.write_tag(Tag::YResolution, Rational { n: 72, d: 1 })?;
    directory.write_tag(Tag::ResolutionUnit, ResolutionUnit::Inch.to_u16())
}

/// Writes a sub-directory and returns its offset; `None` for no fields.
fn write_directory<W: Write + Seek, K: TiffKind>(
    encoder: &mut TiffEncoder<W, K>,
    fields: &[Field],
) -> TiffResult<Option<u64>> {
    if fields.is_empty() {
        return Ok(None);
    }
    let mut directory = encoder.extra_directory()?;
    for field in fields {
        write_field(&mut directory, field)?;
    }
    Ok(Some(directory.finish_with_offsets()?.pointer.0))
}

fn write_field<W: Write + Seek, K: TiffKind>(
    directory: &mut DirectoryEncoder<'_, W, K>,
    field: &Field,
) -> TiffResult<()> {
    let Some((kind, bytes)) = encoded(&field.value) else { return Ok(()) };
    let entry = directory.write_entry_bytes(kind, &bytes)?;
    if bytes.len() > INLINE_BYTES {
        pad(directory, bytes.len())?;
    }
    let mut one = Directory::empty();
    one.extend([(Tag::from_u16_exhaustive(field.tag.number()), entry)]);
    directory.extend_from(&one);
    Ok(())
}

/// Pads a value of odd length with one byte, because TIFF requires even offsets.
fn pad<W: Write + Seek, K: TiffKind>(directory: &mut DirectoryEncoder<'_, W, K>, length: usize) -> TiffResult<()> {
    if length % 2 == 1 {
        directory.write_data(0u8)?;
    }
    Ok(())
}

/// A value as TIFF stores it, in the byte order of this machine, which is that of the file.
fn encoded(value: &Value) -> Option<(Type, Vec<u8>)> {
    Some(match value {
        Value::Byte(v) => (Type::BYTE, v.clone()),
        Value::Ascii(strings) => {
            (Type::ASCII, strings.iter().flat_map(|s| s.iter().copied().chain([0])).collect::<Vec<u8>>())
        }
        Value::Short(v) => (Type::SHORT, v.iter().flat_map(|v| v.to_ne_bytes()).collect()),
        Value::Long(v) => (Type::LONG, v.iter().flat_map(|v| v.to_ne_bytes()).collect()),
        Value::Rational(v) => {
            (Type::RATIONAL, v.iter().flat_map(|v| [v.num, v.denom]).flat_map(u32::to_ne_bytes).collect())
        }
        Value::SByte(v) => (Type::SBYTE, v.iter().map(|v| v.to_ne_bytes()[0]).collect()),
        Value::Undefined(v, _) => (Type::UNDEFINED, v.clone()),
        Value::SShort(v) => (Type::SSHORT, v.iter().flat_map(|v| v.to_ne_bytes()).collect()),
        Value::SLong(v) => (Type::SLONG, v.iter().flat_map(|v| v.to_ne_bytes()).collect()),
        Value::SRational(v) => {
            (Type::SRATIONAL, v.iter().flat_map(|v| [v.num, v.denom]).flat_map(i32::to_ne_bytes).collect())
        }
        Value::Float(v) => (Type::FLOAT, v.iter().flat_map(|v| v.to_ne_bytes()).collect()),
        Value::Double(v) => (Type::DOUBLE, v.iter().flat_map(|v| v.to_ne_bytes()).collect()),
        Value::Unknown(..) => return None,
    })
    .filter(|(_, bytes): &(Type, Vec<u8>)| !bytes.is_empty())
}

/// Bytes of TIFF type UNDEFINED, the type of an ICC profile.
struct Undefined<'a>(&'a [u8]);

impl TiffValue for Undefined<'_> {
    const BYTE_LEN: u8 = 1;
    const FIELD_TYPE: Type = Type::UNDEFINED;

    fn count(&self) -> usize {
        self.0.len()
    }

    fn data(&self) -> std::borrow::Cow<'_, [u8]> {
        self.0.into()
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;
    use crate::imaging::codec::{Limits, decode};

    #[test]
    fn a_big_tiff_reads_back_like_a_plain_one() {
        let raster = Raster::sixteen(1000, 400, 3, (0..1_200_000).map(|i| (i * 7 % 65_521) as u16).collect());
        let mut plain = Cursor::new(Vec::new());
        encode_tiff(&mut plain, &raster, &Metadata::default()).unwrap();
        let mut big = Cursor::new(Vec::new());
        let encoder = TiffEncoder::<_, TiffKindBig>::new_generic(&mut big).unwrap();
        write(encoder, &raster, &Metadata::default()).unwrap();
        assert_eq!(big.get_ref()[2], 43, "the mark of BigTIFF");
        assert_eq!(decode(plain.get_ref(), &Limits::default()).unwrap(), raster);
        assert_eq!(decode(big.get_ref(), &Limits::default()).unwrap(), raster);
    }

    #[test]
    fn shapes_that_no_reader_knows_are_refused() {
        let two = Raster::eight(2, 2, 2, vec![0; 8]);
        assert!(encode_tiff(Cursor::new(Vec::new()), &two, &Metadata::default()).is_err());
        let empty = Raster::eight(0, 2, 1, Vec::new());
        assert!(encode_tiff(Cursor::new(Vec::new()), &empty, &Metadata::default()).is_err());
    }
}
