//! Stacks whose slices cover different parts of the canvas.

use super::*;
use pinstack_science::types::Homography;

#[test]
fn crop_valid_is_not_advised_for_a_stack_that_was_sent_with_it() {
    let note = |crop: Crop| {
        let mut job = TestJob::stack(&front_zip(), StackOptions { crop, ..options() });
        let homographies = &mut job.context.profile.as_mut().expect("a profile").input.homographies;
        homographies[0] = homographies[0].then(&Homography::similarity(1.0, [40.0, 0.0])).expect("it is regular");
        let mut findings = done(&job).1.metrics.findings.into_iter();
        findings.find(|finding| finding.code == "small_common_area").expect("slice 0 misses a sixth").detail
    };
    let (whole, cropped) = (note(Crop::None), note(Crop::Valid));
    assert!(whole.contains("or use crop=valid"), "{whole}");
    assert!(cropped.contains("crop=valid cuts off the rest") && !cropped.contains("use crop=valid"), "{cropped}");
}
