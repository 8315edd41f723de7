//! `kill -9` in the middle of a job.

use crate::server::{LOOK, Server, write_stack_of};
use pinstack_science::synth::Rig;

#[test]
#[ignore = "needs curl"]
fn a_killed_server_resumes_its_jobs_after_a_restart() {
    let mut server = Server::start();
    // Large enough to be caught at work.
    let rig = Rig::sized(900, 600, 4);
    let zip = server.folder.path().join("stack.zip");
    write_stack_of(&rig, &zip);
    server.put_profile(&rig);
    let zip = zip.to_str().expect("a plain path");
    let accepted =
        server.curl(&["-X", "POST", "-T", zip, "-H", "Content-Type: application/zip"], "/v1/stacks?rig=rig&lens=lens");
    let path = format!("/v1/stacks/{}", accepted["id"].as_str().expect("an id"));
    loop {
        let stack = server.curl(&[], &path);
        assert_ne!(stack["state"], "succeeded", "it was too quick to be caught: {stack}");
        if stack["state"] == "running" && stack["progress"]["fraction"].as_f64() > Some(0.05) {
            break;
        }
        std::thread::sleep(LOOK);
    }
    server.kill_and_start_again();
    let stack = server.curl(&["-H", "Prefer: wait=60"], &path);
    assert_eq!((stack["state"].as_str(), stack["attempt"].as_u64()), (Some("succeeded"), Some(2)), "{stack}");
    let image = server.folder.path().join("image.png");
    server.download(&[], &format!("{path}/image"), &image);
    assert!(image.metadata().expect("an image").len() > 0);
}
