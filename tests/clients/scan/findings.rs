//! Rendered scans of which something went wrong, through one upload to the findings of a reconstruction that starts by
//! itself: a turntable that slips, a specimen that moves, and a view of another specimen. Pictures, sizes and views are
//! as few as COLMAP needs.

use std::{collections::HashMap, fs};

use pinstack_science::{
    archive::pack,
    imaging::codec,
    synth::{
        Light, Rig,
        turntable::{self, Specimen},
    },
    types::view::ViewAngles,
};
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::server::{LOOK, Server, profile_of};

const WIDTH: usize = 600;
const SLICES: usize = 2;
const VIEWS: usize = 8;
const STEP_DEG: f64 = 10.0;
/// The first view after the fault, or the one of another specimen.
const ODD: usize = 4;

/// What a scan photographs in a view: which specimen, and by how much pan differs from the command, degrees.
type Seen<'a> = (&'a Specimen, f64);

fn commanded(view: usize) -> ViewAngles {
    ViewAngles { pan_deg: STEP_DEG * view as f64, tilt_deg: 0.0 }
}

/// The slices of a view: everything is in focus, which takes the least time.
fn slices(rig: &Rig, (specimen, off_deg): Seen<'_>, view: usize) -> Vec<(String, Vec<u8>)> {
    let ViewAngles { pan_deg, tilt_deg } = commanded(view);
    let stage = turntable::view(rig, specimen, ViewAngles { pan_deg: pan_deg + off_deg, tilt_deg });
    let lights = [("front", Light::Front), ("back", Light::Back)];
    let all = lights.into_iter().flat_map(|light| (0..rig.slices()).map(move |at| (light, at)));
    all.map(|((name, light), at)| (format!("{name}/{at}.jpg"), codec::encode_jpeg(&stage.render(light, at), 95)))
        .collect()
}

/// Sends a scan, and returns the reconstruction that the service makes of it by itself.
fn reconstructed(server: &Server, name: &str, views: &[Vec<(String, Vec<u8>)>]) -> Value {
    let scan = json!({ "rig": "rig", "lens": "lens", "expected_views": views.len(), "reconstruct": "auto" });
    let body = scan.to_string();
    server.curl(&["-X", "PUT", "-H", "Content-Type: application/json", "-d", &body], &format!("/v1/scans/{name}"));
    let members = views.iter().enumerate().flat_map(|(view, slices)| {
        let folder = commanded(view).file_stem();
        slices.iter().map(move |(file, bytes)| (format!("{folder}/{file}"), bytes.clone()))
    });
    let zip = server.folder.path().join(format!("{name}.zip"));
    pack(fs::File::create(&zip).expect("a file"), members).expect("a zip");
    let sent = server.curl(&["-X", "POST", "-T", zip.to_str().expect("plain")], &format!("/v1/scans/{name}/archive"));
    assert_eq!(sent["views"].as_array().map(Vec::len), Some(views.len()), "{sent}");
    loop {
        let list = server.curl(&[], &format!("/v1/scans/{name}/reconstructions"));
        if let Some(made) = list["items"].get(0) {
            let made = server.finished(made);
            assert_eq!(made["state"], "succeeded", "{made}");
            return made["result"].clone();
        }
        std::thread::sleep(20 * LOOK);
    }
}

/// The findings of a scan by their codes, without those of what every scan of so few views has.
fn faults(result: &Value) -> HashMap<&str, Vec<&str>> {
    let codes =
        ["no_model", "several_parts", "not_registered", "turntable_slipped", "specimen_moved", "turntable_wobbles"];
    let of = |finding: &'_ Value| {
        let views = finding["views"].as_array().expect("a list").iter();
        views.map(|view| view.as_str().expect("a name").to_owned()).collect::<Vec<_>>()
    };
    let all = result["findings"].as_array().expect("a list").iter();
    for finding in all.clone() {
        println!("{} {:?}: {}", finding["code"], of(finding), finding["detail"]);
    }
    all.filter_map(|finding| {
        let code = codes.into_iter().find(|code| finding["code"] == *code)?;
        let views = finding["views"].as_array()?.iter().filter_map(Value::as_str).collect();
        Some((code, views))
    })
    .collect()
}

#[test]
#[ignore = "needs curl, colmap"]
fn each_fault_of_a_rendered_scan_is_found_in_its_view() {
    let rig = turntable::scan_rig(WIDTH, SLICES);
    let rig = Rig { f_number: 1e4 * rig.f_number, ..rig };
    let server = Server::start();
    let mut profile = profile_of(&rig);
    profile["pixel_pitch_mm"] = json!(rig.pixel_pitch_mm);
    profile["principal_distance_mm"] = json!(rig.principal_distance(rig.reference));
    let body = profile.to_string();
    let put = server.curl(&["-X", "PUT", "-H", "Content-Type: application/json", "-d", &body], "/v1/profiles/rig/lens");
    assert_eq!(put["revision"], 1, "{put}");

    let (beetle, other) = (Specimen::beetle(1), Specimen::beetle(2));
    let moved = beetle.clone().moved([0.0, 1.5, 1.0]);
    let rendered = |seen: Seen<'_>, views: std::ops::Range<usize>| -> Vec<_> {
        views.into_par_iter().map(|view| slices(&rig, seen, view)).collect()
    };
    let good = rendered((&beetle, 0.0), 0..VIEWS);
    let from = |later: Vec<_>| [good[..ODD].to_vec(), later].concat();
    let [before, odd] = [ODD - 1, ODD].map(|view| commanded(view).file_stem());
    let step = vec![before.as_str(), odd.as_str()];

    let slipped = reconstructed(&server, "slipped", &from(rendered((&beetle, 2.5), ODD..VIEWS)));
    assert_eq!(faults(&slipped), HashMap::from([("turntable_slipped", step.clone())]), "{slipped}");
    let moved = reconstructed(&server, "moved", &from(rendered((&moved, 0.0), ODD..VIEWS)));
    assert_eq!(faults(&moved), HashMap::from([("specimen_moved", step)]), "{moved}");
    let mut views = good.clone();
    views[ODD] = slices(&rig, (&other, 0.0), ODD);
    let mixed = reconstructed(&server, "mixed", &views);
    assert_eq!(faults(&mixed), HashMap::from([("not_registered", vec![odd.as_str()])]), "{mixed}");
    assert_eq!(mixed["registered"], VIEWS - 1);
}
