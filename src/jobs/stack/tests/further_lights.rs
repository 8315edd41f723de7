//! Further lights.

use super::*;
use crate::{contract::outcome::Artifact, jobs::testkit::members};

fn lit() -> Vec<u8> {
    let mut all = members("front", &stack().front);
    all.extend(members("back", &stack().back));
    let grey = |slice: &Raster| {
        let luma = slice.luma().data.iter().map(|&value| value as u16 * 257).collect();
        Raster::sixteen(slice.width, slice.height, 1, luma)
    };
    all.extend(members("IR_850", &stack().front.iter().map(grey).collect::<Vec<_>>()));
    all.extend(members("left", &stack().front));
    zip(all)
}

#[test]
fn a_further_light_has_the_form_of_the_image_and_the_depth_of_its_slices() {
    let crop = Crop::Rect { x: 10, y: 20, width: 100, height: 80 };
    let options = StackOptions { format: ImageFormat::Tiff, bit_depth: BitDepth::Auto, crop, ..options() };
    let job = TestJob::stack(&lit(), options);
    let recorder = Recorder::default();
    let output = run_with(&job, &recorder).expect("the job");
    let JobOutcome::Stack(outcome) = output.outcome.clone() else { panic!("a stack was made") };
    let light = |artifact: &&Artifact| artifact.name.starts_with("lights/");
    let lights: Vec<&Artifact> = outcome.artifacts.iter().filter(light).collect();
    let told: Vec<_> = lights.iter().map(|file| (file.name.as_str(), file.media_type.as_str())).collect();
    assert_eq!(told, [("lights/IR_850", "image/tiff"), ("lights/left", "image/tiff")]);
    assert!(lights[0].key.ends_with("/lights_IR_850.tiff"), "{}", lights[0].key);

    let decoded = |name: &str| codec::decode_rgba(&file(&output, name).1, &Default::default()).expect("a picture");
    let [image, left, infrared] = ["image", "lights/left", "lights/IR_850"].map(decoded);
    for picture in [&image, &left, &infrared] {
        assert_eq!((picture.width, picture.height, picture.channels), (100, 80, 4));
    }
    let (Samples::Eight(image), Samples::Eight(left)) = (&image.samples, &left.samples) else { panic!("8 bits") };
    let Samples::Sixteen(infrared) = &infrared.samples else { panic!("16 bits") };
    let mut opaque = 0;
    for ((image, left), infrared) in image.chunks(4).zip(left.chunks(4)).zip(infrared.chunks(4)) {
        assert_eq!((left[3], infrared[3]), (image[3], u16::from(image[3]) * 257));
        assert!(infrared[0] == infrared[1] && infrared[1] == infrared[2]);
        opaque += usize::from(image[3] == 255);
    }
    assert!(opaque > 1000 && opaque < 8000, "{opaque}");

    let names: Vec<&str> = outcome.metrics.lights.iter().map(|light| light.name.as_str()).collect();
    assert_eq!(names, ["IR_850", "left"]);
    assert!(outcome.metrics.lights[1].alignment.residual_p95_px.is_some_and(|px| px < 0.5));
    assert!(!output.warnings.iter().any(|warning| warning.code == "light_misfit"), "{:?}", output.warnings);
    let reports = recorder.reports.lock().expect("no test panics with it");
    assert!(reports.windows(2).all(|pair| pair[0].fraction <= pair[1].fraction));
    assert!(reports.last().is_some_and(|last| (last.fraction - 1.0).abs() < 1e-9), "{:?}", reports.last());
}

#[test]
fn a_further_light_in_another_order_is_warned_of() {
    let mut all = members("front", &stack().front);
    let reversed: Vec<Raster> = stack().front.iter().rev().cloned().collect();
    all.extend(members("uv", &reversed));
    let (output, _) = done(&TestJob::stack(&zip(all), options()));
    let told: Vec<_> = output.warnings.iter().filter(|warning| warning.code == "light_misfit").collect();
    assert!(told.len() == 1 && told[0].detail.contains("further light uv do not fit"), "{:?}", output.warnings);
}
