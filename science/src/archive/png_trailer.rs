//! Reads a picture without the data that follows a PNG.

use std::io::{self, Read};

const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";

/// Appends a file to `out`. Data after the last chunk of a PNG is read, so that the size and the checksum of the whole
/// member are checked, and discarded. Returns the number of bytes read.
///
/// # Errors
/// Any error of `from`.
pub(super) fn read_without_trailer(from: &mut impl Read, out: &mut Vec<u8>) -> io::Result<u64> {
    if !append(from, out, PNG.len() as u64)? || out != PNG {
        from.read_to_end(out)?;
        return Ok(out.len() as u64);
    }
    loop {
        let at = out.len();
        if !append(from, out, 8)? {
            return Ok(out.len() as u64);
        }
        let (length, kind) = out[at..].split_at(4);
        let length = length.iter().fold(0, |sum, &byte| sum << 8 | u64::from(byte));
        let is_last = kind == b"IEND";
        // the checksum of the chunk
        if !append(from, out, length + 4)? {
            return Ok(out.len() as u64);
        }
        if is_last {
            return Ok(out.len() as u64 + io::copy(from, &mut io::sink())?);
        }
    }
}

/// Appends `count` bytes; false when there are fewer.
fn append(from: &mut impl Read, out: &mut Vec<u8>, count: u64) -> io::Result<bool> {
    Ok(from.take(count).read_to_end(out)? as u64 == count)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept(bytes: &[u8]) -> (usize, u64) {
        let mut out = Vec::new();
        let read = read_without_trailer(&mut &*bytes, &mut out).unwrap();
        assert_eq!(out, bytes[..out.len()]);
        (out.len(), read)
    }

    #[test]
    fn a_png_is_kept_to_its_end_and_everything_else_whole() {
        let chunk = |kind: &[u8], data: &[u8]| [&(data.len() as u32).to_be_bytes(), kind, data, &[1, 2, 3, 4]].concat();
        let png = [PNG, &chunk(b"IHDR", &[0; 13]), &chunk(b"IDAT", &[5; 70]), &chunk(b"IEND", b"")].concat();
        let with_more = [&png[..], &[0; 5_000]].concat();
        assert_eq!(kept(&png), (png.len(), png.len() as u64));
        assert_eq!(kept(&with_more), (png.len(), with_more.len() as u64));
        for end in 0..png.len() {
            assert_eq!(kept(&png[..end]), (end, end as u64));
        }
        let jpeg = [&[0xFF, 0xD8, 0xFF][..], &[9; 4_000]].concat();
        assert_eq!(kept(&jpeg), (jpeg.len(), jpeg.len() as u64));
    }
}
