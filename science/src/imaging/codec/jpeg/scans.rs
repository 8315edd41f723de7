//! The scans of a JPEG: where they are, and whether those of a progressive picture are all there.

use super::guarded::EOI;

/// Maximum number of scans. Each processes the whole picture, even if it has few bytes; ten are usual.
pub(super) const MAX_SCANS: usize = 100;

/// Marker of the header of a scan.
pub(super) const SOS: u8 = 0xDA;

/// The result of a walk along the markers.
pub(super) struct Walk<'a> {
    /// Offset of the end marker.
    pub(super) end: usize,
    /// The header of each scan.
    pub(super) scans: Vec<&'a [u8]>,
}

/// Walks to the end marker, or until there are too many scans; `None` when the file ends before that. Segments are
/// skipped, so that the end marker of a thumbnail is not mistaken for that of the picture.
pub(super) fn walk(bytes: &[u8]) -> Option<Walk<'_>> {
    let mut at = 2;
    let mut scans = Vec::new();
    loop {
        if !scans.is_empty() {
            at += bytes.get(at..)?.iter().position(|&b| b == 0xFF)?;
        }
        let marker = *bytes.get(at + 1)?;
        match marker {
            0xFF => at += 1,
            0 | 0x01 | 0xD0..=0xD7 => at += 2,
            EOI => return Some(Walk { end: at, scans }),
            _ => {
                let length = usize::from(u16::from_be_bytes([*bytes.get(at + 2)?, *bytes.get(at + 3)?]));
                if marker == SOS {
                    if scans.len() > MAX_SCANS {
                        return Some(Walk { end: at, scans });
                    }
                    scans.push(bytes.get(at + 4..at + 2 + length).unwrap_or_default());
                }
                at += 2 + length;
            }
        }
    }
}

/// Parameters of one scan of a progressive picture.
pub(super) struct Pass<'a> {
    /// Component identifiers, each followed by its tables.
    components: &'a [u8],
    /// First and last coefficient.
    band: std::ops::RangeInclusive<usize>,
    /// True when the scan refines known coefficients.
    pub(super) refines: bool,
    /// Low bits that are still missing after the scan.
    missing: u8,
}

impl<'a> Pass<'a> {
    pub(super) fn of(scan: &'a [u8]) -> Option<Self> {
        let (count, rest) = scan.split_first()?;
        let (components, rest) = rest.split_at_checked(usize::from(*count) * 2)?;
        let &[first, last, bits, ..] = rest else { return None };
        let band = usize::from(first)..=usize::from(last).min(63);
        Some(Self { components, band, refines: bits >> 4 != 0, missing: bits & 15 })
    }
}

/// True when the scans of a progressive picture give every coefficient of every component to its last bit. A file that
/// was cut between two scans and closed with an end marker is well-formed, but shows a coarse picture.
pub(super) fn is_complete(scans: &[&[u8]], components: &[u8]) -> bool {
    let mut missing = vec![[u8::MAX; 64]; components.len()];
    for pass in scans.iter().filter_map(|scan| Pass::of(scan)) {
        for id in pass.components.iter().step_by(2) {
            let Some(component) = components.iter().position(|known| known == id) else { continue };
            for coefficient in pass.band.clone() {
                missing[component][coefficient] = pass.missing;
            }
        }
    }
    missing.iter().flatten().all(|&bits| bits == 0)
}
