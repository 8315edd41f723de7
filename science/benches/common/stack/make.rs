//! The stacks, rendered and put together.

use std::{
    fs::{self, File},
    io::BufWriter,
    path::{Path, PathBuf},
};

use pinstack_science::{
    archive::pack,
    imaging::{
        Raster, Samples,
        codec::{self, Metadata},
        warp::Warp,
    },
    synth::{
        Light, Rig, Scene, Stage,
        scene::{Part, Pattern, Relief, Shape, Skin},
    },
};
use rayon::prelude::*;

use super::case::{BACK, Case, FRONT, Kind};

/// Rendered size, from which larger pictures are put together.
pub const RENDERED: (usize, usize) = (1800, 1200);

fn scene(dense: bool) -> Scene {
    let mut scene = Scene::insect(1);
    if dense {
        scene.parts = vec![Part {
            shape: Shape::Plate { centre: [0.0; 2], half: [2.0; 2], angle: 0.0, corner: 0.0 },
            holes: Vec::new(),
            relief: Relief::Dome { centre: [0.0; 2], depth: 0.7, slope: [0.3, 0.25], bulge: 0.3, radius: 0.5 },
            skin: Skin {
                base: [0.5, 0.4, 0.3],
                accent: [0.2, 0.3, 0.5],
                pattern: Pattern::Mottled,
                grain: 0.8,
                gloss: 0.0,
                seed: 1,
            },
        }];
    }
    scene
}

/// Writes the zips of a case. Pictures that are larger than [`RENDERED`] are mirrored copies of it side by side, put
/// together on the canvas and then seen through the homographies of the large rig, with noise of their own.
pub fn make(case: Case, folder: &Path) {
    let lights = [
        (FRONT, scene(case.kind == Kind::Dense), Light::Front),
        // texture everywhere leaves no back light to see
        (BACK, scene(false), Light::Back),
    ];
    for (name, scene, light) in lights {
        zip(case, &scene, light, &folder.join(name));
    }
}

/// Puts the JPEG files of `pictures` into a zip in `folder`. Returns whether there are as many as slices.
pub fn packed(case: Case, pictures: &Path, folder: &Path) -> bool {
    let files = fs::read_dir(pictures).into_iter().flatten().flatten().map(|entry| entry.path());
    let is_slice = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        name.ends_with(".jpg") && name != "expected.jpg"
    };
    let mut files: Vec<PathBuf> = files.filter(is_slice).collect();
    files.sort();
    let members =
        files.iter().enumerate().map(|(i, path)| (format!("front/{i:02}.jpg"), fs::read(path).expect("a file")));
    pack(BufWriter::new(File::create(folder.join(FRONT)).expect("a file")), members).expect("a zip");
    files.len() == case.slices
}

fn zip(case: Case, scene: &Scene, light: Light, path: &Path) {
    let small = Rig::sized(RENDERED.0, RENDERED.1, case.slices);
    let stage = Stage::new(&small, scene);
    let rig = case.rig();
    let members = (0..case.slices).map(|i| {
        let mut slice = stage.render(light, i);
        if (case.width, case.height) != RENDERED {
            slice = enlarged(case, &slice, &small, &rig, i);
        }
        match case.sixteen {
            false => (format!("front/{i:02}.jpg"), codec::encode_jpeg(&slice, 95)),
            true => {
                let mut file = Vec::new();
                codec::encode_png(&mut file, &in_sixteen(slice, i), &Metadata::default()).expect("memory");
                (format!("front/{i:02}.png"), file)
            }
        }
    });
    pack(BufWriter::new(File::create(path).expect("a file")), members).expect("a zip");
}

fn eight(raster: Raster) -> Vec<u8> {
    match raster.samples {
        Samples::Eight(samples) => samples,
        Samples::Sixteen(samples) => samples.iter().map(|&v| (v >> 8) as u8).collect(),
    }
}

fn enlarged(case: Case, slice: &Raster, small: &Rig, rig: &Rig, i: usize) -> Raster {
    let warp = Warp::new(&small.homography(i), 1.0, RENDERED, RENDERED).expect("a regular homography");
    let aligned = warp.apply(eight(slice.clone()), 3);
    // beyond this margin every slice covers the canvas
    let margin = [RENDERED.0 / 25, RENDERED.1 / 25];
    let mirrored = |x: usize, length: usize, margin: usize| {
        let length = length - 2 * margin;
        margin + if (x / length).is_multiple_of(2) { x % length } else { length - 1 - x % length }
    };
    let (width, height) = (case.width, case.height);
    let mut canvas = vec![0u8; width * height * 3];
    canvas.par_chunks_exact_mut(width * 3).enumerate().for_each(|(y, row)| {
        let from = mirrored(y, RENDERED.1, margin[1]) * RENDERED.0;
        for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
            let at = (from + mirrored(x, RENDERED.0, margin[0])) * 3;
            pixel.copy_from_slice(&aligned[at..at + 3]);
        }
    });
    let away = rig.homography(i).inverse().expect("a regular homography");
    let warp = Warp::new(&away, 1.0, (width, height), (width, height)).expect("a regular homography");
    let mut samples = warp.apply(canvas, 3);
    samples.par_chunks_mut(width * 3).enumerate().for_each(|(y, row)| {
        let mut state =
            (i as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (y as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
        for sample in row {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            // two dice: a standard deviation of about 1 of 255
            let noise = (state >> 40) % 3 + (state >> 50) % 3;
            *sample = sample.saturating_add(noise as u8).saturating_sub(2);
        }
    });
    Raster::eight(width, height, 3, samples)
}

fn in_sixteen(slice: Raster, i: usize) -> Raster {
    let (width, height, channels) = (slice.width, slice.height, slice.channels);
    let fine = |at: usize| (at.wrapping_mul(40_503) ^ (i * 7_919)) as u16 & 0xFF;
    let samples = eight(slice).iter().enumerate().map(|(at, &v)| u16::from(v) << 8 | fine(at)).collect();
    Raster::sixteen(width, height, channels, samples)
}
