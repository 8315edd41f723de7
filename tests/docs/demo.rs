//! `pinstack demo --scan`: its figures are good, and it leaves the files that docs/TUTORIAL.md needs.

use std::{fs, process::Command};

use serde_json::{Value, json};

#[test]
fn the_scan_of_the_demo_is_fused_and_its_fault_found() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("scan");
    let mut demo = Command::new(env!("CARGO_BIN_EXE_pinstack"));
    demo.args(["demo", "--scan", "--width", "360", "--slices", "7", "--pans", "6", "--out"]).arg(&out);
    let done = demo.output().expect("it runs");
    let told = String::from_utf8_lossy(&done.stdout);
    assert!(done.status.success(), "{told}\n{}", String::from_utf8_lossy(&done.stderr));
    println!("{told}");
    for part in ["calibration ", "outliers ", "fused views   12:", "masks ", "bundle        12 poses", "scan.zip"] {
        assert!(told.contains(part), "{part} is not in {told}");
    }
    let figures: Value = serde_json::from_slice(&fs::read(out.join("figures.json")).expect("a file")).expect("JSON");
    let number = |name: &str| figures[name].as_f64().unwrap_or_else(|| panic!("no {name} in {figures}"));
    assert!(number("worst_corner_px") < 0.5, "{figures}");
    assert!((number("principal_distance_mm") / number("true_principal_distance_mm") - 1.0).abs() < 2e-3, "{figures}");
    assert_eq!(figures["outliers"], json!([figures["knocked"]]), "{figures}");
    assert_eq!(figures["outliers_after_retake"], json!([]), "{figures}");
    assert!(number("worst_centre_mm") < 1e-6, "{figures}");
    for view in figures["views"].as_array().expect("views") {
        let (psnr, iou) = (view["psnr_db"].as_f64().expect("dB"), view["iou"].as_f64().expect("a ratio"));
        assert!(psnr > 24.0 && psnr > number("knocked_psnr_db") && iou > 0.97, "{view}");
    }
    for file in ["target.zip", "retake.zip", "truth/surface.ply", "truth/sparse/0/images.txt", "bundle.zip"] {
        assert!(out.join(file).exists(), "{file}");
    }
}

#[test]
fn options_of_a_scan_need_the_scan() {
    for (arguments, told) in [
        (["demo", "--render-only"].as_slice(), "--scan"),
        (&["demo", "--pans", "6"], "--scan"),
        (&["demo", "--scan", "--tilts", "0,80"], "from -30 to 60 degrees"),
    ] {
        let done = Command::new(env!("CARGO_BIN_EXE_pinstack")).args(arguments).output().expect("it runs");
        let error = String::from_utf8_lossy(&done.stderr);
        assert!(!done.status.success() && error.contains(told), "{arguments:?}: {error}");
    }
}
