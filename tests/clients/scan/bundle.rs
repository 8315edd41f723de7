//! The bundle of a scan on the running service: one canvas and one camera, the same file names after a rerun, a
//! download that was cut off, and the same file by the command line.

use std::{collections::BTreeMap, fs, io::Read, path::Path, process::Command};

use serde_json::{Value, json};

use crate::{
    run,
    server::{Server, small_rig, write_stack_of},
};

const JSON: [&str; 2] = ["-H", "Content-Type: application/json"];

/// Stores the true homographies with this principal distance. The pixels do not depend on it.
fn put_profile(server: &Server, principal_distance_mm: f64) {
    let rig = small_rig();
    let body = json!({
        "image_width": rig.width, "image_height": rig.height, "reference_index": rig.reference,
        "homographies": (0..rig.slices()).map(|i| rig.homography(i)).collect::<Vec<_>>(),
        "pixel_pitch_mm": 0.0061, "principal_distance_mm": principal_distance_mm,
    });
    let body = body.to_string();
    let profile = server.curl(&[&["-X", "PUT", "-d", &body], &JSON[..]].concat(), "/v1/profiles/rig/lens");
    assert!(profile["revision"].is_number(), "{profile}");
}

/// Fuses every view of the scan again.
fn rerun(server: &Server, changes: &Value) {
    let body = changes.to_string();
    let made = server.curl(&[&["-X", "POST", "-d", &body], &JSON[..]].concat(), "/v1/scans/bee/rerun");
    for view in made["views"].as_array().unwrap_or_else(|| panic!("refused: {made}")) {
        let stack = server.curl(&[], view["stack"].as_str().expect("a stack"));
        let stack = server.finished(&stack);
        assert_eq!(stack["state"], "succeeded", "{stack}");
    }
}

/// Names and contents of a zip.
fn members(zip: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut archive = zip::ZipArchive::new(fs::File::open(zip).expect("a file")).expect("a zip");
    let count = archive.len();
    let member = |at: usize| {
        let mut file = archive.by_index(at).expect("a member");
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).expect("with the right CRC");
        (file.name().expect("UTF-8").into_owned(), bytes)
    };
    (0..count).map(member).collect()
}

const BUNDLE: &str = "/v1/scans/bee/bundle?layout=colmap";

#[test]
#[ignore = "needs curl"]
fn a_scan_keeps_one_camera_and_its_file_names_and_its_bundle_can_be_resumed() {
    let server = Server::start();
    let zip = server.folder.path().join("stack.zip");
    write_stack_of(&small_rig(), &zip);
    put_profile(&server, 121.0);
    let scan = json!({ "rig": "rig", "lens": "lens", "radius_mm": 141 }).to_string();
    server.curl(&[&["-X", "PUT", "-d", &scan], &JSON[..]].concat(), "/v1/scans/bee");
    for (pan, crop) in [(0, "none"), (20, "none"), (40, "12,10,200,140")] {
        let stack = server.finished(&server.fuse(&zip, &format!("&scan=bee&pan_deg={pan}&tilt_deg=6&crop={crop}")));
        assert_eq!(stack["state"], "succeeded", "{stack}");
    }
    let refused = server.curl(&[], BUNDLE);
    let detail = refused["detail"].as_str().expect("a sentence");
    assert_eq!(refused["code"], "scan_mismatch", "{refused}");
    assert!(detail.starts_with("pan040_tilt06 (200 x 140 px) differ"), "{detail}");

    // as the sentence says
    rerun(&server, &json!({ "crop": "none", "profile_revision": null }));
    let first = server.folder.path().join("first.zip");
    server.download(&[], BUNDLE, &first);
    let names: Vec<String> = members(&first).into_keys().collect();
    for name in ["images/pan040_tilt06.png", "masks/pan040_tilt06.png.png", "sparse/0/cameras.txt", "README.txt"] {
        assert!(names.iter().any(|found| found == name), "no {name} in {names:?}");
    }

    // the same homographies, another principal distance: one view alone, then all
    put_profile(&server, 130.0);
    let odd = server.finished(&server.fuse(&zip, "&scan=bee&pan_deg=20&tilt_deg=6"));
    assert_eq!(odd["state"], "succeeded", "{odd}");
    let refused = server.curl(&[], BUNDLE);
    let detail = refused["detail"].as_str().expect("a sentence");
    assert!(detail.starts_with("pan020_tilt06 (another principal distance"), "{detail}");
    let table = server.curl(&[], "/v1/scans/bee");
    assert_eq!(table["findings"][0]["code"], "mixed_cameras", "{table}");
    rerun(&server, &json!({ "profile_revision": null }));
    let second = server.folder.path().join("second.zip");
    server.download(&[], BUNDLE, &second);
    let (before, after) = (members(&first), members(&second));
    assert_eq!(after.keys().collect::<Vec<_>>(), names.iter().collect::<Vec<_>>(), "the names are the same");
    assert_ne!(before["sparse/0/cameras.txt"], after["sparse/0/cameras.txt"]);
    let focal = format!("{}", 130.0 / 0.0061);
    let cameras = String::from_utf8(after["sparse/0/cameras.txt"].clone()).expect("text");
    assert!(cameras.contains(&format!("PINHOLE 240 160 {focal} {focal}")), "{cameras}");

    // a download that ended early goes on where it ended
    let whole = fs::read(&second).expect("the bundle");
    let part = server.folder.path().join("part.zip");
    fs::write(&part, &whole[..whole.len() / 3]).expect("written");
    server.download(&["-C", "-"], BUNDLE, &part);
    assert!(fs::read(&part).expect("the bundle") == whole, "the resumed file is the same");

    let written = server.folder.path().join("written.zip");
    let bundle = |out: &Path| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pinstack"));
        command.args(["bundle", "bee", "--layout", "colmap", "--out"]).arg(out);
        command.arg("--data-dir").arg(server.folder.path().join("data"));
        command
    };
    assert!(run(&mut bundle(&written)).contains(&format!("{} bytes", whole.len())));
    assert!(fs::read(&written).expect("the bundle") == whole, "the command line writes the same file");
    let again = bundle(&written).output().expect("the command");
    assert!(!again.status.success() && String::from_utf8_lossy(&again.stderr).contains("written.zip"), "{again:?}");
}
