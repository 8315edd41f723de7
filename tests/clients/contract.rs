//! The service against its OpenAPI document, by Schemathesis: valid and invalid requests, every answer checked against
//! the document.

use std::{path::Path, process::Command};

use serde_json::{Value, json};

use crate::{
    run,
    server::{Server, small_rig, write_stack_of},
};

/// A service that requires a token, with the ids that the tests need.
struct Furnished {
    server: Server,
    authorization: String,
    /// Ids of a finished stack, a failed calibration and a resumable upload, under the names in
    /// `openapi/schemathesis.toml`.
    ids: [(&'static str, String); 3],
}

/// A service with one resource of each kind, so that not every answer is "not found".
fn furnished() -> Furnished {
    let (server, token) = Server::start_with_a_token();
    let authorization = format!("Authorization: Bearer {token}");
    let send = |arguments: &[&str], path: &str| {
        server.curl(&[&["-H", &authorization, "-H", "Prefer: wait=60"], arguments].concat(), path)
    };
    let rig = small_rig();
    let homographies: Vec<_> = (0..rig.slices()).map(|i| rig.homography(i)).collect();
    let profile = json!({
        "image_width": rig.width, "image_height": rig.height, "reference_index": rig.reference, "homographies": homographies
    });
    let kept = send(
        &["-X", "PUT", "-H", "Content-Type: application/json", "-d", &profile.to_string()],
        "/v1/profiles/rig/lens",
    );
    assert_eq!(kept["revision"], 1, "{kept}");
    let zip = server.folder.path().join("stack.zip");
    write_stack_of(&rig, &zip);
    let file = ["-X", "POST", "-H", "Content-Type: application/zip", "-T", zip.to_str().expect("a plain path")];
    let stack = send(&file, "/v1/stacks?rig=rig&lens=lens");
    assert_eq!(stack["state"], "succeeded", "{stack}");
    // there are no dots in it
    let calibration = send(&file, "/v1/profiles/other/lens/calibrations");
    assert_eq!(calibration["state"], "failed", "{calibration}");
    let upload = run(Command::new("curl")
        .args(["-sS", "-o", "/dev/null", "-w", "%header{location}", "-X", "POST", "-H", &authorization])
        .args([
            "-H",
            "Tus-Resumable: 1.0.0",
            "-H",
            "Upload-Length: 100",
            "-H",
            "Upload-Metadata: rig cmln,lens bGVucw==",
        ])
        .arg(format!("{}/v1/uploads", server.url)));
    let upload = upload.trim().trim_start_matches("/v1/uploads/").to_owned();
    let id = |job: &Value| job["id"].as_str().expect("an id").to_owned();
    let ids = [("STACK_ID", id(&stack)), ("CALIBRATION_ID", id(&calibration)), ("UPLOAD_ID", upload)];
    Furnished { server, authorization, ids }
}

/// Runs Schemathesis with these arguments besides those of its settings.
fn conforms(arguments: &[&str]) {
    let Furnished { server, authorization, ids } = furnished();
    let openapi = Path::new(env!("CARGO_MANIFEST_DIR")).join("openapi");
    let output = Command::new("schemathesis")
        .arg("--config-file")
        .arg(openapi.join("schemathesis.toml"))
        .args(["run", &format!("{}/openapi.json", server.url), "--no-color", "-H", &authorization])
        .args(arguments)
        .envs(ids)
        .env("PYTHONPATH", openapi)
        // what it remembers of earlier runs would make this one depend on them
        .current_dir(server.folder.path())
        .output()
        .expect("schemathesis can be started");
    let told = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{told}\n{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
#[ignore = "needs curl, schemathesis"]
fn the_service_conforms_to_its_openapi_document() {
    conforms(&["--max-examples", "2"]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_requests_are_answered_as_the_openapi_document_says() {
    conforms(&[]);
}
