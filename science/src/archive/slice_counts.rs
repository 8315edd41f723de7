//! Checks the number of slices and the size of their files.

use super::{
    Light, copies, further_lights,
    messages::{listed, slices_of},
    numbering_gaps,
    slices::ArchivedSlices,
};
use crate::types::{
    Error, ErrorKind,
    stack_layout::{FurtherLight, StackLayout},
};

/// Bytes that a file may have besides its pixels: metadata, previews, padding.
const BESIDE_PIXELS: u64 = 64 << 20;
/// Uncompressed 16-bit RGBA has 8 bytes per pixel; as much again for layers and masks that programs store.
const BYTES_PER_PIXEL: u64 = 16;

/// Refuses files that are larger than any picture of `pixels` pixels needs, because a job holds files in memory.
/// Returns the size of the largest file, bytes.
pub(super) fn refuse_large<'a>(all: impl Iterator<Item = &'a ArchivedSlices>, pixels: u64) -> Result<u64, Error> {
    let most = BESIDE_PIXELS.saturating_add(pixels.saturating_mul(BYTES_PER_PIXEL));
    let largest = all.filter_map(ArchivedSlices::largest).max_by_key(|(_, size)| *size);
    let Some((name, size)) = largest else { return Ok(0) };
    if size > most {
        let detail = format!(
            "{name} has {size} bytes uncompressed; a file with {pixels} pixels may have {most} (64 MiB and 16 bytes per \
             pixel): save it again without layers, previews and comments"
        );
        return Err(Error::new(ErrorKind::ArchiveTooLarge, detail).in_file(name, None));
    }
    Ok(size)
}

/// Refuses a stack of one slice, and lights with different numbers of slices.
pub(super) fn refuse(layout: &StackLayout) -> Result<(), Error> {
    let (front, back) = (layout.front.len(), layout.back.len());
    let mismatch = |detail: String| Err(Error::new(ErrorKind::SliceCountMismatch, detail));
    if front < 2 {
        return mismatch(format!(
            "the zip has 1 front-light slice ({}); a focus stack has at least 2: add the others",
            listed(layout.front.iter().map(String::as_str))
        ));
    }
    if back != 0 && back != front {
        let detail = format!(
            "the zip has {} and {}; both must be taken at the same rail positions{}",
            slices_of(front, Light::Front),
            slices_of(back, Light::Back),
            missing_slices((&layout.front, "front-light"), (&layout.back, "back-light"))
        );
        let copies = [&layout.front, &layout.back].into_iter().flat_map(|names| copies::copies(names));
        let error = Error::new(ErrorKind::SliceCountMismatch, detail);
        return Err(copies.fold(error, |error, copy| error.in_file(copy, None)));
    }
    for FurtherLight { name, slices } in &layout.lights {
        let why = missing_slices((&layout.front, "front-light"), (slices, name));
        further_lights::refuse_count((name, slices), &layout.front, &why)?;
    }
    Ok(())
}

/// Which slices of two lights, each with its word, are copies, which have no counterpart in the other light, or where
/// the numbering has a gap, judged by the names.
fn missing_slices(one: (&[String], &str), other: (&[String], &str)) -> String {
    let copied = [one.0, other.0].into_iter().find_map(copies::copied);
    if let Some(copied) = copied {
        return format!(": {copied}");
    }
    let lights = [(one.0, other.0, other.1), (other.0, one.0, one.1)];
    for (these, others, lacking) in lights {
        let alone = numbering_gaps::unmatched(these, others);
        if !alone.is_empty() {
            let names = listed(alone);
            return format!(": there is no {lacking} slice for {names}");
        }
    }
    let skipped = lights.iter().find_map(|(these, ..)| numbering_gaps::skipped(these));
    skipped.map_or(String::new(), |skipped| format!(": {skipped}"))
}
