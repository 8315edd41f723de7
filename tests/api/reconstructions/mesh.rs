//! Meshes by an outside program, which a test writes.

use std::{fs, os::unix::fs::PermissionsExt, time::Duration};

use serde_json::{Value, json};

use super::{WORKS, camera, ended, post, program, text, workers_with};
use crate::app::{TestApp, problem};

const TRIANGLE: &str = "ply\\nformat ascii 1.0\\nelement vertex 3\\nproperty float x\\nproperty float y\\nproperty float z\\n\
                        element face 1\\nproperty list uchar int vertex_indices\\nend_header\\n\
                        0 0 0\\n1 0 0\\n0 1 0\\n3 0 1 2\\n";

/// A server whose scan `bee` has four views without masks, so that no hull takes time.
async fn without_masks() -> TestApp {
    let app = TestApp::start().await;
    app.with_scan("bee").await;
    for pan in [0, 20, 40, 60] {
        app.with_stack(&format!("&scan=bee&pan_deg={pan}&tilt_deg=0")).await;
        let job = app.claim().await;
        app.finish_stack(&job, |outcome| {
            outcome.image.intrinsics = Some(camera());
            outcome.artifacts.retain(|artifact| artifact.name != "mask");
        })
        .await;
    }
    app
}

/// Reconstructs the scan with a command for meshes that does this: `$1` is the model, `$2` the images, `$3` the output.
async fn reconstructed(app: &TestApp, does: &str, most_time: Duration) -> Value {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("mesh it");
    fs::write(&path, format!("#!/bin/sh\n{does}\n")).expect("a script");
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).expect("a mode");
    let command = [path.to_str().expect("plain"), "{model}", "{images}", "{output}"].map(str::to_owned).to_vec();
    let pool = workers_with(app, Some(&program(&folder, WORKS)), command, most_time);
    let made = ended(app, &post(app).await).await;
    pool.shutdown(Duration::from_secs(10)).await;
    assert_eq!(made["state"], "succeeded", "{made}");
    assert_eq!(app.spooled(), 0, "nothing is left of {does}");
    made
}

/// Why there is no mesh.
fn no_mesh(made: &Value) -> &str {
    let findings = made["result"]["findings"].as_array().expect("a list");
    let found = findings.iter().find(|one| one["code"] == "no_mesh").unwrap_or_else(|| panic!("{made}"));
    assert!(made["links"].get("mesh").is_none() && made["links"]["points"].is_string(), "{made}");
    found["detail"].as_str().expect("a sentence")
}

#[tokio::test]
async fn an_outside_program_makes_the_mesh_of_the_model_and_the_images() {
    let app = without_masks().await;
    let hour = Duration::from_secs(3600);
    let does =
        format!(r#"test -s "$1/points3D.txt" && test -s "$2/pan000_tilt00.png" && printf '{TRIANGLE}' > "$3.ply""#);
    let made = reconstructed(&app, &does, hour).await;
    let path = made["links"]["mesh"].as_str().unwrap_or_else(|| panic!("{made}"));
    let answer = app.get(path).send().await.expect("an answer");
    assert_eq!(answer.headers()["content-type"], "application/octet-stream");
    assert!(answer.headers()["content-disposition"].to_str().expect("ASCII").contains("mesh.ply"), "{answer:?}");
    assert!(text(&app, path).await.ends_with("3 0 1 2\n"));
    let page = text(&app, "/scans/bee").await;
    assert!(page.contains("data-mesh=") && page.contains("name=\"mesh\" checked"), "{page}");

    let made = reconstructed(&app, r#"printf 'glTF\002\000\000\000\014\000\000\000' > "$3.glb""#, hour).await;
    let answer = app.get(made["links"]["mesh"].as_str().expect("a path")).send().await.expect("an answer");
    assert_eq!(answer.headers()["content-type"], "model/gltf-binary");
}

#[tokio::test]
async fn whatever_is_wrong_with_the_mesh_the_rest_of_the_reconstruction_is_there() {
    let app = without_masks().await;
    let hour = Duration::from_secs(3600);
    for (does, most_time, says) in [
        ("echo 'no device' >&2; exit 3", hour, "mesh_command failed (exit status: 3); its last words: "),
        ("kill -SEGV $$", hour, "mesh_command failed (signal: 11"),
        ("sleep 1000 & wait", Duration::from_secs(8), "was stopped during the command of mesh_command"),
        ("exit 0", hour, "wrote neither {output}.ply nor {output}.glb"),
        (r#"echo "solid of another kind" > "$3.ply""#, hour, "wrote a file that is no PLY with faces"),
        (r#"ln -s /etc/passwd "$3.ply""#, hour, "wrote neither"),
        (r#"head -c 300000000 /dev/zero > "$3.ply""#, hour, "wrote more than the"),
    ] {
        let made = reconstructed(&app, does, most_time).await;
        let why = no_mesh(&made);
        assert!(why.starts_with("there is no mesh: ") && why.contains(says), "{why}");
        assert_eq!(made["result"]["registered"], json!(3));
        let path = format!("{}/mesh", made["links"]["self"].as_str().expect("a path"));
        problem(app.get(&path).send().await.unwrap(), 404, "no_result").await;
    }
}
