//! Recognises the format of a file by its first bytes, and camera raw files by their extension: most are TIFF files
//! whose first picture is a thumbnail.

use std::io::{BufRead, Seek, SeekFrom};

use super::{Format, ImageFault};

/// The format of the file. The reader is at the start of the file before and after.
pub(super) fn format_of(reader: &mut (impl BufRead + Seek)) -> Result<Format, ImageFault> {
    let mut head = [0u8; 16];
    let mut filled = 0;
    while filled < head.len() {
        let read = match reader.read(&mut head[filled..]) {
            Ok(0) => break,
            Ok(read) => read,
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => continue,
            Err(error) => return Err(ImageFault::Unreadable(error.to_string())),
        };
        filled += read;
    }
    reader.seek(SeekFrom::Start(0)).map_err(|error| ImageFault::Unreadable(error.to_string()))?;
    classify(&head[..filled])
}

fn classify(head: &[u8]) -> Result<Format, ImageFault> {
    if head.is_empty() {
        return Err(ImageFault::Empty);
    }
    let box_brand = if head.get(4..8) == Some(b"ftyp") { head.get(8..12) } else { None };
    match box_brand {
        Some(b"crx ") => return Err(ImageFault::Raw("Canon CR3")),
        Some(b"avif" | b"avis") => return Err(ImageFault::OtherFormat("AVIF")),
        Some(b"heic" | b"heix" | b"hevc" | b"heim" | b"heis" | b"mif1" | b"msf1") => {
            return Err(ImageFault::OtherFormat("HEIC"));
        }
        Some(_) => return Err(ImageFault::OtherFormat("MP4-like")),
        None => {}
    }
    if matches!(head, [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..]) && head.get(8..10) == Some(b"CR") {
        return Err(ImageFault::Raw("Canon CR2"));
    }
    match head {
        [0xFF, 0xD8, 0xFF, ..] => Ok(Format::Jpeg),
        [0x89, b'P', b'N', b'G', 0x0D, 0x0A, 0x1A, 0x0A, ..] => Ok(Format::Png),
        [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => Ok(Format::Tiff),
        [b'I', b'I', b'U', 0, ..] => Err(ImageFault::Raw("Panasonic RW2")),
        [b'I', b'I', b'R', b'O' | b'S', ..] | [b'M', b'M', b'O', b'R', ..] => Err(ImageFault::Raw("Olympus ORF")),
        [b'F', b'U', b'J', b'I', b'F', b'I', b'L', b'M', ..] => Err(ImageFault::Raw("Fujifilm RAF")),
        [b'G', b'I', b'F', b'8', ..] => Err(ImageFault::OtherFormat("GIF")),
        [b'B', b'M', ..] => Err(ImageFault::OtherFormat("BMP")),
        [b'8', b'B', b'P', b'S', ..] => Err(ImageFault::OtherFormat("Photoshop")),
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => Err(ImageFault::OtherFormat("WebP")),
        [0xFF, 0x0A, ..] | [0, 0, 0, 12, b'J', b'X', b'L', b' ', ..] => Err(ImageFault::OtherFormat("JPEG XL")),
        [0, 0, 0, 12, b'j', b'P', ..] | [0xFF, 0x4F, 0xFF, 0x51, ..] => Err(ImageFault::OtherFormat("JPEG 2000")),
        _ => Err(ImageFault::Unknown),
    }
}

/// Extensions of pictures, supported or not.
const PICTURES: &[&str] = &[
    "jpg", "jpeg", "jpe", "jfif", "png", "tif", "tiff", "heic", "heif", "avif", "gif", "bmp", "webp", "psd", "jp2",
    "jxl",
];

/// Camera raw formats by extension.
const RAW: &[(&str, &str)] = &[
    ("cr2", "Canon CR2"),
    ("cr3", "Canon CR3"),
    ("crw", "Canon CRW"),
    ("nef", "Nikon NEF"),
    ("nrw", "Nikon NRW"),
    ("arw", "Sony ARW"),
    ("srf", "Sony SRF"),
    ("sr2", "Sony SR2"),
    ("dng", "DNG"),
    ("orf", "Olympus ORF"),
    ("rw2", "Panasonic RW2"),
    ("raf", "Fujifilm RAF"),
    ("pef", "Pentax PEF"),
    ("srw", "Samsung SRW"),
    ("3fr", "Hasselblad 3FR"),
    ("iiq", "Phase One IIQ"),
    ("x3f", "Sigma X3F"),
    ("raw", "RAW"),
];

fn extension(name: &str) -> Option<String> {
    let base = name.rsplit('/').next().unwrap_or(name);
    let (stem, extension) = base.rsplit_once('.')?;
    (!stem.is_empty()).then(|| extension.to_ascii_lowercase())
}

/// The camera raw format of the extension of `name`.
pub fn raw_extension(name: &str) -> Option<&'static str> {
    let extension = extension(name)?;
    RAW.iter().find(|(known, _)| *known == extension).map(|(_, format)| *format)
}

/// True when the extension of `name` is that of a picture, supported or not.
pub fn is_picture_name(name: &str) -> bool {
    extension(name).is_some_and(|extension| PICTURES.contains(&extension.as_str()))
}
