//! Clients generated from the OpenAPI document of the program under test: each runs a complete session against the
//! service. An error reported by a generator fails the test.

use std::{fs, path::Path, process::Command};

use pinstack_science::{
    archive,
    imaging::codec,
    synth::{DotTarget, Rig, target_stack},
};

use crate::{
    run,
    server::{Server, small_rig, write_stack_of},
};

/// Writes the OpenAPI document of the program.
fn document(folder: &Path) -> String {
    let text = run(Command::new(env!("CARGO_BIN_EXE_pinstack")).arg("openapi"));
    let file = folder.join("openapi.json");
    fs::write(&file, text).expect("the document");
    file.to_string_lossy().into_owned()
}

/// Writes the zip of a dot target that can be calibrated from.
fn write_target(zip: &Path) {
    let rig = Rig::sized(240, 180, 5);
    let slices = target_stack(&rig, &DotTarget::for_rig(&rig, 12));
    let members = slices.iter().enumerate().map(|(i, slice)| (format!("{i}.jpg"), codec::encode_jpeg(slice, 95)));
    archive::pack(fs::File::create(zip).expect("a file"), members).expect("a zip");
}

/// A profile for [`small_rig`], as JSON.
fn write_profile(file: &Path) {
    let rig = small_rig();
    let profile = serde_json::json!({
        "image_width": rig.width, "image_height": rig.height, "reference_index": rig.reference,
        "homographies": (0..rig.slices()).map(|i| rig.homography(i)).collect::<Vec<_>>(),
    });
    fs::write(file, profile.to_string()).expect("the profile");
}

/// Runs `script`, which uses the client in `folder`, against a service that requires a token.
fn run_session(server: &Server, token: &str, folder: &Path, script: &str) {
    let files = server.folder.path();
    write_profile(&files.join("profile.json"));
    write_target(&files.join("target.zip"));
    write_stack_of(&small_rig(), &files.join("stack.zip"));
    let program = files.join("day.py");
    fs::write(&program, script).expect("a script");
    let told = run(Command::new("python3")
        .arg(&program)
        .args([&server.url, token])
        .arg(files)
        .env("PYTHONPATH", folder)
        .env("PYTHONDONTWRITEBYTECODE", "1"));
    assert_eq!(told.trim(), "the day is over");
}

#[test]
#[ignore = "needs python3, openapi-python-client"]
fn a_client_by_openapi_python_client_runs_a_whole_session() {
    let (server, token) = Server::start_with_a_token();
    let folder = server.folder.path().join("made");
    fs::create_dir(&folder).expect("a folder");
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("openapi/openapi-python-client.yml");
    let made = Command::new("openapi-python-client")
        .args(["generate", "--meta", "none", "--fail-on-warning", "--path", &document(&folder), "--config"])
        .arg(config)
        .arg("--output-path")
        .arg(folder.join("pinstack_client"))
        .output()
        .expect("the generator starts");
    let told = String::from_utf8_lossy(&made.stdout);
    assert!(made.status.success() && !told.contains("WARNING"), "it does not understand the document:\n{told}");
    run_session(&server, &token, &folder, include_str!("generated/openapi_python_client.py"));
}

#[test]
#[ignore = "needs python3, java, openapi-generator-cli, pydantic"]
fn a_client_by_openapi_generator_runs_a_whole_session() {
    let (server, token) = Server::start_with_a_token();
    let folder = server.folder.path().join("made");
    fs::create_dir(&folder).expect("a folder");
    let made = Command::new("openapi-generator-cli")
        .args(["generate", "-g", "python", "--additional-properties", "packageName=pinstack_client"])
        .args(["--global-property", "apiTests=false,modelTests=false,apiDocs=false,modelDocs=false"])
        .args(["-i", &document(&folder), "-o"])
        .arg(&folder)
        .output()
        .expect("the generator starts");
    let told = format!("{}{}", String::from_utf8_lossy(&made.stdout), String::from_utf8_lossy(&made.stderr));
    // its warnings speak of its own support of OpenAPI 3.1 and of names that Python reserves
    let complaints: Vec<&str> = told.lines().filter(|line| line.contains("ERROR")).collect();
    assert!(made.status.success() && complaints.is_empty(), "it does not understand the document: {complaints:#?}");
    run_session(&server, &token, &folder, include_str!("generated/openapi_generator.py"));
}
