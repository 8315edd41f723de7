//! The pictures of a stack: format, depth, crop, alpha, and what is under it.

use super::*;

#[test]
fn a_soft_edge_is_in_the_image_and_the_mask_stays_hard() {
    let alphas = |edge: MaskEdge| {
        let job = TestJob::stack(&both_zip(), StackOptions { mask_edge: edge, ..options() });
        let (output, _) = done(&job);
        // slices have no alpha, so what decodes them does not show it
        let image = image::load_from_memory(&file(&output, "image").1).expect("a picture").into_rgba8();
        let alpha: Vec<u8> = image.pixels().map(|pixel| pixel.0[3]).collect();
        (alpha, grey(&picture(&output, "mask").1))
    };
    let ((hard, mask), (soft, same)) = (alphas(MaskEdge::Hard), alphas(MaskEdge::Soft));
    assert_eq!(mask, same);
    assert_eq!(hard, mask);
    assert!(soft.iter().zip(&mask).all(|(&soft, &mask)| (soft >= 128) == (mask == 255)));
    // nearer to what the object truly covers
    let off = |alpha: &[u8]| {
        let pairs = alpha.iter().zip(&stack().truth.cover.data);
        pairs.map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum::<f64>()
    };
    assert!(off(&soft) < 0.5 * off(&hard), "{} against {}", off(&soft), off(&hard));
}

#[test]
fn pixels_that_the_mask_hides_are_not_fused_and_all_others_are_as_without_it() {
    for mask_edge in [MaskEdge::Hard, MaskEdge::Soft] {
        let of = |under_alpha: UnderAlpha| {
            let job = TestJob::stack(&both_zip(), StackOptions { under_alpha, mask_edge, ..options() });
            let (output, outcome) = done(&job);
            (picture_of(&output), outcome.metrics.fusion.q_g_top.expect("measured"), outcome.metrics.focus)
        };
        let (whole, score, focus) = of(UnderAlpha::Keep);
        for under_alpha in [UnderAlpha::Black, UnderAlpha::Pad] {
            let (image, score_here, focus_here) = of(under_alpha);
            assert!(focus_here == focus && (score_here - score).abs() < 1e-5, "{under_alpha:?}");
            let mut visible = 0;
            for (pixel, whole) in image.chunks_exact(4).zip(whole.chunks_exact(4)) {
                assert_eq!(pixel[3], whole[3]);
                if pixel[3] != 0 {
                    assert_eq!(pixel, whole, "{under_alpha:?}, {mask_edge:?}");
                    visible += 1;
                }
            }
            assert!(visible > 1_000, "{visible} px");
        }
    }
}

#[test]
fn format_depth_and_crop_are_as_asked() {
    let crop = Crop::Rect { x: 20, y: 10, width: 100, height: 80 };
    let asked = StackOptions { format: ImageFormat::Tiff, bit_depth: BitDepth::Sixteen, crop, ..options() };
    let job = TestJob::stack(&both_zip(), StackOptions { under_alpha: UnderAlpha::Keep, ..asked });
    let (output, outcome) = done(&job);
    assert_eq!(
        outcome.image,
        ImageInfo { width: 100, height: 80, bit_depth: 16, crop_offset_px: [20, 10], intrinsics: None }
    );
    let (artifact, image) = picture(&output, "image");
    assert_eq!(artifact.media_type, "image/tiff");
    assert_eq!((image.width, image.height, image.depth()), (100, 80, pinstack_science::imaging::Depth::Sixteen));
    for name in ["mask", "backlight", "depth", "preview"] {
        let (artifact, picture) = picture(&output, name);
        let kind = if name == "preview" { "image/jpeg" } else { "image/png" };
        assert_eq!((picture.width, picture.height, artifact.media_type.as_str()), (100, 80, kind), "{name}");
    }
    // the crop moves nothing: the same pixels as without
    let whole = TestJob::stack(&both_zip(), options());
    let (uncropped, _) = done(&whole);
    let rect = Rect { x: 20, y: 10, width: 100, height: 80 };
    assert_eq!(picture(&output, "mask").1, picture(&uncropped, "mask").1.crop(rect));
    assert_eq!(picture(&output, "depth").1, picture(&uncropped, "depth").1.crop(rect));
}

#[test]
fn a_jpeg_has_the_colours_of_the_png_and_no_alpha() {
    let of = |format: ImageFormat, under_alpha: UnderAlpha| {
        let job = TestJob::stack(&both_zip(), StackOptions { format, under_alpha, ..options() });
        let (output, outcome) = done(&job);
        assert_eq!(outcome.image.bit_depth, 8);
        let (artifact, picture) = picture(&output, "image");
        (artifact.media_type.clone(), picture, grey(&self::picture(&output, "mask").1))
    };
    for under in [UnderAlpha::Black, UnderAlpha::Keep] {
        let (_, png, mask) = of(ImageFormat::Png, under);
        let (media_type, jpeg, same) = of(ImageFormat::Jpeg, under);
        assert_eq!((media_type.as_str(), jpeg.channels), ("image/jpeg", 3));
        assert_eq!(mask, same, "the mask is a file of its own");
        let (ours, theirs) = (jpeg.luma(), png.luma());
        let pairs = ours.data.iter().zip(&theirs.data);
        let mean: f64 = pairs.map(|(a, b)| f64::from((a - b).abs())).sum::<f64>() / ours.data.len() as f64;
        assert!(mean < 0.01 * 255.0, "{under:?}: off by {mean} on average");
        let outside = ours.data.iter().zip(&mask).filter(|(_, inside)| **inside == 0);
        let brightest = outside.map(|(value, _)| *value).fold(0.0, f32::max);
        assert_eq!(brightest < 40.0, under == UnderAlpha::Black, "{under:?}: {brightest} outside the object");
    }
}

#[test]
fn padding_continues_the_colours_of_the_object_beyond_its_outline_and_changes_no_other_pixel() {
    let of = |under_alpha: UnderAlpha| {
        let job = TestJob::stack(&both_zip(), StackOptions { under_alpha, ..options() });
        picture_of(&done(&job).0)
    };
    let (black, padded) = (of(UnderAlpha::Black), of(UnderAlpha::Pad));
    let changed = black.chunks_exact(4).zip(padded.chunks_exact(4)).filter(|(a, b)| a != b);
    let (mut count, mut hidden) = (0, 0);
    for (a, b) in changed {
        count += 1;
        hidden += usize::from(a == [0; 4] && b[3] == 0 && b != [0; 4]);
    }
    assert!(count > 500 && hidden == count, "{hidden} of {count} changed pixels were black and transparent");
}

/// The samples of the RGBA image, as stored in its PNG.
fn picture_of(output: &crate::jobs::JobOutput) -> Vec<u8> {
    let at = output.outcome.artifacts().iter().position(|artifact| artifact.name == "image").expect("an image");
    image::open(&output.files[at].path).expect("a picture").to_rgba8().into_raw()
}

#[test]
fn what_the_profile_knows_of_the_camera_stands_beside_the_image() {
    let crop = Crop::Rect { x: 20, y: 10, width: 100, height: 80 };
    let mut job = TestJob::stack(&front_zip(), StackOptions { crop, ..options() });
    let input = &mut job.context.profile.as_mut().expect("a profile").input;
    input.principal_distance_mm = Some(121.0);
    input.pupils.principal_distance_sigma_mm = Some(0.2);
    input.pixel_pitch_mm = Some(0.05);
    input.principal_point_px = Some([118.5, 91.0]);
    let (_, outcome) = done(&job);
    let expected = Intrinsics {
        principal_distance_px: 2420.0,
        principal_distance_mm: 121.0,
        principal_distance_sigma_mm: Some(0.2),
        pixel_pitch_mm: 0.05,
        principal_point_px: Some([98.5, 81.0]),
        distortion: None,
    };
    assert_eq!(outcome.image.intrinsics, Some(expected));
}
