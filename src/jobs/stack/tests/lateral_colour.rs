//! Stacks of a lens with lateral colour.

use super::*;
use crate::{contract::options::LateralColourMode, jobs::testkit::members};
use pinstack_science::{
    calibration::calibrate,
    imaging::warp::Warp,
    synth::{DotTarget, Light, Rig, Scene, Stage, render_target},
    types::{
        Homography, NoControl,
        calibration_options::CalibrationOptions,
        lateral_colour::{ColourDisplacement, LateralColour},
        profile::{CaptureMode, ProfileInput},
    },
};

/// The slice as a lens images it that displaces red by (3, -2) px and blue by (-1, 0) px.
fn with_lateral_colour(slice: &Raster) -> Raster {
    let Samples::Eight(samples) = &slice.samples else { panic!("8 bits") };
    let (width, height) = (slice.width as i64, slice.height as i64);
    let at = |x: i64, y: i64, channel: i64| {
        samples[((y.clamp(0, height - 1) * width + x.clamp(0, width - 1)) * 3 + channel) as usize]
    };
    let pixel = |k: i64| {
        let (x, y) = (k % width, k / width);
        [at(x - 3, y + 2, 0), at(x, y, 1), at(x + 1, y, 2)]
    };
    Raster::eight(slice.width, slice.height, 3, (0..width * height).flat_map(pixel).collect())
}

#[test]
fn lateral_colour_of_the_profile_is_corrected_unless_asked_otherwise() {
    let displaced: Vec<Raster> = stack().front.iter().map(with_lateral_colour).collect();
    let archive = zip(members("front", &displaced));
    let lens = LateralColour {
        red: ColourDisplacement { scale: 0.0, shift_px: [3.0, -2.0] },
        blue: ColourDisplacement { scale: 0.0, shift_px: [-1.0, 0.0] },
    };
    let of = |archive: &[u8], lens: Option<LateralColour>, lateral_colour: LateralColourMode| {
        let mut job = TestJob::stack(archive, StackOptions { lateral_colour, ..options() });
        job.context.profile.as_mut().expect("a profile").input.lateral_colour = lens;
        picture(&done(&job).0, "image").1.crop(Rect { x: 10, y: 10, width: 220, height: 160 })
    };
    let share_of_equal = |a: &Raster, b: &Raster| {
        let (Samples::Eight(a), Samples::Eight(b)) = (&a.samples, &b.samples) else { panic!("8 bits") };
        let pixels = || a.chunks_exact(4).zip(b.chunks_exact(4));
        let equal = |(a, b): &(&[u8], &[u8])| a.iter().zip(*b).all(|(a, b)| a.abs_diff(*b) <= 2);
        pixels().filter(equal).count() as f64 / pixels().count() as f64
    };
    let perfect = of(&front_zip(), None, LateralColourMode::Correct);
    let corrected = of(&archive, Some(lens), LateralColourMode::Correct);
    let share = share_of_equal(&perfect, &corrected);
    assert!(share > 0.99, "the colours are back in {share} of the pixels");
    let kept = of(&archive, Some(lens), LateralColourMode::Keep);
    assert_eq!(kept, of(&archive, None, LateralColourMode::Correct));
    assert!(share_of_equal(&perfect, &kept) < 0.9);
}

/// A lens that makes red larger by `share` and blue smaller, about the optical axis of `rig`.
fn lens(rig: &Rig, share: f64) -> LateralColour {
    let middle = [rig.width, rig.height].map(|length| 0.5 * (length as f64 - 1.0));
    let axis = rig.centre();
    let of = |scale: f64| ColourDisplacement { scale, shift_px: [0, 1].map(|a| scale * (middle[a] - axis[a])) };
    LateralColour { red: of(share), blue: of(-share) }
}

/// `slice` as this lens images it. It is resampled for that, which costs about 2 dB in red and blue.
fn imaged(slice: &Raster, lens: LateralColour) -> Raster {
    let Samples::Eight(samples) = &slice.samples else { panic!("8 bits expected") };
    let size = (slice.width, slice.height);
    let inverse = |of: ColourDisplacement| ColourDisplacement {
        scale: -of.scale / (1.0 + of.scale),
        shift_px: of.shift_px.map(|shift| -shift / (1.0 + of.scale)),
    };
    let warp = Warp::new(&Homography::IDENTITY, 1.0, size, size).expect("regular");
    let opposite = LateralColour { red: inverse(lens.red), blue: inverse(lens.blue) };
    let warp = warp.with_lateral_colour(Some(&opposite)).expect("valid");
    Raster::eight(slice.width, slice.height, 3, warp.apply(samples.clone(), 3))
}

/// The stack fused with the true geometry of `rig`, and this lateral colour.
fn fused(slices: &[Raster], rig: &Rig, lateral_colour: Option<LateralColour>) -> Raster {
    let profile = ProfileInput {
        image_width: rig.width as u32,
        image_height: rig.height as u32,
        reference_index: rig.reference as u32,
        homographies: (0..rig.slices()).map(|i| rig.homography(i)).collect(),
        gains: Some((0..rig.slices()).map(|i| rig.gain(i)).collect()),
        capture_mode: Some(CaptureMode::FixedLens),
        lateral_colour,
        ..ProfileInput::default()
    };
    let (request, folder) = (FusionRequest::default(), std::env::temp_dir());
    fusion::fuse(&slices, &requested::plan(&options(), &profile), &request, &folder, &NoControl).expect("fused").image
}

/// PSNR of a colour against the truth, dB, without a border of 10 px.
fn psnr(image: &Raster, truth: &Raster, channel: usize) -> f64 {
    let (Samples::Eight(ours), Samples::Eight(theirs)) = (&image.samples, &truth.samples) else { panic!("8 bits") };
    let (mut sum, mut count) = (0.0, 0.0);
    for y in 10..image.height - 10 {
        for x in 10..image.width - 10 {
            let at = 3 * (y * image.width + x) + channel;
            sum += f64::from(ours[at].abs_diff(theirs[at])).powi(2);
            count += 1.0;
        }
    }
    10.0 * (255.0 * 255.0 * count / sum).log10()
}

#[test]
fn a_calibration_corrects_lateral_colour_as_well_as_the_true_lens() {
    let share = 0.006;
    for seed in [3, 8] {
        let rig = Rig { channels: 3, seed, ..Rig::sized(480, 320, 9) };
        let mut target = DotTarget::for_rig(&rig, 16);
        target.flaws.faults.lateral = [share, 0.0, -share];
        let pictures: Vec<Raster> = (0..rig.slices()).map(|i| render_target(&rig, &target, i)).collect();
        let calibration = calibrate(&&pictures[..], &CalibrationOptions::default(), &NoControl).expect("a calibration");

        let stage = Stage::new(&rig, &Scene::insect(seed));
        let sharp = stage.truth().sharp;
        let truth = lens(&rig, share);
        let slices: Vec<Raster> = (0..rig.slices()).map(|i| imaged(&stage.render(Light::Front, i), truth)).collect();
        let of = |lateral_colour| fused(&slices, &rig, lateral_colour);
        let (kept, corrected, best) = (of(None), of(calibration.lateral_colour), of(Some(truth)));
        for (channel, colour) in ["red", "green", "blue"].into_iter().enumerate() {
            let [kept, corrected, best] = [&kept, &corrected, &best].map(|i| psnr(i, &sharp, channel));
            println!(
                "{seed}, {colour}: {kept:.2} dB left as it is, {corrected:.2} corrected, {best:.2} by the true lens"
            );
            assert!(corrected > best - 0.1, "{colour}: {corrected} dB, {best} dB by the true lens");
            assert!(channel == 1 || corrected > kept + 6.0, "{colour}: {corrected} dB, {kept} dB left as it is");
        }
    }
}
