//! What the options of a stack request of the science.

use std::sync::Arc;

use crate::contract::{
    input::SliceOrder,
    options::{LateralColourMode, StackOptions},
    outcome::HeightInfo,
};
use pinstack_science::{
    archive::{self, ArchiveLimits, StackArchive},
    fusion::{
        Plan,
        height::{HeightMap, INVALID},
    },
    imaging::Slices,
    quality,
    segmentation::MaskParams,
    types::{Control, Error, ErrorKind, Interrupted, ReadAt, fusion_options::GuidedParams, profile::ProfileInput},
};

/// Slices that the order in a refusal names, at most.
const MOST_NAMED: usize = 60;

/// The archive with its slices in the order of fusion.
///
/// # Errors
/// As [`archive::open_shared`].
pub(super) fn archive(
    zip: Arc<dyn ReadAt>,
    options: &StackOptions,
    limits: &ArchiveLimits,
) -> Result<StackArchive, Error> {
    Ok(in_order(archive::open_shared(zip, limits)?, options))
}

/// As [`archive()`]; where names and times of capture disagree, the pictures are asked, for which every slice is
/// decoded once more.
///
/// # Errors
/// As [`archive()`]. [`ErrorKind::InvalidArchive`] when the pictures agree with the witness that was overruled.
pub(super) fn checked_archive(
    zip: Arc<dyn ReadAt>,
    options: &StackOptions,
    limits: &ArchiveLimits,
    control: &dyn Control,
) -> Result<StackArchive, Interrupted> {
    let archive = archive::open_shared(zip, limits)?;
    if let Some(order) = archive.overruled_order()
        && quality::focus_prefers(archive.front(), order, control)?
    {
        let more = (order.len() > MOST_NAMED).then_some("...");
        let names = order.iter().take(MOST_NAMED).map(|&at| archive.front().name(at)).chain(more);
        let detail = format!(
            "the names and the EXIF times of the slices disagree on their order, and by their focus this order is right: \
             {}; rename the files, or list them in manifest.json, and send the stack again",
            names.collect::<Vec<_>>().join(", ")
        );
        return Err(Error::new(ErrorKind::InvalidArchive, detail).into());
    }
    Ok(in_order(archive, options))
}

fn in_order(archive: StackArchive, options: &StackOptions) -> StackArchive {
    match options.order {
        SliceOrder::Name => archive,
        SliceOrder::Reverse => archive.reversed(),
    }
}

/// How a stack with these options is fused with the profile `profile`.
pub(super) fn plan(options: &StackOptions, profile: &ProfileInput) -> Plan {
    let &StackOptions { method, r1, eps1, r2, eps2, average, r_g, sigma_g, .. } = options;
    let plan = Plan::from_profile(profile, method, GuidedParams { r1, eps1, r2, eps2, average, r_g, sigma_g });
    match options.lateral_colour {
        LateralColourMode::Correct => plan,
        LateralColourMode::Keep => Plan { lateral_colour: None, ..plan },
    }
}

/// The parameters of the mask for a picture of `width` x `height` px.
pub fn mask_params(options: &StackOptions, width: usize, height: usize) -> MaskParams {
    let default = MaskParams::default_for(width, height);
    MaskParams {
        threshold: options.mask_threshold,
        min_blob_px: options.mask_min_blob_px.unwrap_or(default.min_blob_px),
        min_hole_px: options.mask_min_hole_px.unwrap_or(default.min_hole_px),
        edge: options.mask_edge,
    }
}

/// The description of `map`.
pub(super) fn height_info(map: &HeightMap) -> HeightInfo {
    let &HeightMap { unit, direction, offset, scale, median_sigma, valid_fraction, .. } = map;
    HeightInfo { unit, direction, offset, scale, invalid: INVALID, median_sigma, valid_fraction }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jobs::testkit::{stack, zip};
    use pinstack_science::imaging::{
        Raster,
        codec::{Metadata, encode_png},
    };
    use pinstack_science::types::{Cancelled, NoControl};

    /// A PNG with the EXIF time of capture `10:00:{second}`.
    fn taken_at(picture: &Raster, second: usize) -> Vec<u8> {
        let mut block = b"II*\0\x08\0\0\0\x01\0\x69\x87\x04\0\x01\0\0\0\x1A\0\0\0\0\0\0\0".to_vec();
        block.extend(b"\x01\0\x03\x90\x02\0\x14\0\0\0\x2C\0\0\0\0\0\0\0");
        block.extend(format!("2026:05:01 10:00:{second:02}\0").bytes());
        let mut out = Vec::new();
        encode_png(&mut out, picture, &Metadata { icc: None, exif: Some(block) }).expect("encode");
        out
    }

    /// The zip of slices named `s0`, `s1`, ..., each a picture of the stack and its time.
    fn zipped(slices: [(usize, usize); 5]) -> Arc<dyn ReadAt> {
        let member = |(at, &(picture, second)): (usize, &(usize, usize))| {
            (format!("s{at}.png"), taken_at(&stack().front[picture], second))
        };
        Arc::new(zip(slices.iter().enumerate().map(member).collect()))
    }

    fn opened(slices: [(usize, usize); 5]) -> Result<StackArchive, Interrupted> {
        checked_archive(zipped(slices), &StackOptions::default(), &ArchiveLimits::default(), &NoControl)
    }

    #[test]
    fn names_that_times_and_pictures_contradict_are_refused_before_fusion() {
        let wrong = [(0, 10), (3, 13), (2, 12), (1, 11), (4, 14)];
        let Some(Interrupted::Failed(fault)) = opened(wrong).err() else {
            panic!("two witnesses contradict the names")
        };
        assert_eq!(fault.kind, ErrorKind::InvalidArchive);
        assert!(fault.detail.contains("right: s0.png, s3.png, s2.png, s1.png, s4.png; rename"), "{}", fault.detail);
    }

    #[test]
    fn asking_the_pictures_can_be_cancelled_and_is_not_done_to_show_one_slice() {
        struct Stopped;
        impl Control for Stopped {
            fn progress(&self, _: &'static str, _: usize, _: usize) {}
            fn check(&self) -> Result<(), Cancelled> {
                Err(Cancelled)
            }
        }
        let (wrong, options) = (zipped([(0, 10), (3, 13), (2, 12), (1, 11), (4, 14)]), StackOptions::default());
        let limits = ArchiveLimits::default();
        let stopped = checked_archive(Arc::clone(&wrong), &options, &limits, &Stopped).err();
        assert_eq!(stopped, Some(Interrupted::Cancelled(Cancelled)));
        assert_eq!(archive(wrong, &options, &limits).expect("no picture is read").layout().front.len(), 5);
    }

    #[test]
    fn names_that_the_pictures_confirm_are_used_whatever_the_times_say() {
        let retaken = [(0, 10), (1, 19), (2, 12), (3, 13), (4, 14)];
        let archive = opened(retaken).expect("the pictures are in order");
        assert_eq!(archive.warnings()[0].code, "order_contradicts_times");
        assert_eq!(archive.layout().front[1], "s1.png");
        let in_order = [(0, 10), (1, 11), (2, 12), (3, 13), (4, 14)];
        assert_eq!(opened(in_order).expect("in order").warnings(), []);
    }
}
