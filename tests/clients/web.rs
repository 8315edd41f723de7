//! The web pages in Chromium, driven by Playwright: one scenario of `web/suite.cjs` per test.

use std::{fs, path::Path, process::Command};

use pinstack::http::pages::model::model_viewer;
use pinstack_science::{
    archive,
    imaging::codec,
    synth::{Light, Rig, Scene, Stage},
    types::Homography,
};

use crate::{
    run,
    server::{Server, profile_of, small_rig, write_slices, write_stack_of},
};

const SUITE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/clients/web/suite.cjs");

/// Writes what the scenarios send: a zip, and folders of slices.
fn write_files(folder: &Path) {
    write_stack_of(&small_rig(), &folder.join("stack.zip"));
    fs::write(folder.join("notes.txt"), "nothing to see").expect("a file");
    write_slices(&folder.join("slices"));
    for view in ["pan000_tilt00", "pan020_tilt00"] {
        for light in ["front", "back"] {
            let to = folder.join("views").join(view).join(light);
            fs::create_dir_all(&to).expect("a folder");
            for slice in fs::read_dir(folder.join("slices").join(light)).expect("a folder") {
                let slice = slice.expect("a slice");
                fs::copy(slice.path(), to.join(slice.file_name())).expect("a copy");
            }
        }
    }
}

/// Writes what the page of a model has, for the scenario that shows one: the test makes the files of the model.
fn write_model_page(server: &Server) {
    let [points, cameras, hull] = ["points", "cameras", "hull"].map(|name| format!("/model-test/{name}"));
    let viewer = model_viewer(Some(&points), Some(&cameras), Some(&hull), Some(&hull)).into_string();
    fs::write(server.folder.path().join("model.html"), viewer).expect("a file");
}

fn scenario(name: &str, server: &Server) {
    write_files(server.folder.path());
    let chromium = run(Command::new("sh").args(["-c", "command -v chromium"]));
    let told = run(Command::new("node")
        .arg(SUITE)
        .args([name, &server.url])
        .arg(server.folder.path())
        .env("CHROMIUM", chromium.trim()));
    assert!(told.contains("done"), "{told}");
}

fn with_profile() -> Server {
    let server = Server::start();
    server.put_profile(&small_rig());
    server
}

/// A server with a stack and a scan.
fn with_work() -> Server {
    let server = with_profile();
    let zip = server.folder.path().join("first.zip");
    write_stack_of(&small_rig(), &zip);
    let scan = r#"{"rig":"rig","lens":"lens"}"#;
    server.curl(&["-X", "PUT", "-H", "Content-Type: application/json", "-d", scan], "/v1/scans/bee");
    for pan in [0, 20] {
        let stack = server.fuse(&zip, &format!("&scan=bee&pan_deg={pan}&tilt_deg=0"));
        assert_eq!(stack["state"], "succeeded", "{stack}");
    }
    server
}

/// A server with a stack for each kind of button that findings have. One of them is a view of the scan `bee`.
fn with_findings() -> Server {
    let server = Server::start();
    let rig = Rig::sized(480, 360, 13);
    server.put_profile(&rig);
    let stage = Stage::new(&rig, &Scene::insect(1));
    let jpegs = |light| (0..rig.slices()).map(|k| codec::encode_jpeg(&stage.render(light, k), 92)).collect::<Vec<_>>();
    let lights = [Light::Front, Light::Back].map(jpegs);
    let zipped = |name: &str, folders: [&str; 2]| {
        let zip = server.folder.path().join(name);
        let members = folders.into_iter().zip(&lights).flat_map(|(folder, slices)| {
            slices.iter().enumerate().map(move |(k, jpeg)| (format!("{folder}/{k:02}.jpg"), jpeg.clone()))
        });
        archive::pack(fs::File::create(&zip).expect("a file"), members).expect("a zip");
        zip
    };
    let (right, exchanged) = (zipped("right.zip", ["front", "back"]), zipped("exchanged.zip", ["back", "front"]));
    let put = |body: &str, path: &str| {
        server.curl(&["-X", "PUT", "-H", "Content-Type: application/json", "-d", body], path);
    };
    put(r#"{"rig":"rig","lens":"lens"}"#, "/v1/scans/bee");
    for (zip, query) in [
        (&right, "&scan=bee&pan_deg=0&tilt_deg=0"),
        (&exchanged, "&scan=bee&pan_deg=20&tilt_deg=0&label=exchanged"),
        (&right, "&scan=bee&pan_deg=0&tilt_deg=10"),
        (&right, "&scan=bee&pan_deg=20&tilt_deg=10"),
        (&right, "&order=reverse&label=reversed"),
        (&right, "&method=pyramid&r1=9&label=unused"),
    ] {
        let stack = server.fuse(zip, query);
        assert_eq!(stack["state"], "succeeded", "{stack}");
    }
    // a revision with a wrong magnification of each slice, and then the right one again
    let profile = profile_of(&rig);
    let mut wrong = profile.clone();
    wrong["homographies"] = (0..rig.slices())
        .map(|k| {
            let scale = 1.0 + 0.05 * (k as f64 - rig.reference as f64) / rig.slices() as f64;
            let shift = [479.0 / 2.0 * (1.0 - scale), 359.0 / 2.0 * (1.0 - scale)];
            rig.homography(k).then(&Homography::similarity(scale, shift)).expect("an invertible homography")
        })
        .map(|homography| serde_json::json!(homography))
        .collect();
    put(&wrong.to_string(), "/v1/profiles/rig/lens");
    assert_eq!(server.fuse(&right, "&label=misfit")["state"], "succeeded");
    put(&profile.to_string(), "/v1/profiles/rig/lens");
    server
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn a_folder_of_slices_becomes_a_picture_that_can_be_compared() {
    scenario("upload", &with_profile());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn a_folder_of_views_becomes_a_scan() {
    scenario("scan", &with_profile());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn a_folder_of_views_calibrates_a_rig_without_a_target() {
    scenario("no_target", &with_profile());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn an_upload_goes_on_after_a_cut_line_and_after_the_page_was_closed() {
    scenario("cut", &with_profile());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn an_upload_can_be_paused_and_removed() {
    scenario("pause", &with_profile());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn a_waiting_stack_is_cancelled_and_deleted_after_confirmation() {
    let server = Server::start_without_workers();
    server.put_profile(&small_rig());
    scenario("cancel", &server);
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn an_error_is_told_in_the_words_of_the_server() {
    scenario("error", &with_profile());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn the_viewer_says_that_a_picture_is_loading_or_cannot_be_loaded() {
    scenario("loading", &with_work());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn the_pages_work_without_a_mouse() {
    scenario("keyboard", &with_work());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn the_pages_have_no_fault_that_axe_finds() {
    scenario("axe", &with_work());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn the_ball_of_views_is_turned_and_leads_to_the_stacks() {
    scenario("ball", &with_work());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn every_view_of_a_scan_is_on_its_page_whatever_the_width() {
    scenario("widths", &with_work());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn a_height_map_is_shown_as_a_relief() {
    scenario("relief", &with_work());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn the_viewer_tells_values_and_lengths_by_mouse_keyboard_and_finger() {
    scenario("values", &with_work());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn two_pictures_are_compared_under_a_divider_by_mouse_keyboard_and_finger() {
    scenario("divider", &with_work());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn a_slider_steps_through_the_slices_where_the_person_looks() {
    scenario("slices", &with_work());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn runs_of_one_stack_stand_beside_each_other() {
    scenario("runs", &with_work());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn a_model_shows_points_cameras_and_surface() {
    let server = with_work();
    write_model_page(&server);
    scenario("model", &server);
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn without_webgl_the_text_remains() {
    scenario("no_webgl", &with_work());
}

#[test]
#[ignore = "needs node"]
fn files_of_models_and_height_maps_are_read() {
    let tests = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/clients/web/readers.mjs");
    let told = run(Command::new("node").arg(tests));
    assert!(told.contains("done"), "{told}");
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn a_token_opens_the_pages() {
    let (server, token) = Server::start_with_a_token();
    fs::write(server.folder.path().join("token"), token).expect("a file");
    scenario("token", &server);
}

#[test]
#[ignore = "needs node, python3"]
fn the_modules_of_the_pages_compute_what_they_say() {
    let folder = tempfile::tempdir().expect("a folder");
    let root = env!("CARGO_MANIFEST_DIR");
    let told = run(Command::new("node")
        .arg(format!("{root}/tests/clients/web/modules.cjs"))
        .arg(format!("{root}/src/http/pages/assets"))
        .arg(folder.path()));
    assert!(told.contains("done"), "{told}");
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn what_will_be_sent_is_told_before_and_a_person_needs_no_mouse() {
    scenario("told", &with_profile());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn what_does_not_fit_is_told_with_its_cure_before_anything_is_sent() {
    scenario("misfits", &with_profile());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn a_folder_of_three_thousand_files_stays_quick() {
    scenario("many", &with_profile());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn a_profile_without_a_camera_says_so_and_gets_one_without_an_upload() {
    scenario("camera", &with_work());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn an_upload_goes_on_after_the_person_signed_in_again() {
    scenario("signed_out", &with_profile());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn a_server_that_is_gone_is_told_and_the_page_goes_on_when_it_is_back() {
    scenario("gone", &with_work());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn each_button_of_a_finding_does_what_it_says() {
    scenario("advice", &with_findings());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn notes_are_written_and_deleted_on_the_pages_and_two_tabs_tell_the_truth() {
    scenario("notes", &with_work());
}

#[test]
#[ignore = "needs curl, chromium, node, playwright-core, axe-core"]
fn no_page_scrolls_sideways_when_it_is_enlarged() {
    scenario("zoom", &with_work());
}
