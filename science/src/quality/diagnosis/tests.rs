use super::*;
use crate::{
    quality::flicker,
    types::metrics::{AlignmentMetrics, ResidualSimilarity, SliceMetrics},
};

/// The similarity of a profile that fits.
const NO_DRIFT: ResidualSimilarity = ResidualSimilarity {
    scale: 1.0,
    rotation_deg: 0.0,
    shift_px: [0.0; 2],
    corner_drift_px: 0.0,
    corner_drift_sigma_px: 0.1,
    shifts: 100,
};

/// The metrics and the evidence of a stack without a fault, in which a test changes what it is about.
struct Stack {
    quality: StackQuality,
    own: Vec<Option<OwnShift>>,
    foreign: Vec<u32>,
    steps: Vec<Option<f32>>,
    equalised: Vec<Option<f64>>,
    reference: usize,
    has_gains: bool,
    masked: bool,
}

impl Stack {
    /// The reference slice is the middle one.
    fn of(slices: usize) -> Self {
        let metrics = |n: usize| SliceMetrics {
            index: n as u32,
            balance_ratio: Some([1.0; 2]),
            contribution: Some(1.0 / slices as f64),
            ..SliceMetrics::default()
        };
        Self {
            quality: StackQuality {
                slices: (0..slices).map(metrics).collect(),
                alignment: AlignmentMetrics { similarity: Some(NO_DRIFT), ..AlignmentMetrics::default() },
                ..StackQuality::default()
            },
            own: vec![Some(OwnShift { shift: (0.0, 0.0), sigma: 0.05 }); slices - 1],
            foreign: Vec::new(),
            steps: vec![Some(1.0); slices - 1],
            equalised: vec![Some(1.0); slices],
            reference: slices / 2,
            has_gains: true,
            masked: true,
        }
    }

    /// The brightness of each slice after the gains, on any scale.
    fn with_brightness(mut self, of: impl Fn(usize) -> f64) -> Self {
        let of_reference = of(self.reference);
        self.equalised = (0..self.quality.slices.len()).map(|n| Some(of(n) / of_reference)).collect();
        let flicker = flicker::ratios(&self.equalised);
        self.quality.slices.iter_mut().zip(flicker).for_each(|(slice, ratio)| slice.flicker_ratio = ratio);
        self
    }

    /// Red over green of each slice, on any scale.
    fn with_red(mut self, of: impl Fn(usize) -> f64) -> Self {
        let of_reference = of(self.reference);
        let slices = self.quality.slices.iter_mut().enumerate();
        slices.for_each(|(n, slice)| slice.balance_ratio = Some([of(n) / of_reference, 1.0]));
        self
    }

    fn findings(&self) -> Vec<Finding> {
        let evidence = Evidence {
            own: &self.own,
            foreign: &self.foreign,
            steps: &self.steps,
            equalised: &self.equalised,
            reference: self.reference,
            has_gains: self.has_gains,
            masked: self.masked,
            reversed: false,
            canvas: (6000, 4000),
        };
        diagnose(&self.quality, &evidence)
    }

    /// The slices and the sentence of the only finding, which must have this code.
    fn only(&self, code: &str) -> (Vec<u32>, String) {
        let found = self.findings();
        assert!(found.len() == 1 && found[0].code == code, "{code}: {found:?}");
        (found[0].slices.clone(), found[0].detail.clone())
    }
}

#[test]
fn a_stack_without_a_fault_has_no_finding() {
    assert_eq!(Stack::of(9).findings(), []);
}

#[test]
fn an_alignment_that_could_not_be_measured_is_said() {
    let mut stack = Stack::of(9);
    stack.quality.alignment.similarity = None;
    let (_, detail) = stack.only("alignment_not_measured");
    assert!(detail.starts_with("whether the profile fits this stack could not be measured"), "{detail}");
    // without texture there is nothing to align
    stack.quality.focus.textured_fraction = Some(0.001);
    stack.only("little_texture");
    let mut single = Stack::of(1);
    single.quality.alignment.similarity = None;
    assert_eq!(single.findings(), []);
}

#[test]
fn a_slice_of_another_view_explains_what_focus_shows() {
    let mut stack = Stack::of(9);
    stack.foreign = vec![4];
    stack.quality.focus.coverage_gaps = vec![3, 4];
    stack.quality.focus.order = Some(vec![0, 1, 2, 3, 5, 4, 6, 7, 8]);
    let (slices, detail) = stack.only("foreign_slice");
    assert!(slices == [4] && detail.starts_with("slice 4 shows something else than the slices around"), "{detail}");
}

#[test]
fn a_flash_on_the_reference_slice_is_no_drift_of_the_others() {
    for flash in [4, 2] {
        let stack = Stack::of(9).with_brightness(|n| if n == flash { 1.08 } else { 1.0 });
        let found = stack.only("exposure_flicker");
        assert_eq!(found.0, [flash as u32], "{found:?}");
        // a drift beside it is found too
        let drift = |n: usize| 1.0 + 0.03 * (n as f64 - 4.0);
        let both = Stack::of(9).with_brightness(|n| drift(n) * if n == flash { 1.08 } else { 1.0 });
        let codes: Vec<String> = both.findings().into_iter().map(|finding| finding.code.to_string()).collect();
        assert_eq!(codes, ["exposure_flicker", "exposure_drift"], "flash at {flash}");
    }
}

#[test]
fn a_drift_of_few_slices_is_not_called_flicker() {
    let drifting = |slices: usize| Stack::of(slices).with_brightness(|n| 1.0 - 0.05 * n as f64);
    for slices in [3, 4, 5, 9] {
        let (_, detail) = drifting(slices).only("exposure_drift");
        assert!(detail.starts_with("after the gains of the profile the brightness still differs"), "{detail}");
        // with fewer than six slices nothing tells one from the other
        assert_eq!(detail.contains("if the light flickers instead"), slices < 6, "{slices}: {detail}");
    }
    let (_, detail) = Stack { has_gains: false, ..drifting(9) }.only("exposure_drift");
    assert!(detail.starts_with("the profile has no gains") && detail.contains("add gains"), "{detail}");
    assert!(!detail.contains("gains fit"), "{detail}");
}

#[test]
fn a_colour_that_only_the_reference_slice_has_is_its_own_fault() {
    for (slices, faulty) in [(9, 4), (9, 7), (3, 1), (3, 2)] {
        let stack = Stack::of(slices).with_red(|n| if n == faulty { 1.05 } else { 1.0 });
        assert_eq!(stack.only("white_balance_drift").0, [faulty as u32], "slice {faulty} of {slices}");
    }
    // a steady drift from the reference slice on
    let drifting = Stack { reference: 0, ..Stack::of(9) }.with_red(|n| 1.0 + 0.011 * n as f64);
    let (slices, detail) = drifting.only("white_balance_drift");
    assert!(slices == [3, 4, 5, 6, 7, 8] && detail.contains("that of the reference slice"), "{slices:?}: {detail}");
}

#[test]
fn both_slices_of_a_step_are_listed() {
    let mut stack = Stack::of(12);
    stack.quality.focus.coverage_gaps = vec![2, 3];
    let (slices, detail) = stack.only("coverage_gap");
    assert!(slices == [2, 3, 4] && detail.contains("between slices 2 and 3, 3 and 4"), "{slices:?}: {detail}");

    let mut stack = Stack::of(12);
    (stack.steps[6], stack.steps[9]) = (Some(1.8), Some(2.4));
    stack.quality.focus.uneven_steps = vec![6];
    let (slices, detail) = stack.only("uneven_step");
    assert!(slices == [6, 7] && detail.contains("about 1.8 times as far") && detail.contains("a slice is"), "{detail}");
    stack.quality.focus.uneven_steps = vec![6, 9];
    let (slices, detail) = stack.only("uneven_step");
    assert_eq!(slices, [6, 7, 9, 10]);
    assert!(detail.contains("up to 2.4 times as far") && detail.contains("slices are missing"), "{detail}");
}

#[test]
fn the_shift_of_a_displaced_slice_is_its_own() {
    let displaced = |slices: usize, pair: usize| {
        let mut stack = Stack::of(slices);
        stack.own[pair] = Some(OwnShift { shift: (4.0, -3.0), sigma: 0.05 });
        stack.only("slice_misaligned")
    };
    let (slices, detail) = displaced(7, 0);
    assert!(slices == [0] && detail.starts_with("slice 0 is shifted by 5.0 px (-4.0, +3.0)"), "{detail}");
    let (slices, detail) = displaced(7, 5);
    assert!(slices == [6] && detail.starts_with("slice 6 is shifted by 5.0 px (+4.0, -3.0)"), "{detail}");
    let (slices, detail) = displaced(3, 0);
    assert!(slices == [0, 1, 2] && detail.starts_with("one of the slices 0, 1 and 2 is shifted by about"), "{detail}");
}

#[test]
fn one_slice_out_of_order_is_spoken_of_in_the_singular() {
    let of = |order: &[u32]| {
        let mut stack = Stack::of(order.len());
        stack.quality.focus.order = Some(order.to_vec());
        stack.only("slices_out_of_order").1
    };
    let (one, two) = (of(&[0, 7, 1, 2, 3, 4, 5, 6]), of(&[0, 1, 4, 3, 2, 5]));
    assert!(
        one.starts_with("slice 7 is not in the order of focus: around it the") && one.contains("and it was"),
        "{one}"
    );
    assert!(two.starts_with("slices 2 and 4 are not") && two.contains("around them the"), "{two}");
    assert!(two.contains("and each was warped"), "{two}");
}

#[test]
fn a_range_that_is_too_short_names_the_share_of_the_end_slice() {
    let mut stack = Stack::of(9);
    stack.quality.slices[0].contribution = Some(0.123);
    stack.quality.slices[8].contribution = Some(0.045);
    stack.quality.focus.range_too_short_near = Some(true);
    let (slices, detail) = stack.only("range_too_short_near");
    assert!(slices == [0] && detail.contains("12.3 % of the textured pixels are taken from slice 0"), "{detail}");
    stack.quality.focus.range_too_short_near = Some(false);
    stack.quality.focus.range_too_short_far = Some(true);
    let (slices, detail) = stack.only("range_too_short_far");
    assert!(slices == [8] && detail.contains("4.5 % of the textured pixels are taken from slice 8"), "{detail}");
}

#[test]
fn shares_are_of_the_object_if_there_is_a_mask() {
    for (masked, whole) in [(true, "% of the object"), (false, "% of the image")] {
        let mut stack = Stack { masked, ..Stack::of(9) };
        stack.quality.fusion.clipped_fraction = Some(0.02);
        let (_, detail) = stack.only("clipped");
        assert!(detail.contains(whole) && detail.contains("black on purpose") != masked, "{detail}");
        stack.quality.fusion.clipped_fraction = Some(0.0);
        stack.quality.focus.textured_fraction = Some(0.001);
        let (_, detail) = stack.only("little_texture");
        assert!(detail.contains(whole), "{detail}");
    }
}
