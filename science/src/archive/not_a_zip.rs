//! Recognises what was sent instead of a complete zip, so that the error message can say what to do.

/// Maximum length of the end record: the fixed part and the longest comment.
pub(super) const END_RECORD_BYTES: u64 = 22 + 65_535;

/// Bytes examined at the start of a file.
pub(super) const HEAD_BYTES: u64 = 64 << 10;

/// From this length on, a zip without any line end has certainly lost them.
const TELLING_BYTES: usize = 2_048;

/// The message for a zip from which `curl -d` removed bytes.
pub(super) const LOST_LINE_ENDS: &str = "bytes are missing throughout the zip: curl -d (--data) removes line ends; send \
                                         the file with curl -T stack.zip, or with --data-binary @stack.zip";

/// Other formats by their first bytes, and the message for each.
const OTHERS: [(&[u8], &str); 10] = [
    (b"7z\xBC", "this is a 7z archive; make a zip (7z a -tzip -mx0 stack.zip front back)"),
    (b"Rar!", "this is a RAR archive; make a zip"),
    (b"\x1F\x8B", "this is a gzip file; make a zip"),
    (b"BZh", "this is a bzip2 file; make a zip"),
    (b"\xFD7zXZ", "this is an xz file; make a zip"),
    (b"\x28\xB5\x2F\xFD", "this is a zstd file; make a zip"),
    (b"\xFF\xD8\xFF", "this is a single JPEG; put all slices into one zip"),
    (b"\x89PNG", "this is a single PNG; put all slices into one zip"),
    (b"II*\0", "this is a single TIFF; put all slices into one zip, one file per slice"),
    (b"MM\0*", "this is a single TIFF; put all slices into one zip, one file per slice"),
];

/// The message for a file of `length` bytes that is not a complete zip; `None` when it ends like one. `head` holds its
/// first [`HEAD_BYTES`], `tail` its last [`END_RECORD_BYTES`], or all of a shorter file.
pub(super) fn diagnose(head: &[u8], tail: &[u8], length: u64) -> Option<String> {
    if length == 0 {
        return Some("the upload is empty (0 bytes); send the zip as the body".into());
    }
    if let Some(at) = tail.windows(4).rposition(|window| window == b"PK\x05\x06") {
        let missing = missing_start(&tail[at..], length - (tail.len() - at) as u64)?;
        return (!head.starts_with(b"PK")).then(|| {
            format!(
                "the first {missing} bytes of the zip are missing: is this the last part of a split zip (.zip.002, \
                 .zip.003)? Join the parts or make one zip, and send that"
            )
        });
    }
    if head.starts_with(b"PK\x07\x08") {
        return Some("this is the first part of a split zip (.z01); make one zip, however large, and send that".into());
    }
    if head.starts_with(b"PK") {
        return Some(match lost_line_ends(head) {
            true => LOST_LINE_ENDS.into(),
            false => {
                "the zip ends early, before its directory: was the upload cut off, or is this one part of a split zip \
                      (.zip.001)? Send the complete zip as one file"
                    .into()
            }
        });
    }
    if head.get(257..262) == Some(b"ustar") {
        return Some("this is a tar archive; make a zip".into());
    }
    if let Some((_, sentence)) = OTHERS.iter().find(|(start, _)| head.starts_with(start)) {
        return Some((*sentence).into());
    }
    Some(text(head, length).unwrap_or_else(|| {
        let start: Vec<String> = head.iter().take(8).map(|byte| format!("{byte:02X}")).collect();
        format!("this is not a zip: it begins with the bytes {}; a zip begins with 50 4B", start.join(" "))
    }))
}

/// The number of bytes missing before a directory that ends at `end`, according to its end record; `None` for zero.
fn missing_start(record: &[u8], end: u64) -> Option<u64> {
    let number = |at: usize| Some(u32::from_le_bytes(record.get(at..at + 4)?.try_into().ok()?));
    let (length, offset) = (number(12)?, number(16)?);
    // zip64 stores it elsewhere
    if length == u32::MAX || offset == u32::MAX {
        return None;
    }
    (u64::from(length) + u64::from(offset)).checked_sub(end).filter(|missing| *missing > 0)
}

/// True when a zip that begins with `head` has lost its line ends.
pub(super) fn lost_line_ends(head: &[u8]) -> bool {
    let no_line_ends = head.len() >= TELLING_BYTES && !head.iter().any(|byte| matches!(byte, b'\n' | b'\r'));
    // some bytes of the first header are always zero
    let no_zeros = head.starts_with(b"PK") && head.len() >= 30 && !head[4..30].contains(&0);
    no_line_ends || no_zeros
}

/// The message for text that was sent instead of a zip; `None` for binary data.
fn text(head: &[u8], length: u64) -> Option<String> {
    const SHOWN: usize = 40;
    let start = &head[..head.len().min(512)];
    let end = match std::str::from_utf8(start) {
        Ok(text) => text,
        // the last character may be truncated
        Err(error) if error.valid_up_to() + 4 > start.len() => {
            std::str::from_utf8(&start[..error.valid_up_to()]).ok()?
        }
        Err(_) => return None,
    };
    if end.chars().any(|c| c.is_control() && !matches!(c, '\n' | '\r' | '\t' | '\u{FEFF}')) {
        return None;
    }
    let plain = end.trim_start_matches('\u{FEFF}').trim();
    let shown: String = plain.chars().take(SHOWN).map(|c| if c.is_control() { ' ' } else { c }).collect();
    let small = plain.to_lowercase();
    Some(if length < 512 && small.ends_with(".zip") {
        format!(
            "this is the text {shown:?}, not the file of that name; with curl use -T stack.zip, or --data-binary \
             @stack.zip with the @"
        )
    } else if small.starts_with("<!doctype html") || small.starts_with("<html") {
        format!("this is a web page, not a zip (it begins with {shown:?}); was an error page saved instead of the zip?")
    } else if small.starts_with("--") && small.contains("content-disposition") {
        "this is a form, not a zip; send it with its Content-Type (multipart/form-data; boundary=...)".into()
    } else {
        format!("this is text, not a zip (it begins with {shown:?}); send the zip itself as the body")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(bytes: &[u8]) -> String {
        diagnose(bytes, bytes, bytes.len() as u64).unwrap_or_default()
    }

    #[test]
    fn every_kind_is_recognised() {
        let mut tar = vec![0; 512];
        tar[..5].copy_from_slice(b"a.jpg");
        tar[257..262].copy_from_slice(b"ustar");
        for (bytes, expected) in [
            (&b""[..], "empty"),
            (&tar, "tar archive"),
            (b"BZh91AY", "bzip2"),
            (b"\x89PNG\r\n", "single PNG"),
            (b"<!DOCTYPE html><title>403", "web page"),
            (b"{\"error\": 1}", "begins with \"{"),
            (b"stack.zip", "@stack.zip"),
            (b"--x\r\nContent-Disposition: form-data", "form"),
            (b"PK\x07\x08PK\x03\x04", ".z01"),
            (b"PK\x03\x04\x14\0\0\0", ".zip.001"),
            (b"\0\x01\x02\xFF", "00 01 02 FF"),
        ] {
            assert!(message(bytes).contains(expected), "{:?} lacks {expected:?}", message(bytes));
        }
    }

    #[test]
    fn a_zip_without_line_ends_was_sent_by_curl_d() {
        let noise = (0..4_000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8);
        let mut zip = b"PK\x03\x04\x14\0\0\0".to_vec();
        zip.extend(noise);
        assert!(message(&zip).contains("ends early"));
        zip.retain(|byte| !matches!(byte, 0 | b'\n' | b'\r'));
        assert_eq!(message(&zip), LOST_LINE_ENDS);
    }

    #[test]
    fn the_last_part_of_a_split_zip_lacks_its_start() {
        let mut end = b"PK\x05\x06\0\0\0\0\x01\0\x01\0".to_vec();
        end.extend(100u32.to_le_bytes());
        end.extend(5_000u32.to_le_bytes());
        end.extend([0, 0]);
        let part = [&[7; 300][..], &end].concat();
        assert!(message(&part).contains("the first 4800 bytes of the zip are missing"), "{}", message(&part));
    }
}
