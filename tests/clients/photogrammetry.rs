//! Result images in COLMAP: whether it opens them, and its prior for the focal length.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use pinstack_science::{
    photogrammetry::{
        bundle::{self, BundleScan, BundleView, Content, Layout},
        poses,
    },
    types::{intrinsics::Intrinsics, view::ViewAngles},
};
use serde_json::{Value, json};

use crate::{
    metadata::tags,
    run,
    server::{Server, small_rig, write_slices},
};

/// Principal distance of the profile, mm.
const DISTANCE: f64 = 121.37;
const PITCH: f64 = 0.0061;

/// A camera in the catalogue of COLMAP with a sensor 36 mm wide, and its nominal focal length.
const CAMERA: &str = "-Make=Canon -Model='Canon EOS 5DS' -FocalLength=65 -FocalLengthIn35mmFormat=65 \
                      -FocalPlaneXResolution=6000 -FocalPlaneYResolution=6000 -FocalPlaneResolutionUnit=inches";

/// COLMAP's prior focal length in px, and whether COLMAP trusts it.
fn prior(image: &Path) -> (f64, bool) {
    let folder = tempfile::tempdir().expect("a folder");
    let images = folder.path().join("images");
    fs::create_dir(&images).expect("a folder");
    fs::copy(image, images.join(image.file_name().expect("a name"))).expect("a copy");
    let database = folder.path().join("database.db");
    run(Command::new("colmap")
        .env("QT_QPA_PLATFORM", "offscreen")
        .args(["feature_extractor", "--SiftExtraction.use_gpu", "0", "--SiftExtraction.max_num_features", "50"])
        .arg("--database_path")
        .arg(&database)
        .arg("--image_path")
        .arg(&images));
    let query = "import sqlite3, struct, sys\n\
                 row = sqlite3.connect(sys.argv[1]).execute('select params, prior_focal_length from cameras').fetchone()\n\
                 print(struct.unpack('d', row[0][:8])[0], row[1])";
    let told = run(Command::new("python3").args(["-c", query]).arg(&database));
    let (focal, trusted) =
        told.trim().split_once(' ').unwrap_or_else(|| panic!("COLMAP did not open {image:?}: {told}"));
    (focal.parse().expect("a number"), trusted == "1")
}

fn put_profile(server: &Server, optics: Value) {
    let rig = small_rig();
    let mut body = json!({
        "image_width": rig.width, "image_height": rig.height, "reference_index": rig.reference,
        "homographies": (0..rig.slices()).map(|i| rig.homography(i)).collect::<Vec<_>>(),
    });
    body.as_object_mut().expect("an object").extend(optics.as_object().expect("an object").clone());
    let arguments = ["-X", "PUT", "-H", "Content-Type: application/json", "-d", &body.to_string()];
    let profile = server.curl(&arguments, "/v1/profiles/rig/lens");
    assert!(profile["revision"].is_number(), "{profile}");
}

/// Two zips of the same slices: without and with the EXIF tags of a camera.
fn zips(server: &Server) -> [PathBuf; 2] {
    ["plain", "camera"].map(|name| {
        let folder = server.folder.path().join(name);
        write_slices(&folder);
        let tag = format!("exiftool -q -overwrite_original {CAMERA} front/*.jpg back/*.jpg");
        let tag = if name == "camera" { tag.as_str() } else { "true" };
        run(Command::new("sh").current_dir(&folder).args(["-c", &format!("{tag} && zip -q -r stack.zip front back")]));
        folder.join("stack.zip")
    })
}

fn download(server: &Server, stack: &Value, accept: &str, name: &str) -> PathBuf {
    assert_eq!(stack["state"], "succeeded", "{stack}");
    let file = server.folder.path().join(name);
    let image = format!("/v1/stacks/{}/image", stack["id"].as_str().expect("an id"));
    server.download(&["-H", &format!("Accept: image/{accept}")], &image, &file);
    file
}

/// A principal distance in mm; whether the slices have the tags of a camera; whether the image is cropped.
type Start = (f64, bool, bool);

/// So short that the tenth of a millimetre, to which COLMAP reads the tag, matters.
const SHORT: f64 = 3.04;

fn starts_from(cases: &[Start]) {
    let server = Server::start();
    let [plain, tagged] = zips(&server);
    for &(distance, has_camera, is_cropped) in cases {
        put_profile(&server, json!({ "pixel_pitch_mm": PITCH, "principal_distance_mm": distance }));
        let expected = distance / PITCH;
        let (zip, camera) = if has_camera { (&tagged, "a camera") } else { (&plain, "no camera") };
        let (crop, width) = if is_cropped { ("30,20,150,120", 150.0) } else { ("none", 240.0) };
        let stack = server.fuse(zip, &format!("&crop={crop}"));
        for (accept, name) in [("jpeg", "view.jpg"), ("tiff", "view.tif")] {
            let file = download(&server, &stack, accept, name);
            let (focal, is_trusted) = prior(&file);
            let what = format!("{name}, {distance} mm, {camera}, crop {crop}: {focal}, not {expected}");
            assert!(is_trusted && (focal / expected - 1.0).abs() < 1e-3, "{what}");
        }
        for (accept, name) in [("jpeg", "view.jpg"), ("tiff", "view.tif"), ("png", "view.png")] {
            let file = download(&server, &stack, accept, name);
            let tags = tags(&file);
            let number = |tag: &str| {
                tags[format!("EXIF:{tag}")].as_f64().unwrap_or_else(|| panic!("{name} has no {tag}: {tags}"))
            };
            let focal = number("FocalLength") * number("FocalPlaneXResolution") / 25.4;
            // both are whole numbers, for COLMAP's reader of TIFF
            assert!((focal / expected - 1.0).abs() < 2e-4, "{name}: {focal}, not {expected}");
            assert_eq!(number("FocalPlaneResolutionUnit"), 2.0, "{name}: inch");
            assert_eq!((number("ExifImageWidth"), number("Orientation")), (width, 1.0), "{name}");
        }
    }
}

#[test]
#[ignore = "needs curl, zip, exiftool, colmap, python3"]
fn colmap_starts_from_the_principal_distance_of_the_profile() {
    starts_from(&[(DISTANCE, false, false), (SHORT, true, true)]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_principal_distances_are_those_that_colmap_starts_from() {
    starts_from(&[(DISTANCE, false, true), (DISTANCE, true, false), (DISTANCE, true, true)]);
    starts_from(&[(SHORT, false, false), (SHORT, false, true), (SHORT, true, false)]);
}

#[test]
#[ignore = "needs curl, zip, exiftool, colmap, python3"]
fn the_nominal_focal_length_is_not_passed_on_as_the_principal_distance() {
    let server = Server::start();
    let [_, zip] = zips(&server);
    put_profile(&server, json!({}));
    let stack = server.fuse(&zip, "");
    let warned =
        stack["warnings"].as_array().is_some_and(|all| all.iter().any(|w| w["code"] == "focal_length_dropped"));
    assert!(warned, "{}", stack["warnings"]);
    let file = download(&server, &stack, "jpeg", "view.jpg");
    let (_, is_trusted) = prior(&file);
    assert!(!is_trusted, "COLMAP trusts a focal length that is not known");
    assert_eq!(run(Command::new("exiftool").args(["-s3", "-Model"]).arg(&file)).trim(), "Canon EOS 5DS");
}

#[test]
#[ignore = "needs curl, zip, colmap, python3"]
fn colmap_opens_the_images_of_16_bit_slices() {
    let server = Server::start();
    let zip = server.folder.path().join("deep.zip");
    write_deep(&zip);
    put_profile(&server, json!({}));
    let stack = server.fuse(&zip, "");
    assert_eq!(stack["image"]["bit_depth"], 8, "{stack}");
    for (accept, name) in [("png", "view.png"), ("tiff", "view.tif"), ("jpeg", "view.jpg")] {
        prior(&download(&server, &stack, accept, name));
    }
}

/// Writes the front light of the small rig with 16 bits per sample.
fn write_deep(zip: &Path) {
    use pinstack_science::{
        imaging::{Raster, Samples, codec},
        synth::{Light, Scene, Stage},
    };
    let rig = small_rig();
    let stage = Stage::new(&rig, &Scene::insect(1));
    let members = (0..rig.slices()).map(|i| {
        let slice = stage.render(Light::Front, i);
        let Samples::Eight(samples) = &slice.samples else { panic!("rendered with 8 bits") };
        let wide = samples.iter().map(|&v| u16::from(v) * 257).collect();
        let deep = Raster::sixteen(slice.width, slice.height, slice.channels, wide);
        let mut png = Vec::new();
        codec::encode_png(&mut png, &deep, &codec::Metadata::default()).expect("a PNG");
        (format!("front/{i:02}.png"), png)
    });
    pinstack_science::archive::pack(fs::File::create(zip).expect("a file"), members).expect("a zip");
}

#[test]
#[ignore = "needs colmap"]
fn colmap_reads_the_model_of_a_bundle() {
    let view = |pan_deg: f64| {
        let angles = ViewAngles { pan_deg, tilt_deg: 12.5 };
        BundleView {
            stem: angles.file_stem(),
            extension: "png".into(),
            bit_depth: 8,
            has_mask: true,
            angles: Some(angles),
        }
    };
    let scan = BundleScan {
        name: "bee".into(),
        width: 810,
        height: 540,
        intrinsics: Some(Intrinsics {
            principal_distance_px: 2712.5,
            principal_distance_mm: 120.55,
            principal_distance_sigma_mm: Some(0.12),
            pixel_pitch_mm: 0.044_442_4,
            principal_point_px: None,
            distortion: None,
        }),
        canvas_centre_px: [404.5, 269.5],
        radius_mm: Some(141.0),
        pan_is_clockwise: false,
        views: [0.0, 20.0, 40.0].map(view).to_vec(),
    };
    let folder = tempfile::tempdir().expect("a folder");
    for entry in bundle::plan(Layout::Colmap, &scan).expect("a bundle") {
        let Content::Text(text) = entry.content else { continue };
        let path = folder.path().join(entry.path);
        fs::create_dir_all(path.parent().expect("a folder")).expect("made");
        fs::write(path, text).expect("written");
    }
    let (from, to) = (folder.path().join("sparse/0"), folder.path().join("again"));
    fs::create_dir(&to).expect("made");
    let convert = |from: &Path, to: &Path, kind: &str| {
        let mut colmap = Command::new("colmap");
        colmap.env("QT_QPA_PLATFORM", "offscreen").arg("model_converter").arg("--input_path").arg(from);
        run(colmap.arg("--output_path").arg(to).args(["--output_type", kind]))
    };
    convert(&from, &to, "BIN");
    convert(&to, &to, "TXT");
    let images = fs::read_to_string(to.join("images.txt")).expect("text");
    let written = fs::read_to_string(from.join("images.txt")).expect("text");
    for view in &scan.views {
        let name = format!("{}.png", view.stem);
        let numbers = |text: &str| -> Vec<f64> {
            let line = text.lines().find(|line| line.ends_with(&name)).expect("the view");
            line.split(' ').filter_map(|number| number.parse().ok()).collect()
        };
        let (ours, theirs) = (numbers(&written), numbers(&images));
        assert_eq!(ours.len(), theirs.len());
        // a quaternion and its negative are the same rotation
        let sign = if ours[1] * theirs[1] < 0.0 { -1.0 } else { 1.0 };
        for (at, (our, their)) in ours.iter().zip(&theirs).enumerate() {
            let their = if (1..5).contains(&at) { sign * their } else { *their };
            assert!((our - their).abs() < 1e-9, "{name}: {ours:?} {theirs:?}");
        }
    }
    // the pose report reads what COLMAP wrote: text and binary alike, and as the views were placed
    let read = |name: &str| {
        let bytes = fs::read(to.join(name)).expect("a file of COLMAP");
        poses::read(&bytes, None).unwrap_or_else(|fault| panic!("{name}: {}", fault.detail))
    };
    for file in [read("images.txt"), read("images.bin")] {
        assert_eq!(file.poses.len(), scan.views.len());
        for view in &scan.views {
            let angles = view.angles.expect("given");
            let found = file.poses.iter().find(|found| found.name == format!("{}.png", view.stem)).expect("the view");
            for (axis, direction) in angles.direction().into_iter().enumerate() {
                assert!((found.centre[axis] - 141.0 * direction).abs() < 1e-6, "{found:?}");
            }
        }
    }
    let cameras = fs::read_to_string(to.join("cameras.txt")).expect("text");
    assert!(cameras.contains("1 PINHOLE 810 540 2712.5 2712.5 405 270"), "{cameras}");
    read_zipped(&to);
}

/// The pose report reads the focal length from a zip of the model.
fn read_zipped(model: &Path) {
    for names in [["images.txt", "cameras.txt"], ["images.bin", "cameras.bin"]] {
        let members = names.map(|name| (name.to_owned(), fs::read(model.join(name)).expect("a file of COLMAP")));
        let mut zip = std::io::Cursor::new(Vec::new());
        pinstack_science::archive::pack(&mut zip, members.into_iter()).expect("a zip");
        let file = poses::read(&zip.into_inner(), None).unwrap_or_else(|fault| panic!("{names:?}: {}", fault.detail));
        assert_eq!(file.focal_px, [2712.5; 3], "{names:?}");
    }
}
