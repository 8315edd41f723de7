use super::*;

const WIDTH: usize = 64;
const HEIGHT: usize = 48;

fn scene() -> Plane<u8> {
    Plane::from_fn(WIDTH, HEIGHT, |x, y| (60 + (x * 31 + y * 17) % 97) as u8)
}

/// Coverage of a slice that ends before column `columns`.
fn covered(columns: usize) -> Coverage {
    let shifted = crate::types::Homography::similarity(1.0, [(WIDTH - columns) as f64, 0.0]);
    Coverage::of(&shifted, (WIDTH, HEIGHT), WIDTH, HEIGHT)
}

fn meter(object: Option<&Plane<u8>>) -> SliceMeter<'_> {
    SliceMeter::new(WIDTH, HEIGHT, 2, 0, object)
}

/// Measures a slice of which all samples are given; its focus measure is 1 everywhere.
fn measure_samples<S: Sample>(
    meter: &SliceMeter<'_>,
    samples: &[S],
    channels: usize,
    coverage: &Coverage,
    gain: f64,
) -> SliceMeasurements {
    let (width, height) = (coverage.width(), coverage.height());
    let row_of = |y: usize, columns: Range<usize>| {
        &samples[(y * width + columns.start) * channels..(y * width + columns.end) * channels]
    };
    let read = |rect: Rect| {
        let rows = rect.y..rect.y + rect.height;
        Ok(rows.flat_map(|y| row_of(y, rect.x..rect.x + rect.width)).copied().collect())
    };
    let cells = Cells::of(width, height);
    let bands = [0..height / 3, height / 3..height].map(|band| {
        let mut rows = RowMeasurements::default();
        for y in band {
            rows.take_samples(cells, y, row_of(y, 0..width), channels, gain);
            rows.take_saliency(meter, y, &vec![1.0; width], &(0..width));
        }
        rows
    });
    let slice = WarpedSlice { samples: &read, channels, coverage, gain };
    let rows = RowMeasurements::join(bands.into());
    let brightness = rows.brightness::<S>(cells, coverage, channels, gain);
    meter.measure(1, &slice, rows, brightness, Fingerprint::default()).expect("it can be read")
}

fn measure(meter: &SliceMeter<'_>, luma: &Plane<u8>, coverage: &Coverage, gain: f64) -> SliceMeasurements {
    measure_samples(meter, &luma.data, 1, coverage, gain)
}

fn measured(luma: &Plane<u8>, gain: f64) -> SliceMeasurements {
    measure(&meter(None), luma, &covered(WIDTH), gain)
}

#[test]
fn exposure_is_measured_before_the_gain() {
    let ratio = measured(&scene(), 1.25).brightness.exposure_ratio(&measured(&scene(), 1.0).brightness).unwrap();
    assert!((ratio - 0.8).abs() < 1e-6, "{ratio}");
}

#[test]
fn clipped_cells_do_not_affect_the_exposure() {
    let bright = Plane::from_fn(WIDTH, HEIGHT, |x, y| if x < 32 { scene().at(x, y) / 2 } else { 200 });
    let doubled = bright.map(|v| v.saturating_mul(2));
    let (one, two) = (measured(&bright, 1.0), measured(&doubled, 1.0));
    let ratio = two.brightness.exposure_ratio(&one.brightness).unwrap();
    assert!((ratio - 2.0).abs() < 1e-3, "{ratio}");
    assert_eq!((two.clipped, one.clipped), (Some(0.5), Some(0.0)));
}

#[test]
fn a_colour_drift_is_distinguished_from_a_brightness_drift() {
    let grey: Vec<u8> = scene().data.iter().flat_map(|&v| [v, v, v]).collect();
    let warm: Vec<u8> = scene().data.iter().flat_map(|&v| [(f32::from(v) * 1.2).round() as u8, v, v]).collect();
    let coverage = covered(WIDTH);
    let brightness = |samples: &[u8]| measure_samples(&meter(None), samples, 3, &coverage, 1.0).brightness;
    let [red, blue] = brightness(&warm).balance_ratio(&brightness(&grey)).unwrap();
    assert!((red - 1.2).abs() < 0.005 && (blue - 1.0).abs() < 1e-6, "{red}, {blue}");
}

#[test]
fn uncovered_pixels_do_not_count() {
    let torn = Plane::from_fn(WIDTH, HEIGHT, |x, y| if x < 32 { scene().at(x, y) } else { 255 });
    let torn_measured = measure(&meter(None), &torn, &covered(32), 1.0);
    assert_eq!((torn_measured.covered, torn_measured.clipped), (Some(0.5), Some(0.0)));
    let half = Plane::from_fn(32, HEIGHT, |x, y| scene().at(x, y));
    let alone = SliceMeter::new(32, HEIGHT, 2, 0, None);
    let alone = measure(&alone, &half, &Coverage::full(32, HEIGHT), 1.0);
    assert!((torn_measured.tenengrad.unwrap() / alone.tenengrad.unwrap() - 1.0).abs() < 1e-9);
    let ratio = torn_measured.brightness.exposure_ratio(&measured(&scene(), 1.0).brightness).unwrap();
    assert!((ratio - 1.0).abs() < 1e-6);
}

#[test]
fn a_slice_that_covers_nothing_has_no_sharpness_and_no_exposure() {
    let nothing = measure(&meter(None), &scene(), &covered(0), 1.0);
    assert_eq!((nothing.tenengrad, nothing.clipped, nothing.covered), (None, None, Some(0.0)));
    assert_eq!(nothing.brightness.exposure_ratio(&measured(&scene(), 1.0).brightness), None);
}

#[test]
fn only_the_object_counts_for_clipping_and_sharpness() {
    let object = Plane::from_fn(WIDTH, HEIGHT, |x, _| if x < 20 { 255u8 } else { 0 });
    let black = Plane::from_fn(WIDTH, HEIGHT, |x, y| if x < 20 { scene().at(x, y) } else { 0 });
    let (alone, all) = (measure(&meter(Some(&object)), &black, &covered(WIDTH), 1.0), measured(&black, 1.0));
    assert_eq!(alone.clipped, Some(0.0));
    assert!(all.clipped.unwrap() > 0.6);
    // twice as much is black, but it has an edge at the border of the object
    assert!(alone.tenengrad.unwrap() > 1.4 * all.tenengrad.unwrap());
}

#[test]
fn tenengrad_of_a_ramp_is_its_squared_sobel_slope() {
    let ramp = Plane::from_fn(WIDTH, HEIGHT, |x, _| 2 * x as u8 + 1);
    assert_eq!(measured(&ramp, 1.0).tenengrad, Some(256.0));
}

#[test]
fn a_slice_that_does_not_fit_the_canvas_gives_no_numbers() {
    let measured = measure(&meter(None), &Plane::filled(8, 8, 1u8), &Coverage::full(8, 8), 1.0);
    assert_eq!((measured.covered, measured.tenengrad), (None, None));
    assert!(measured.saliency.iter().all(|s| s.is_nan()));
}

#[test]
fn samples_that_cannot_be_read_are_an_error() {
    let (coverage, meter) = (covered(WIDTH), meter(None));
    let read = |_: Rect| Err::<Vec<u8>, _>(Error::new(crate::types::ErrorKind::ResourcesExhausted, "the disk is gone"));
    let slice = WarpedSlice { samples: &read, channels: 1, coverage: &coverage, gain: 1.0 };
    let mut rows = RowMeasurements::default();
    (0..HEIGHT).for_each(|y| rows.take_saliency(&meter, y, &[1.0; WIDTH], &(0..WIDTH)));
    let measured = meter.measure(0, &slice, rows, Brightness::default(), Fingerprint::default());
    let error = measured.expect_err("nothing can be read");
    assert!(error.detail.contains("the disk is gone"), "{}", error.detail);
}

#[test]
fn an_image_that_was_encoded_twice_is_recognised_and_another_exposure_is_not() {
    let noise = |x: usize, y: usize, seed: usize| (x * 7919 + y * 104_729 + seed * 31 + x * y) % 3;
    let picture = |seed: usize| {
        Plane::from_fn(200, 150, |x, y| (60 + ((x * 31 + y * 17) % 97) / 4 * 2 + noise(x, y, seed)) as u8)
    };
    let print = |picture: &Plane<u8>| Fingerprint::of(&picture.data, 1, 200, 150);
    let one = picture(0);
    let mut rewritten = one.clone();
    rewritten.data.iter_mut().step_by(1500).for_each(|v| *v += 1);
    assert!(print(&one).is_same_image(&print(&rewritten)));
    let other =
        Plane::from_fn(200, 150, |x, y| one.at(x, y) + ((x * 2_654_435_761 + y * 40_503 + 7 * x * y) >> 3) as u8 % 3);
    assert!(!print(&one).is_same_image(&print(&other)));
    let flat = Plane::filled(200, 150, 90u8);
    assert!(!print(&flat).is_same_image(&print(&flat)), "nothing to compare");
    assert!(!Fingerprint::default().is_same_image(&Fingerprint::default()));
}
