use super::*;
use crate::{
    imaging::Rect,
    quality::slice::{Brightness, Fingerprint, RowMeasurements, SliceMeter, WarpedSlice},
};

const WIDTH: usize = 160;
const HEIGHT: usize = 120;

/// A stack of saliencies alone: an object of known depth, and slices at known focus positions.
struct Stack {
    /// Focus positions of the slices.
    places: Vec<f32>,
    /// Depth of the object at (x, y), on the same scale; none without texture.
    depth: fn(usize, usize) -> Option<f32>,
    /// Defocus at which the saliency is halved, on the same scale.
    half_width: f32,
    object: Option<Plane<u8>>,
}

impl Stack {
    /// Nine slices over an object whose depth runs from 0.5 to 7.5.
    fn good() -> Self {
        let depth = |x: usize, _| Some(0.5 + 7.0 * x as f32 / WIDTH as f32);
        Self { places: (0..9).map(|n| n as f32).collect(), depth, half_width: 1.0, object: None }
    }

    /// Saliency: noise of about 3, and texture that fades with defocus.
    fn saliency(&self, n: usize, x: usize, y: usize) -> f32 {
        let scatter = ((x * 7919 + y * 104_729 + n * 1_299_709) % 997) as f32 / 997.0 - 0.5;
        let texture = 20.0 + ((x * 31 + y * 57) % 41) as f32;
        let sharp = |depth: f32| texture / (1.0 + ((self.places[n] - depth) / self.half_width).powi(2));
        3.0 + scatter + (self.depth)(x, y).map_or(0.0, sharp)
    }

    fn measured(&self) -> DepthCoverage {
        let slices = self.places.len();
        let planes: Vec<Plane<f32>> =
            (0..slices).map(|n| Plane::from_fn(WIDTH, HEIGHT, |x, y| self.saliency(n, x, y))).collect();
        let index = Plane::from_fn(WIDTH, HEIGHT, |x, y| {
            let higher = |best: usize, n: usize| if planes[n].at(x, y) > planes[best].at(x, y) { n } else { best };
            (1..slices).fold(0, higher) as u16
        });
        measure_planes(&planes, &index, self.object.as_ref())
    }
}

/// Depth coverage of slices whose saliency is given for every pixel.
fn measure_planes(saliency: &[Plane<f32>], index: &Plane<u16>, object: Option<&Plane<u8>>) -> DepthCoverage {
    let meter = SliceMeter::new(WIDTH, HEIGHT, saliency.len(), saliency.len() / 2, object);
    let read = |rect: Rect| Ok(vec![100u8; rect.width * rect.height]);
    let everywhere = crate::imaging::Coverage::full(WIDTH, HEIGHT);
    let measured = |(n, plane): (usize, &Plane<f32>)| {
        let mut rows = RowMeasurements::default();
        (0..HEIGHT).for_each(|y| rows.take_saliency(&meter, y, plane.row(y), &(0..WIDTH)));
        let slice = WarpedSlice { samples: &read, channels: 1, coverage: &everywhere, gain: 1.0 };
        meter.measure(n, &slice, rows, Brightness::default(), Fingerprint::default()).expect("it can be read")
    };
    let measurements: Vec<SliceMeasurements> = saliency.iter().enumerate().map(measured).collect();
    measure(&measurements, meter.points(), &DecisionMap { index, refined: false }, object.is_some())
}

#[test]
fn a_good_stack_has_no_fault() {
    let DepthCoverage { metrics, contribution, .. } = Stack::good().measured();
    assert_eq!(metrics.textured_fraction, Some(1.0));
    assert_eq!(metrics.unfocused_fraction, None);
    assert_eq!((metrics.range_too_short_near, metrics.range_too_short_far), (Some(false), Some(false)));
    assert_eq!((metrics.redundant_slices, metrics.coverage_gaps), (vec![], vec![]));
    let sum: f64 = contribution.iter().map(|share| share.unwrap()).sum();
    assert!((sum - 1.0).abs() < 1e-9);
}

#[test]
fn an_object_that_extends_before_the_first_slice_is_reported() {
    let near = Stack { depth: |x, _| Some(-3.0 + 10.0 * x as f32 / WIDTH as f32), ..Stack::good() };
    let metrics = near.measured().metrics;
    assert_eq!((metrics.range_too_short_near, metrics.range_too_short_far), (Some(true), Some(false)));
}

#[test]
fn an_object_that_extends_behind_the_last_slice_is_reported() {
    let far = Stack { depth: |x, _| Some(1.0 + 10.0 * x as f32 / WIDTH as f32), ..Stack::good() };
    let metrics = far.measured().metrics;
    assert_eq!((metrics.range_too_short_near, metrics.range_too_short_far), (Some(false), Some(true)));
}

#[test]
fn an_object_that_ends_in_focus_in_the_end_slices_is_covered() {
    let exact = Stack { depth: |x, _| Some((8.0 * x as f32 / WIDTH as f32).round()), ..Stack::good() };
    for half_width in [0.4, 1.0, 3.0] {
        let metrics = Stack { half_width, ..Stack { places: exact.places.clone(), ..Stack::good() } };
        let metrics = Stack { depth: exact.depth, ..metrics }.measured().metrics;
        let found = (metrics.range_too_short_near, metrics.range_too_short_far);
        assert_eq!(found, (Some(false), Some(false)), "half width {half_width}");
    }
}

#[test]
fn a_slice_at_a_depth_without_texture_is_redundant() {
    // two parts, and no texture between the depths 3.2 and 5.7
    let parts = |x: usize, _| Some(if x < 80 { 0.5 + x as f32 / 30.0 } else { 5.7 + (x - 80) as f32 / 50.0 });
    let metrics = Stack { depth: parts, half_width: 0.8, ..Stack::good() }.measured().metrics;
    assert_eq!(metrics.redundant_slices, [4, 5]);
}

#[test]
fn a_step_that_is_too_large_is_a_gap() {
    let places = vec![0.0, 1.0, 2.0, 6.0, 7.0, 8.0];
    let metrics = Stack { places, ..Stack::good() }.measured().metrics;
    assert_eq!(metrics.coverage_gaps, [2]);
    let coarse = Stack { half_width: 0.4, ..Stack::good() }.measured().metrics;
    // the object starts and ends half a step inside: nothing is lost before slice 1 and behind slice 7
    assert_eq!(coarse.coverage_gaps, [1, 2, 3, 4, 5, 6]);
}

#[test]
fn smooth_parts_of_the_object_are_unfocused() {
    let object = Plane::from_fn(WIDTH, HEIGHT, |x, _| if x >= 40 { 255u8 } else { 0 });
    let depth = |x: usize, y: usize| (y >= HEIGHT / 4 && x >= 40).then_some(0.5 + 7.0 * x as f32 / WIDTH as f32);
    let masked = Stack { depth, object: Some(object), ..Stack::good() };
    let metrics = masked.measured().metrics;
    assert!((metrics.unfocused_fraction.unwrap() - 0.25).abs() < 0.02, "{metrics:?}");
    assert!((metrics.textured_fraction.unwrap() - 0.75).abs() < 0.02, "{metrics:?}");
    let all = Stack { object: None, ..masked }.measured().metrics;
    assert!((all.textured_fraction.unwrap() - 0.75 * 0.75).abs() < 0.02, "{all:?}");
    assert_eq!(all.unfocused_fraction, None);
}

#[test]
fn noise_alone_is_not_texture_and_says_nothing_about_slices() {
    let DepthCoverage { metrics, contribution, .. } = Stack { depth: |_, _| None, ..Stack::good() }.measured();
    assert_eq!(metrics.textured_fraction, Some(0.0));
    assert_eq!((metrics.range_too_short_near, metrics.range_too_short_far), (None, None));
    assert_eq!((metrics.redundant_slices, metrics.coverage_gaps), (vec![], vec![]));
    assert_eq!(contribution, vec![None; 9]);
}

#[test]
fn two_slices_do_not_show_where_the_object_ends() {
    let metrics = Stack { places: vec![0.0, 1.0], ..Stack::good() }.measured().metrics;
    assert_eq!((metrics.range_too_short_near, metrics.range_too_short_far), (None, None));
}

#[test]
fn no_slices_or_no_covered_pixels_give_no_numbers() {
    let index = Plane::filled(WIDTH, HEIGHT, u16::MAX);
    assert_eq!(measure_planes(&[], &index, None), DepthCoverage::default());
    let found = measure_planes(&[Plane::filled(WIDTH, HEIGHT, f32::NAN)], &index, None);
    assert_eq!((found.metrics, found.contribution), (FocusMetrics::default(), vec![None]));
}
