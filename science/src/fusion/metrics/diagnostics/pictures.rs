//! The pictures of docs/TROUBLESHOOTING.md: rendered stacks, each fused without and with a fault.
//!
//! `cargo test --lib pictures_of_the_faults -- --ignored` writes them to `docs/troubleshooting`, or to the folder that
//! `PINSTACK_PICTURES` names. Each stack must be reported with the code of its picture.

use super::*;
use crate::{
    imaging::{Rect, codec},
    segmentation::{MaskParams, segment},
};

/// Size of each half of a picture, px.
const HALF: [usize; 2] = [320, 240];
/// White between the halves, px.
const GAP: usize = 8;
/// Largest file, bytes.
const LARGEST: usize = 40_000;
const QUALITY: u8 = 82;

/// What a half shows of the fused image.
#[derive(Clone, Copy)]
enum Part {
    /// All of it.
    Whole,
    /// The part in which the images differ most, so many times enlarged.
    Enlarged(usize),
}

/// A fault, its code and what of the image shows it.
struct Case {
    code: &'static str,
    scene: fn(u64) -> Scene,
    part: Part,
    make: fn(Stack) -> Stack,
}

const fn case(code: &'static str, scene: fn(u64) -> Scene, part: Part, make: fn(Stack) -> Stack) -> Case {
    Case { code, scene, part, make }
}

const CASES: [Case; 15] = [
    case("range_too_short_near", Scene::insect, Part::Enlarged(2), |stack| {
        let n = stack.count();
        stack.only(|i| i >= n / 2)
    }),
    case("range_too_short_far", Scene::insect, Part::Enlarged(2), |stack| {
        let n = stack.count();
        stack.only(|i| i < n / 2)
    }),
    case("coverage_gap", Scene::insect, Part::Enlarged(2), |stack| {
        let n = stack.count();
        stack.only(|i| i < n / 2 - 2 || i > n / 2 + 2)
    }),
    case("slices_out_of_order", Scene::insect, Part::Enlarged(2), |stack| {
        let n = stack.count();
        stack.swapped(n / 2 - 2, n / 2 + 2)
    }),
    case("slices_reversed", Scene::insect, Part::Enlarged(2), |mut stack| {
        stack.slices.reverse();
        stack
    }),
    case("profile_misfit", Scene::insect, Part::Enlarged(2), |stack| {
        let n = stack.count() as f64;
        stack.with_profile_error(|i| (1.0 + 0.03 * (i / n - 0.5), [0.0; 2]))
    }),
    case("slice_misaligned", Scene::insect, Part::Enlarged(2), |stack| {
        let n = stack.count() / 2 + 1;
        stack.with_profile_error(|i| (1.0, if i == n as f64 { [5.0, -3.0] } else { [0.0; 2] }))
    }),
    case("picture_jumps", Scene::insect, Part::Enlarged(2), |stack| {
        let n = stack.count() / 2;
        stack.with_profile_error(|i| (1.0, if i >= n as f64 { [5.0, -3.0] } else { [0.0; 2] }))
    }),
    case("exposure_flicker", Scene::insect, Part::Whole, |stack| {
        let n = stack.count();
        stack.scaled(n / 2 + 1, [0.7; 3]).scaled(n / 2 - 2, [1.25; 3])
    }),
    case("exposure_drift", Scene::insect, Part::Whole, |stack| {
        let n = stack.count();
        (0..n).fold(stack, |s, i| s.scaled(i, [1.0 - 0.5 * i as f32 / n as f32; 3]))
    }),
    case("white_balance_drift", Scene::insect, Part::Whole, |stack| {
        let n = stack.count();
        (0..n).fold(stack, |s, i| {
            let share = i as f32 / n as f32 - 0.5;
            s.scaled(i, [1.0 + 0.4 * share, 1.0, 1.0 - 0.4 * share])
        })
    }),
    case("clipped", Scene::insect, Part::Whole, |stack| (0..stack.count()).fold(stack, |s, i| s.scaled(i, [3.0; 3]))),
    case("halos", Scene::plates, Part::Enlarged(2), |mut stack| {
        stack.plan.method = Method::Pyramid;
        stack
    }),
    case("depth_order_disagrees", Scene::rim, Part::Enlarged(2), |mut stack| {
        stack.plan.near_first = Some(false);
        stack
    }),
    case("small_common_area", Scene::insect, Part::Whole, |stack| {
        let n = stack.count() as f64;
        stack.with_profile_error(|i| (1.0, [40.0 * (i / n - 0.5), 0.0]))
    }),
];

#[test]
#[ignore = "writes the pictures of docs/TROUBLESHOOTING.md"]
fn pictures_of_the_faults() {
    let folder = std::env::var_os("PINSTACK_PICTURES").map_or_else(
        || std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/troubleshooting"),
        std::path::PathBuf::from,
    );
    std::fs::create_dir_all(&folder).unwrap();
    let write = |code: &str, picture: &Raster| {
        let file = codec::encode_jpeg(picture, QUALITY);
        println!("{code}: {} bytes", file.len());
        assert!(file.len() <= LARGEST, "{code}: {} bytes", file.len());
        std::fs::write(folder.join(format!("{code}.jpg")), file).unwrap();
    };
    let mut unreported = Vec::new();
    for Case { code, scene, part, make } in CASES {
        let clean = Stack::of(&Rig::sized(480, 360, 13), &scene(1));
        let right = clean.fused(true).image;
        let wrong = make(clean.clone()).fused(true);
        let codes: Vec<String> = reported(&wrong);
        if !codes.iter().any(|found| found == code) {
            unreported.push(format!("{code}: {codes:?}"));
        }
        write(
            code,
            &beside(&shown(&right, part, &right, &wrong.image), &shown(&wrong.image, part, &right, &wrong.image)),
        );
    }
    for (code, make) in OF_MASKS {
        let (light, cut_out, codes) = silhouette(make);
        if !codes.iter().any(|found| found == code) {
            unreported.push(format!("{code}: {codes:?}"));
        }
        write(
            code,
            &beside(&shown(&light, Part::Whole, &light, &light), &shown(&cut_out, Part::Whole, &light, &light)),
        );
    }
    assert!(unreported.is_empty(), "{unreported:#?}");
}

/// All codes that the service would show.
fn reported(fused: &Fused) -> Vec<String> {
    let findings = fused.quality.iter().flat_map(|quality| &quality.findings).map(|finding| finding.code.clone());
    findings.chain(fused.warnings.iter().map(|warning| warning.code.clone())).collect()
}

/// Makes a back-lit slice from what the lamp behind and the lamp before the object give, 0..255, and the place, 0..1.
type Exposure = fn(f32, f32, [f32; 2]) -> f32;

const OF_MASKS: [(&str, Exposure); 2] = [
    // the front lamp was left on
    ("mask_low_separability", |back, front, _| 0.22 * back + 0.75 * front),
    // a small lamp to the left
    ("mask_uneven_light", |back, _, [x, y]| back * (-3.2 * ((x - 0.15).powi(2) + (y - 0.5).powi(2))).exp() + 3.0),
];

/// The fused back light, what is cut out of the fused front light, and the codes that are reported.
fn silhouette(make: Exposure) -> (Raster, Raster, Vec<String>) {
    let rig = Rig::sized(480, 360, 13);
    let stage = Stage::new(&rig, &Scene::insect(1).scaled(0.9));
    let front: Vec<Raster> = (0..rig.slices()).map(|i| stage.render(Light::Front, i)).collect();
    let back = front.iter().enumerate().map(|(i, front)| mixed(&stage.render(Light::Back, i), front, make)).collect();
    let plan = Plan { method: Method::HaloCorrected, ..true_plan(&rig) };
    let of = |slices: &Vec<Raster>| {
        let request = MetricsRequest { enabled: false, object: None };
        fuse(&&slices[..], &plan, &request, &std::env::temp_dir(), &NoControl).unwrap()
    };
    let light = of(&back);
    let found = segment(&light.image, &light.valid, &MaskParams::default_for(rig.width, rig.height));
    let mut cut_out = of(&front).image;
    let Samples::Eight(samples) = &mut cut_out.samples else { panic!("8 bits expected") };
    for (pixel, &mask) in samples.chunks_exact_mut(3).zip(&found.mask.data) {
        if mask == 0 {
            pixel.fill(0);
        }
    }
    (light.image, cut_out, found.warnings.into_iter().map(|warning| warning.code).collect())
}

fn mixed(back: &Raster, front: &Raster, make: Exposure) -> Raster {
    let (Samples::Eight(b), Samples::Eight(f)) = (&back.samples, &front.samples) else { panic!("8 bits expected") };
    let sample = |at: usize| {
        let (x, y) = (at / 3 % back.width, at / 3 / back.width);
        let place = [x as f32 / back.width as f32, y as f32 / back.height as f32];
        make(f32::from(b[at]), f32::from(f[at]), place).round().clamp(0.0, 255.0) as u8
    };
    Raster::eight(back.width, back.height, 3, (0..b.len()).map(sample).collect())
}

/// A half of the picture. Where to look follows from the two images, so that both halves show the same part.
fn shown(image: &Raster, part: Part, right: &Raster, wrong: &Raster) -> Raster {
    let rect = match part {
        Part::Whole => Rect::whole(image.width, image.height),
        Part::Enlarged(times) => most_different(right, wrong, [HALF[0] / times, HALF[1] / times]),
    };
    resized(&image.crop(rect))
}

/// The place, on a grid, of the given size where the images differ most.
fn most_different(one: &Raster, other: &Raster, [width, height]: [usize; 2]) -> Rect {
    const STEP: usize = 20;
    // nothing of the rim, where fewer slices are
    const RIM: usize = 20;
    let (a, b) = (one.luma(), other.luma());
    let difference = |&[x, y]: &[usize; 2]| -> f64 {
        let rows = (y..y + height).flat_map(|y| (x..x + width).map(move |x| (x, y)));
        rows.map(|(x, y)| f64::from((a.at(x, y) - b.at(x, y)).abs())).sum()
    };
    let places = (RIM..=one.height - height - RIM).step_by(STEP);
    let places = places.flat_map(|y| (RIM..=one.width - width - RIM).step_by(STEP).map(move |x| [x, y]));
    let [x, y] = places.max_by(|a, b| difference(a).total_cmp(&difference(b))).unwrap();
    Rect { x, y, width, height }
}

/// The picture in the size of a half, by linear interpolation.
fn resized(picture: &Raster) -> Raster {
    let Samples::Eight(samples) = &picture.samples else { panic!("8 bits expected") };
    let scale = [picture.width as f32 / HALF[0] as f32, picture.height as f32 / HALF[1] as f32];
    let mut out = Vec::with_capacity(HALF[0] * HALF[1] * 3);
    for y in 0..HALF[1] {
        for x in 0..HALF[0] {
            let at = |to: usize, scale: f32, end: usize| {
                let at = ((to as f32 + 0.5) * scale - 0.5).clamp(0.0, end as f32 - 1.0);
                (at as usize, (at as usize + 1).min(end - 1), at.fract())
            };
            let ((x0, x1, u), (y0, y1, v)) = (at(x, scale[0], picture.width), at(y, scale[1], picture.height));
            for channel in 0..3 {
                let sample = |x: usize, y: usize| {
                    f32::from(samples[(y * picture.width + x) * picture.channels + channel % picture.channels])
                };
                let upper = sample(x0, y0) * (1.0 - u) + sample(x1, y0) * u;
                let lower = sample(x0, y1) * (1.0 - u) + sample(x1, y1) * u;
                out.push((upper * (1.0 - v) + lower * v).round() as u8);
            }
        }
    }
    Raster::eight(HALF[0], HALF[1], 3, out)
}

/// Two halves side by side.
fn beside(left: &Raster, right: &Raster) -> Raster {
    let (Samples::Eight(a), Samples::Eight(b)) = (&left.samples, &right.samples) else { panic!("8 bits expected") };
    let row = 3 * HALF[0];
    let rows = (0..HALF[1]).flat_map(|y| {
        let part = |of: &[u8]| of[y * row..(y + 1) * row].to_vec();
        [part(a), vec![255; 3 * GAP], part(b)].concat()
    });
    Raster::eight(2 * HALF[0] + GAP, HALF[1], 3, rows.collect())
}
