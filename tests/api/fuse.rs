//! `pinstack fuse` and `pinstack calibrate`: folders and zips on this machine, without a server.

use std::{
    fs,
    io::{BufRead, BufReader, Cursor},
    path::{Path, PathBuf},
    process::{Command, Output, Stdio},
    sync::OnceLock,
};

use pinstack_science::{
    archive::pack,
    imaging::{
        Raster,
        codec::{self, Metadata},
    },
    synth::{DotTarget, Light, Rig, Scene, Stage, target_stack},
    types::Homography,
};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use tempfile::TempDir;

fn rig() -> Rig {
    Rig::sized(240, 180, 5)
}

type Files = Vec<(String, Vec<u8>)>;

fn pngs(prefix: &str, slices: impl Iterator<Item = Raster>) -> Files {
    let png = |(index, slice): (usize, Raster)| {
        let mut out = Vec::new();
        codec::encode_png(&mut out, &slice, &Metadata::default()).expect("encoded");
        (format!("{prefix}{index}.png"), out)
    };
    slices.enumerate().map(png).collect()
}

/// The slices of a light of the rendered stack, rendered once.
fn light(prefix: &str, light: Light) -> Files {
    static STAGE: OnceLock<Stage> = OnceLock::new();
    let stage = STAGE.get_or_init(|| Stage::new(&rig(), &Scene::insect(3)));
    pngs(prefix, (0..rig().slices()).map(|slice| stage.render(light, slice)))
}

/// A working folder with the slices of the target in `target/` and those of a stack in `beetle/`.
fn pictures() -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let dots = target_stack(&rig(), &DotTarget { code: Some([0, 0]), ..DotTarget::for_rig(&rig(), 12) });
    write(folder.path(), &pngs("target/dots_", dots.into_iter()));
    write(folder.path(), &light("beetle/front/", Light::Front));
    write(folder.path(), &light("beetle/back/", Light::Back));
    fs::write(folder.path().join("beetle/notes.txt"), "a beetle").expect("written");
    folder
}

fn write(folder: &Path, files: &Files) {
    for (name, bytes) in files {
        let path = folder.join(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        fs::write(path, bytes).expect("written");
    }
}

fn command(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pinstack"));
    command.args(arguments).current_dir(folder);
    command
}

fn run(folder: &Path, arguments: &[&str]) -> Output {
    command(folder, arguments).output().expect("it runs")
}

/// The standard output of a command that succeeds.
fn told(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("UTF-8")
}

/// The last line of a command that fails with the code 1.
fn refused(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}: {}", String::from_utf8_lossy(&output.stdout));
    String::from_utf8_lossy(&output.stderr).lines().last().unwrap_or_default().to_owned()
}

fn names(folder: &Path) -> Vec<String> {
    let entry =
        |entry: std::io::Result<fs::DirEntry>| entry.expect("an entry").file_name().into_string().expect("UTF-8");
    let mut names: Vec<String> = fs::read_dir(folder).expect("a folder").map(entry).collect();
    names.sort();
    names
}

const CALIBRATE: [&str; 8] =
    ["calibrate", "target", "--focal-mm", "65", "--pixel-pitch-mm", "0.1", "--target-pitch-mm", "1"];

#[test]
fn a_target_becomes_a_profile_and_a_folder_an_image() {
    let folder = pictures();
    let folder = folder.path();
    let text = told(folder, &CALIBRATE);
    assert!(text.contains("profile  target-profile.json") && text.contains("report   target-profile.html"), "{text}");
    let profile: Value = serde_json::from_slice(&fs::read(folder.join("target-profile.json")).unwrap()).unwrap();
    assert_eq!(profile["homographies"].as_array().map(Vec::len), Some(5));
    let report = fs::read_to_string(folder.join("target-profile.html")).unwrap();
    assert!(report.contains("\"target-profile.overlays/overlay-4.png\"") && !report.contains("overlay?slice"));
    assert!(folder.join("target-profile.overlays/overlay-4.png").exists());
    assert!(refused(folder, &CALIBRATE).contains("target-profile.json exists already; give --force"));

    let fuse = ["fuse", "beetle", "--profile", "target-profile.json", "--height", "auto"];
    let summary = told(folder, &fuse);
    assert!(summary.starts_with("beetle: 5 slices and 5 back-lit of 240 x 180 px"), "{summary}");
    assert!(summary.contains("notes.txt: ignored, because these are not pictures (files_passed_over)"), "{summary}");
    let made = [
        "backlight.png",
        "depth.png",
        "height-sigma.png",
        "height.png",
        "image.png",
        "mask.png",
        "metrics.json",
        "preview.jpg",
        "profile.json",
        "summary.txt",
    ];
    assert_eq!(names(&folder.join("beetle-fused")), made);
    let written = fs::read_to_string(folder.join("beetle-fused/summary.txt")).unwrap();
    assert!(written.contains(summary.lines().nth(1).unwrap()), "{written}");
    assert!(refused(folder, &fuse).contains("beetle-fused has files already; give --force"));

    let again = told(
        folder,
        &["fuse", "./beetle/", "--profile", "beetle-fused/profile.json", "--force", "--mask", "none", "--json"],
    );
    let document: Value = serde_json::from_str(&again).expect("one document");
    assert_eq!(document["views"][0]["files"]["image"], "image.png");
    assert_eq!(
        (&document["views"][0]["options"]["mask"], &document["failed"]),
        (&"none".into(), &Value::Array(vec![]))
    );
    let left = names(&folder.join("beetle-fused"));
    assert_eq!(left, ["depth.png", "image.png", "metrics.json", "preview.jpg", "profile.json", "summary.txt"]);
}

#[test]
fn a_zip_a_folder_and_two_folders_give_the_same_image() {
    let folder = pictures();
    let folder = folder.path();
    told(folder, &CALIBRATE);
    let mut zip = Cursor::new(Vec::new());
    pack(&mut zip, light("front/", Light::Front).into_iter().chain(light("back/", Light::Back))).unwrap();
    fs::write(folder.join("stack.zip"), zip.into_inner()).unwrap();
    write(folder, &light("lit/", Light::Front));
    write(folder, &light("shadow/", Light::Back));
    let fuse = |arguments: &[&str]| told(folder, &[&["fuse", "--profile", "target-profile.json"], arguments].concat());
    fuse(&["beetle", "-o", "one"]);
    fuse(&["stack.zip"]);
    fuse(&["lit", "--back", "shadow", "-o", "three"]);
    for file in ["image.png", "mask.png"] {
        let [a, b, c] = ["one", "stack-fused", "three"].map(|at| fs::read(folder.join(at).join(file)).unwrap());
        assert!(a == b && a == c, "{file}");
    }
}

#[test]
fn views_are_fused_with_one_profile_and_bundled() {
    let folder = pictures();
    let folder = folder.path();
    told(folder, &CALIBRATE);
    let mut members = Vec::new();
    for view in ["pan000_tilt10", "pan020_tilt10"] {
        members.extend(light(&format!("{view}/front/"), Light::Front));
        members.extend(light(&format!("{view}/back/"), Light::Back));
    }
    write(&folder.join("scan"), &members);
    let mut zip = Cursor::new(Vec::new());
    pack(&mut zip, members.into_iter()).unwrap();
    fs::write(folder.join("zipped.zip"), zip.into_inner()).unwrap();
    let profile = ["fuse", "--profile", "target-profile.json", "--bundle", "colmap"];
    let text = told(folder, &[&profile[..], &["scan"]].concat());
    assert!(text.ends_with("scan-fused/: contact-sheet.html bundle-colmap profile.json summary.txt\n"), "{text}");
    let all = ["bundle-colmap", "contact-sheet.html", "pan000_tilt10", "pan020_tilt10", "profile.json", "summary.txt"];
    assert_eq!(names(&folder.join("scan-fused")), all);
    let sheet = fs::read_to_string(folder.join("scan-fused/contact-sheet.html")).unwrap();
    assert!(sheet.contains("src=\"pan020_tilt10/preview.jpg\""), "{sheet}");
    let bundle = folder.join("scan-fused/bundle-colmap");
    assert_eq!(names(&bundle.join("images")), ["pan000_tilt10.png", "pan020_tilt10.png"]);
    assert!(bundle.join("sparse/0/images.txt").exists() && bundle.join("masks/pan000_tilt10.png.png").exists());
    told(folder, &[&profile[..3], &["zipped.zip", "-o", "zipped"]].concat());
    let image = |at: &str| fs::read(folder.join(at).join("pan020_tilt10/image.png")).unwrap();
    assert!(image("scan-fused") == image("zipped"));

    // a stack that fails does not stop the others
    fs::write(folder.join("scan/pan000_tilt10/front/2.png"), "torn").unwrap();
    let failed = run(folder, &[&profile[..3], &["beetle", "scan"]].concat());
    assert_eq!(failed.status.code(), Some(1));
    let error = String::from_utf8_lossy(&failed.stderr);
    assert!(error.ends_with("pinstack: 1 of 3 stacks could not be fused\n"), "{error}");
    assert!(error.contains("scan_pan000_tilt10: scan: ") && error.contains("front/2.png"), "{error}");
    let fused = names(&folder.join("fused"));
    assert_eq!(fused, ["beetle", "contact-sheet.html", "profile.json", "scan_pan020_tilt10", "summary.txt"]);
}

#[test]
fn what_cannot_be_fused_is_refused_with_the_path_as_it_was_typed() {
    let folder = pictures();
    let folder = folder.path();
    told(folder, &CALIBRATE);
    fs::create_dir(folder.join("empty")).unwrap();
    write(folder, &light("one/", Light::Front).into_iter().take(1).collect());
    write(folder, &light("few/", Light::Front).into_iter().take(4).collect());
    fs::write(folder.join("torn.json"), "{").unwrap();
    for (arguments, part) in [
        (&["beetl"] as &[&str], "cannot read beetl (No such file"),
        (&["empty"], "empty is empty; add the slices"),
        (&["./one"], "./one: the folder has 1 front-light slice (0.png); a focus stack has at least 2"),
        (&["few"], "few: the folder has 4 front-light slices, the profile target-profile.json has 5"),
        (&["beetle", "-o", "beetle/out"], "beetle/out is in beetle, so its results would be taken for slices"),
        (&["beetle", "few", "--back", "lit"], "--back is the folder of the back light of one folder"),
        (&["target-profile.json"], "target-profile.json: "),
    ] {
        let error = refused(folder, &[&["fuse", "--profile", "target-profile.json"], arguments].concat());
        assert!(error.starts_with("pinstack: ") && error.contains(part), "{arguments:?}: {error}");
    }
    assert!(refused(folder, &["fuse", "few", "--profile", "torn.json", "-o", "x"]).contains("torn.json: "));
    let nowhere = refused(folder, &["fuse", "few", "--rig", "a", "--lens", "b", "--data-dir", "none", "-o", "y"]);
    assert!(nowhere.contains("there is no database in none"), "{nowhere}");
    let wrong = run(folder, &["fuse", "few", "--method", "magic"]);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&wrong.stderr).contains("method is 'magic'; it must be one of"));
    assert!(refused(folder, &["fuse", "few", "--jpeg-quality", "0"]).contains("jpeg_quality must be 1 to 100"));
    let target = refused(folder, &["calibrate", "beetle", "--from", "target"]);
    assert!(target.starts_with("pinstack: beetle: "), "{target}");
    let left: Vec<PathBuf> =
        names(folder).into_iter().filter(|name| name.starts_with('.')).map(PathBuf::from).collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn a_signal_stops_the_work_and_leaves_no_scratch_files() {
    let folder = pictures();
    let folder = folder.path();
    told(folder, &CALIBRATE);
    for view in 0..20 {
        write(&folder.join("scan"), &light(&format!("view{view:02}/front/"), Light::Front));
    }
    let mut fuse = command(folder, &["fuse", "scan", "--profile", "target-profile.json"]);
    let mut fuse = fuse.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("it runs");
    let mut lines = BufReader::new(fuse.stderr.take().expect("a pipe")).lines();
    let begun = lines.find(|line| line.as_ref().is_ok_and(|line| line.starts_with("view00: ")));
    assert!(begun.is_some());
    kill_process(Pid::from_child(&fuse), Signal::INT).expect("it runs");
    let last = lines.map(|line| line.expect("UTF-8")).last().unwrap_or_default();
    assert_eq!(fuse.wait().expect("it ends").code(), Some(1));
    assert!(last.starts_with("pinstack: stopped: "), "{last}");
    // nothing may be fused yet: then the folder is gone too
    let out = folder.join("scan-fused");
    let left = if out.exists() { names(&out) } else { Vec::new() };
    assert!(left.iter().all(|name| !name.starts_with('.')), "{left:?}");
}

#[test]
fn without_a_target_the_profile_is_made_from_the_pictures() {
    let rig = Rig { softness_px: 0.5, ..Rig::sized(420, 280, 5) };
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let stage = Stage::new(&rig, &Scene::weave(1));
    write(folder, &pngs("weave/front/", (0..rig.slices()).map(|slice| stage.render(Light::Front, slice))));
    told(folder, &["fuse", "weave"]);
    let made = folder.join("weave-fused");
    assert!(made.join("image.png").exists(), "{:?}", names(&made));
    let error_px = |path: &Path| {
        let profile: Value = serde_json::from_slice(&fs::read(path).expect("a profile")).expect("JSON");
        let matrices: Vec<Homography> = serde_json::from_value(profile["homographies"].clone()).expect("matrices");
        let off = |(i, h): (usize, &Homography)| h.corner_distance(&rig.homography(i), 420, 280);
        matrices.iter().enumerate().map(off).fold(0.0, f64::max)
    };
    assert!(error_px(&made.join("profile.json")) < 0.6);
    let text = told(folder, &["calibrate", "weave", "--from", "stacks", "-o", "weave.json"]);
    assert!(text.contains("Usable") && text.contains("calibrated_by_stacks"), "{text}");
    let refine = ["calibrate", "weave", "--refine", "weave.json", "-o", "again.json"];
    let text = told(folder, &refine);
    assert!(text.contains("no drift since the profile that was given"), "{text}");
    assert!(refused(folder, &[&refine[..], &["--focal-mm", "65", "--force"]].concat()).contains("focal_mm"));
    assert!(error_px(&folder.join("weave.json")) < 0.6);
    let report = fs::read_to_string(folder.join("weave.html")).expect("a report");
    assert!(report.contains("Pictures of objects, without a dot target"));
}
