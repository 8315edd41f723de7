//! Zips made byte by byte, so that they can be as wrong as they like.

/// One member, with everything that can be said wrongly about it.
#[derive(Clone)]
pub(super) struct Entry {
    pub name: Vec<u8>,
    pub data: Vec<u8>,
    pub method: u16,
    pub flags: u16,
    pub crc: Option<u32>,
    /// Size unpacked, as declared.
    pub size: Option<u32>,
    /// Unix mode.
    pub mode: u32,
    /// Take the local header of this earlier entry.
    pub same_as: Option<usize>,
}

pub(super) fn entry(name: &str, data: &[u8]) -> Entry {
    Entry {
        name: name.as_bytes().to_vec(),
        data: data.to_vec(),
        method: 0,
        flags: 0,
        crc: None,
        size: None,
        mode: 0o100_644,
        same_as: None,
    }
}

/// The entry compressed by deflate in stored blocks, which are the same in deflate64.
pub(super) fn deflated(mut entry: Entry, method: u16) -> Entry {
    entry.crc = entry.crc.or(Some(crc32(&entry.data)));
    entry.size = entry.size.or(Some(entry.data.len() as u32));
    let blocks: Vec<&[u8]> = entry.data.chunks(60_000).collect();
    let mut out = Vec::new();
    for (i, block) in blocks.iter().enumerate() {
        out.push(u8::from(i + 1 == blocks.len()));
        out.extend((block.len() as u16).to_le_bytes());
        out.extend((!(block.len() as u16)).to_le_bytes());
        out.extend(*block);
    }
    entry.data = out;
    entry.method = method;
    entry
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 })
    })
}

pub(super) fn zip(entries: &[Entry]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut offsets = Vec::new();
    let fields = |e: &Entry| {
        let mut f = Vec::new();
        f.extend(20u16.to_le_bytes());
        f.extend(e.flags.to_le_bytes());
        f.extend(e.method.to_le_bytes());
        f.extend([0, 0, 0x21, 0]);
        f.extend(e.crc.unwrap_or_else(|| crc32(&e.data)).to_le_bytes());
        f.extend((e.data.len() as u32).to_le_bytes());
        f.extend(e.size.unwrap_or(e.data.len() as u32).to_le_bytes());
        f.extend((e.name.len() as u16).to_le_bytes());
        f.extend([0, 0]);
        f
    };
    for e in entries {
        if let Some(earlier) = e.same_as {
            offsets.push(offsets[earlier]);
            continue;
        }
        offsets.push(out.len() as u32);
        out.extend(b"PK\x03\x04");
        out.extend(fields(e));
        out.extend(&e.name);
        out.extend(&e.data);
    }
    let directory = out.len() as u32;
    for (e, offset) in entries.iter().zip(&offsets) {
        out.extend(b"PK\x01\x02");
        out.extend([20, 3]);
        out.extend(fields(e));
        out.extend([0; 6]);
        out.extend((e.mode << 16).to_le_bytes());
        out.extend(offset.to_le_bytes());
        out.extend(&e.name);
    }
    let size = out.len() as u32 - directory;
    out.extend(b"PK\x05\x06\0\0\0\0");
    out.extend((entries.len() as u16).to_le_bytes());
    out.extend((entries.len() as u16).to_le_bytes());
    out.extend(size.to_le_bytes());
    out.extend(directory.to_le_bytes());
    out.extend([0, 0]);
    out
}
