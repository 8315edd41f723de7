//! Zips made by other programs.

use std::process::Command;

use crate::{
    run,
    server::{Server, small_rig, write_slices},
};

/// Makes `stack.zip` with `command` (run by sh in the folder of `front` and `back`) and fuses it.
fn fuse_stack_zipped_by(command: &str) {
    let server = Server::start();
    let slices = server.folder.path().join("view 01");
    write_slices(&slices);
    server.put_profile(&small_rig());
    run(Command::new("sh").args(["-c", command]).current_dir(&slices));
    let stack = server.fuse(&slices.join("stack.zip"), "");
    assert_eq!(stack["state"], "succeeded", "{stack}");
    assert!(!stack["metrics"]["mask"].is_null(), "the back light was found: {stack}");
}

#[test]
#[ignore = "needs curl, zip"]
fn a_zip_by_info_zip_is_accepted() {
    fuse_stack_zipped_by("zip -q -r stack.zip front back");
}

#[test]
#[ignore = "needs curl, zip"]
fn a_zip_by_info_zip_written_to_a_pipe_is_accepted() {
    // Sizes and checksums stand behind the members then (data descriptors).
    fuse_stack_zipped_by("zip -q -r - front back | cat > stack.zip");
}

#[test]
#[ignore = "needs curl, 7z"]
fn a_stored_zip_by_7z_is_accepted() {
    fuse_stack_zipped_by("7z a -bd -tzip -mx0 stack.zip front back");
}

#[test]
#[ignore = "needs curl, 7z"]
fn a_deflate64_zip_by_7z_in_a_wrapper_folder_is_accepted() {
    fuse_stack_zipped_by(
        "mkdir -p '../wrap/view 01' && cp -r front back '../wrap/view 01' && cd ../wrap && 7z a -bd -tzip -mm=Deflate64 '../view 01/stack.zip' .",
    );
}

#[test]
#[ignore = "needs curl, python3"]
fn a_zip_by_python_with_zip64_and_backslashes_is_accepted() {
    fuse_stack_zipped_by(
        r#"python3 - <<'END'
import glob, zipfile
with zipfile.ZipFile('stack.zip', 'w', zipfile.ZIP_DEFLATED) as z:
    for name in glob.glob('*/*.jpg'):
        info = zipfile.ZipInfo(name.replace('/', '\\'))
        info.filename = name.replace('/', '\\')
        with z.open(info, 'w', force_zip64=True) as member:
            member.write(open(name, 'rb').read())
END"#,
    );
}

#[test]
#[ignore = "needs curl, 7z"]
fn an_encrypted_zip_by_7z_is_refused_with_a_reason() {
    let server = Server::start();
    let slices = server.folder.path().join("view");
    write_slices(&slices);
    server.put_profile(&small_rig());
    run(Command::new("7z").args(["a", "-bd", "-tzip", "-psecret", "stack.zip", "front", "back"]).current_dir(&slices));
    let problem = server.fuse(&slices.join("stack.zip"), "");
    assert_eq!(
        (problem["status"].as_u64(), problem["code"].as_str()),
        (Some(422), Some("unsupported_archive")),
        "{problem}"
    );
}

#[test]
#[ignore = "needs curl, zip"]
fn a_form_sent_by_curl_gives_the_same_result_as_a_plain_body() {
    let server = Server::start();
    let slices = server.folder.path().join("view");
    write_slices(&slices);
    server.put_profile(&small_rig());
    run(Command::new("zip").args(["-q", "-r", "stack.zip", "front", "back"]).current_dir(&slices));
    let zip = format!("stack=@{}", slices.join("stack.zip").display());
    let stack = server.curl(
        &[
            "-H",
            "Prefer: wait=60",
            "-F",
            "rig=rig",
            "-F",
            "lens=lens",
            "-F",
            r#"options={"label":"by form","mask":"none"}"#,
            "-F",
            &zip,
        ],
        "/v1/stacks",
    );
    assert_eq!(stack["state"], "succeeded", "{stack}");
    assert_eq!(stack["options"]["label"], "by form", "{stack}");
    assert!(stack["metrics"]["mask"].is_null(), "mask=none was asked for: {stack}");
}
