//! How many slices there are and how large their files may be.

use super::{listed, numbering_gaps, slices::ArchivedSlices};
use crate::types::{Error, ErrorKind, stack_layout::StackLayout};

/// What the file of a slice may have beside its pixels: metadata, previews, padding.
const BESIDE_PIXELS: u64 = 64 << 20;
/// Uncompressed RGBA of 16 bits has 8 bytes per pixel; as much again for what programs keep beside it.
const BYTES_PER_PIXEL: u64 = 16;

/// Refuses files that are larger than any picture of so many pixels, because a job holds files in memory. Gives the
/// size of the largest.
pub(super) fn refuse_large(lights: [&ArchivedSlices; 2], pixels: u64) -> Result<u64, Error> {
    let most = BESIDE_PIXELS.saturating_add(pixels.saturating_mul(BYTES_PER_PIXEL));
    let largest = lights.into_iter().filter_map(ArchivedSlices::largest).max_by_key(|(_, size)| *size);
    let Some((name, size)) = largest else { return Ok(0) };
    if size > most {
        let detail = format!(
            "{name} has {size} bytes unpacked; at most {most} are read of a picture of {pixels} pixels (64 MiB and 16 \
             bytes per pixel): save it again without layers, previews and comments"
        );
        return Err(Error::new(ErrorKind::ArchiveTooLarge, detail).in_file(name, None));
    }
    Ok(size)
}

/// Refuses a single slice, and lights of different numbers of slices.
pub(super) fn refuse(layout: &StackLayout) -> Result<(), Error> {
    let (front, back) = (layout.front.len(), layout.back.len());
    let mismatch = |detail: String| Err(Error::new(ErrorKind::SliceCountMismatch, detail));
    if front < 2 {
        return mismatch(format!(
            "the zip has 1 front-light slice ({}); a focus stack has at least 2",
            listed(layout.front.iter().map(String::as_str))
        ));
    }
    if back != 0 && back != front {
        return mismatch(format!(
            "the zip has {front} front-light slices and {back} back-light slices; both must be taken at the same rail \
             positions{}",
            odd_ones(layout)
        ));
    }
    Ok(())
}

/// Which slices have no counterpart in the other light, or where the numbering skips one, as far as names tell.
fn odd_ones(layout: &StackLayout) -> String {
    let lights = [(&layout.front, &layout.back, "back"), (&layout.back, &layout.front, "front")];
    for (these, others, lacking) in lights {
        let alone = numbering_gaps::unmatched(these, others);
        if !alone.is_empty() {
            let names = listed(alone);
            return format!(": there is no {lacking}-light slice for {names}");
        }
    }
    let skipped = lights.iter().find_map(|(these, ..)| numbering_gaps::skipped(these));
    skipped.map_or(String::new(), |skipped| format!(": {skipped}"))
}
